"""Controls of the page of `saccade serve`, derived from the fields of the configurations."""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from itertools import pairwise
from types import NoneType
from typing import Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

from saccade.serving.simulated_robot import NOISE_RANGES, PlaygroundNoise
from saccade.settings import DEFAULT, FREE_VIEWING, load_settings, preset_names
from saccade.slam.config import RETRACTIONS
from saccade.slam.consistency import chi_square_band
from saccade.viewing.slam import ELLIPSE_LABEL, ELLIPSE_SCALE

Range: TypeAlias = tuple[float, float, float]

TITLES = {
    "attention": "Attention: contrast and symmetry",
    "contrast": "Contrast",
    "symmetry": "Symmetry",
    "boolean": "Boolean maps",
    "scanpath": "Scanpath",
    "sift": "SIFT",
    "must": "MUST",
    "symroid": "SymRoID",
}
"""By kind of configuration, in the order of the page."""
DETECTORS = {"sift": "Sift", "must": "Must", "symroid": "SymRoid"}
"""The class of each detector."""
MODELS = {
    "attention": ("attention", "contrast", "symmetry", "boolean"),
    "contrast": ("contrast",),
    "symmetry": ("symmetry",),
    "boolean": ("boolean",),
}
"""The configurations of each attention model, the one that contains the others first."""

_WEIGHT = (0, 2, 0.05)
RANGES: dict[str, Range] = {
    "contrast_weight": (0.05, 2, 0.05),
    "symmetry_weight": (0.05, 2, 0.05),
    "boolean_weight": _WEIGHT,
    "longer_side": (50, 800, 10),
    "thresholds": (4, 64, 1),
    "opening": (1, 15, 2),
    "dilation": (1, 15, 2),
    "area_exponent": (0, 1, 0.05),
    "intensity_weight": _WEIGHT,
    "color_weight": _WEIGHT,
    "orientation_weight": _WEIGHT,
    "sharpening": (0.25, 4, 0.25),
    "smoothing": (0, 5, 0.25),
    "map_level": (1, 7, 1),
    "center_prior": (0, 1, 0.05),
    "center_height": (-0.5, 0.5, 0.05),
    "border_prior": (0, 0.5, 0.01),
    "dark": (0, 0.5, 0.01),
    "gabor_period": (2, 20, 0.5),
    "gabor_sigma": (0.5, 8, 0.1),
    "gabor_size": (3, 31, 2),
    "maxima_threshold": (0, 1, 0.05),
    "maxima_radius": (0, 0.5, 0.01),
    "iterations": (1, 10, 1),
    "viewing_size": (0, 3200, 100),
    "outer": (1, 15, 1),
    "inner": (1, 10, 1),
    "sigma": (0.5, 32, 0.5),
    "gain": (1, 200, 1),
    "inhibition_sigma": (0.01, 0.3, 0.005),
    "inhibition_time_constant": (0.05, 5, 0.05),
    "time_limit": (0.5, 20, 0.5),
    "peak": (0, 5, 0.1),
    "time_step": (1e-5, 1e-3, 0),
    "drive": (1e-3, 1, 0),
    "background": (1e-7, 1e-2, 0),
    "map_time_constant": (0.05, 2, 0.05),
    "winner_time_constant": (0.02, 1, 0.01),
    "threshold": (1e-4, 1e-2, 0),
    "reset": (-0.1, 0, 0.005),
    "inhibition_strength": (1e4, 1e8, 0),
    "inhibition_surround": (0, 0.01, 1e-4),
    "contrast_threshold": (0, 0.1, 0.001),
    "edge_ratio": (1, 50, 0.5),
    "max_keypoints": (0, 10_000, 50),
    "base_sigma": (0.5, 4, 0.1),
    "intervals": (1, 8, 1),
    "octaves": (0, 10, 1),
    "first_octave": (-1, 0, 1),
    "extra_intervals": (0, 6, 1),
    "density": (0.5, 1, 0.5),
    "camera_sigma": (0, 2, 0.1),
    "kernel_radius": (1, 8, 0.5),
    "border": (2, 20, 1),
    "candidate_fraction": (0, 1, 0.05),
    "max_orientations": (0, 8, 1),
    "orientation_spacing": (0, 3, 0.1),
    "descriptor_spacing": (0, 3, 0.1),
    "window_sigma": (0.1, 3, 0.1),
    "radius": (0.5, 6, 0.1),
    "falloff": (0.2, 6, 0.1),
    "scale_power": (-1, 2, 0.05),
    "seed_threshold": (0.01, 1, 0.01),
    "growth_threshold": (0.05, 1, 0.05),
}
"""Minimum, maximum and step of the slider of a number; a step of 0 makes it logarithmic."""
KIND_RANGES: dict[str, dict[str, Range]] = {
    "scanpath": {"gain": (0.5, 50, 0)},
    "boolean": {"smoothing": (0, 0.2, 0.005)},
    "sift": {"smoothing": (0, 20, 1)},
    "must": {
        "contrast_threshold": (0, 0.5, 0.005),
        "edge_ratio": (1, 100, 1),
        "base_sigma": (0.5, 6, 0.1),
        "gain": (1, 500, 1),
    },
    "symroid": {"max_keypoints": (0, 500, 1)},
}
"""Ranges of one kind of configuration where they differ."""
INITIAL = {"attention": FREE_VIEWING}
"""Presets with which the page opens where these are not the default."""
HIDDEN = {"attention": ("face_weight",)}
"""Settings without effect here: the page has no detector of faces."""
SHOWN_FIRST = {
    "attention": ("contrast_weight", "symmetry_weight", "boolean_weight", "center_prior"),
    "contrast": ("intensity_weight", "color_weight", "orientation_weight", "sharpening"),
    "symmetry": ("kind", "outer", "sigma", "gain"),
    "boolean": ("thresholds", "area_exponent", "smoothing"),
    "scanpath": ("inhibition_sigma", "inhibition_time_constant"),
    "sift": ("contrast_threshold", "edge_ratio", "max_keypoints", "spread"),
    "must": ("contrast_threshold", "radius", "falloff", "max_keypoints"),
    "symroid": ("frame", "seed_threshold", "growth_threshold", "max_keypoints"),
}
"""Settings that are shown before the rest is opened, in this order."""


def controls() -> dict[str, Any]:
    """The input of the page's script: groups of settings with their presets and controls."""
    return {
        "models": {name: list(kinds) for name, kinds in MODELS.items()},
        "detectors": list(DETECTORS),
        "groups": [_group(kind, title) for kind, title in TITLES.items()],
        "playground": playground_controls(),
    }


def playground_controls() -> dict[str, Any]:
    """The filters of the SLAM playground, and the control and default of each noise."""
    return {
        "filters": list(RETRACTIONS),
        "noise": setting_controls(PlaygroundNoise, NOISE_RANGES),
        "values": asdict(PlaygroundNoise()),
        "nees_band": list(chi_square_band(3)),
        "ellipse_scale": ELLIPSE_SCALE,
        "ellipse_label": ELLIPSE_LABEL,
    }


def setting_controls(
    configuration: type, ranges: Mapping[str, Range], shown_first: tuple[str, ...] = ()
) -> list[dict[str, Any]]:
    """The control of each setting of a configuration, except nested configurations.

    Args:
        configuration: a dataclass; its type hints say which control a setting gets.
        ranges: of its numbers; a number without range gets a field.
        shown_first: names of the settings at the top.
    """
    help_texts, hints = field_help(configuration), get_type_hints(configuration)
    names = [each.name for each in fields(configuration) if not _is_group(hints[each.name])]
    return [
        {"name": name, "help": help_texts.get(name, ""), **_control(hints[name], ranges.get(name))}
        for name in (*shown_first, *(each for each in names if each not in shown_first))
    ]


def field_help(configuration: type) -> Mapping[str, str]:
    """The docstring of each field of a class; empty where its source is not installed."""
    inherited = [field_help(parent) for parent in reversed(configuration.__bases__)]
    texts = {name: text for each in inherited for name, text in each.items()}
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(configuration))).body[0]
    except (OSError, TypeError):
        return texts
    body = getattr(tree, "body", [])
    return texts | {
        field.target.id: " ".join(str(text.value.value).split())
        for field, text in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


def _group(kind: str, title: str) -> dict[str, Any]:
    settings, first = load_settings(kind), SHOWN_FIRST[kind]
    presets: dict[str, dict[str, dict[str, Any]]] = {}
    for name in preset_names(kind):
        preset = load_settings(kind, name)
        values = _values(kind, preset)
        # A preset may differ from the default only in what the page does not show.
        if preset == settings or values != presets[DEFAULT]:
            presets[name] = values
    return {
        "kind": kind,
        "title": title,
        "first": len(first),
        "presets": presets,
        "initial": INITIAL.get(kind, DEFAULT),
        "fields": [
            each
            for each in setting_controls(type(settings), RANGES | KIND_RANGES.get(kind, {}), first)
            if each["name"] not in HIDDEN.get(kind, ())
        ],
    }


def _values(kind: str, settings: Any) -> dict[str, dict[str, Any]]:
    """By kind, the values of a configuration and of its nested ones that have a group."""
    hints, values = get_type_hints(type(settings)), dict[str, Any]()
    by_kind = {kind: values}
    for name, hint in hints.items():
        value = getattr(settings, name)
        if name in TITLES:
            by_kind |= _values(name, value)
        elif not _is_group(hint) and name not in HIDDEN.get(kind, ()):
            values[name] = value
    return by_kind


def _is_group(hint: Any) -> bool:
    """Whether a type is a configuration, or a configuration or None."""
    return any(is_dataclass(each) for each in (hint, *get_args(hint)))


def _control(hint: Any, limits: Range | None) -> dict[str, Any]:
    """The control of a type; that of an optional type can be switched off, which means None."""
    if NoneType in get_args(hint):
        (inner,) = (each for each in get_args(hint) if each is not NoneType)
        if limits is not None:
            low, high, step = limits
            limits = low or step, high, step  # 0 is not a value of its own beside None
        return {**_control(inner, limits), "optional": True}
    if limits is not None and hint in (int, float):
        low, high, step = limits
        return {"input": "range", "low": low, "high": high, "step": step}
    if get_origin(hint) is Literal:
        return {"input": "choice", "choices": list(get_args(hint))}
    return {"input": {bool: "check", int: "number", float: "number"}.get(hint, "list")}
