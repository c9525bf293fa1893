"""What the page of `saccade serve` offers to change: the fields of the configurations."""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

TITLES = {
    "attention": "Attention: contrast and symmetry",
    "contrast": "Contrast",
    "symmetry": "Symmetry",
    "scanpath": "Scanpath",
    "sift": "SIFT",
    "must": "MUST",
    "symroid": "SymRoID",
}
"""By kind of configuration, in the order of the page."""
DETECTORS = ("sift", "must", "symroid")
MODELS = {
    "both": ("attention", "contrast", "symmetry"),
    "contrast": ("contrast",),
    "symmetry": ("symmetry",),
}
"""Which configurations a model of attention has, the one that holds the others first."""

_WEIGHT, _LEVEL, _CELLS, _SIDE = (0, 2, 0.05), (1, 7, 1), (0, 5, 0.25), (0, 3200, 100)
_COUNT = (0, 10_000, 50)
RANGES: dict[str, dict[str, tuple[float, float, float]]] = {
    "attention": {"contrast_weight": (0.05, 2, 0.05), "symmetry_weight": (0.05, 2, 0.05)},
    "contrast": {
        "intensity_weight": _WEIGHT,
        "color_weight": _WEIGHT,
        "orientation_weight": _WEIGHT,
        "sharpening": (0.25, 4, 0.25),
        "smoothing": _CELLS,
        "map_level": _LEVEL,
        "center_prior": (0, 1, 0.05),
        "dark": (0, 0.5, 0.01),
        "gabor_period": (2, 20, 0.5),
        "gabor_sigma": (0.5, 8, 0.1),
        "gabor_size": (3, 31, 2),
        "maxima_threshold": (0, 1, 0.05),
        "maxima_radius": (0, 0.5, 0.01),
        "iterations": (1, 10, 1),
        "viewing_size": _SIDE,
    },
    "symmetry": {
        "outer": (1, 15, 1),
        "sigma": (0.5, 32, 0.5),
        "gain": (1, 200, 1),
        "sharpening": (0.25, 4, 0.25),
        "inner": (1, 10, 1),
        "map_level": _LEVEL,
        "smoothing": _CELLS,
        "viewing_size": _SIDE,
    },
    "scanpath": {
        "inhibition_sigma": (0.01, 0.3, 0.005),
        "inhibition_time_constant": (0.05, 5, 0.05),
        "time_limit": (0.5, 20, 0.5),
        "peak": (0, 5, 0.1),
        "time_step": (1e-5, 1e-3, 0),
        "drive": (1e-3, 1, 0),
        "background": (1e-7, 1e-2, 0),
        "map_time_constant": (0.05, 2, 0.05),
        "gain": (0.5, 50, 0),
        "winner_time_constant": (0.02, 1, 0.01),
        "threshold": (1e-4, 1e-2, 0),
        "reset": (-0.1, 0, 0.005),
        "inhibition_strength": (1e4, 1e8, 0),
        "inhibition_surround": (0, 0.01, 1e-4),
    },
    "sift": {
        "contrast_threshold": (0, 0.1, 0.001),
        "edge_ratio": (1, 50, 0.5),
        "max_keypoints": _COUNT,
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
        "smoothing": (0, 20, 1),
        "max_orientations": (0, 8, 1),
        "orientation_spacing": (0, 3, 0.1),
        "descriptor_spacing": (0, 3, 0.1),
        "window_sigma": (0.1, 3, 0.1),
    },
    "must": {
        "contrast_threshold": (0, 0.5, 0.005),
        "radius": (0.5, 6, 0.1),
        "falloff": (0.2, 6, 0.1),
        "max_keypoints": _COUNT,
        "gain": (1, 500, 1),
        "scale_power": (-1, 2, 0.05),
        "edge_ratio": (1, 100, 1),
        "base_sigma": (0.5, 6, 0.1),
        "intervals": (1, 8, 1),
        "octaves": (0, 10, 1),
        "first_octave": (-1, 0, 1),
        "border": (2, 20, 1),
        "max_orientations": (0, 8, 1),
    },
    "symroid": {
        "seed_threshold": (0.01, 1, 0.01),
        "growth_threshold": (0.05, 1, 0.05),
        "max_keypoints": (0, 500, 1),
        "outer": (1, 15, 1),
        "inner": (1, 10, 1),
        "sigma": (0.5, 32, 0.5),
        "gain": (1, 200, 1),
    },
}
"""From, to and step of the slider of each number; a step of 0 is a factor, the same everywhere.

The lowest position of a setting that may be None stands for None."""
FIRST = {
    "attention": ("contrast_weight", "symmetry_weight", "normalization"),
    "contrast": ("intensity_weight", "color_weight", "orientation_weight", "sharpening"),
    "symmetry": ("kind", "outer", "sigma", "gain"),
    "scanpath": ("inhibition_sigma", "inhibition_time_constant"),
    "sift": ("contrast_threshold", "edge_ratio", "max_keypoints", "spread"),
    "must": ("contrast_threshold", "radius", "falloff", "max_keypoints"),
    "symroid": ("seed_threshold", "growth_threshold", "relative_to", "max_keypoints"),
}
"""Settings that are seen at once, in this order."""


def controls() -> dict[str, Any]:
    """What the script of the page is given: groups of settings with presets and ranges."""
    return {
        "models": {name: list(kinds) for name, kinds in MODELS.items()},
        "detectors": list(DETECTORS),
        "groups": [_group(kind, title) for kind, title in TITLES.items()],
    }


def _group(kind: str, title: str) -> dict[str, Any]:
    from saccade.settings import DEFAULT, load_settings, preset_names

    settings = load_settings(kind)
    own = [each.name for each in fields(settings) if not is_dataclass(getattr(settings, each.name))]
    ranked = [*FIRST[kind], *(name for name in own if name not in FIRST[kind])]
    help_of, hints = field_help(type(settings)), get_type_hints(type(settings))
    presets: dict[str, dict[str, dict[str, Any]]] = {}
    for name in preset_names(kind):
        preset = load_settings(kind, name)
        values = _values(kind, preset)
        # One may differ from the default in nothing but what the page does not show.
        if preset == settings or values != presets[DEFAULT]:
            presets[name] = values
    return {
        "kind": kind,
        "title": title,
        "first": len(FIRST[kind]),
        "presets": presets,
        "fields": [
            {"name": name, "help": help_of.get(name, ""), **_input(kind, name, hints[name])}
            for name in ranked
        ],
    }


def _values(kind: str, settings: Any) -> dict[str, dict[str, Any]]:
    """By kind, what a configuration and those that it holds are set to, if they have a title."""
    values: dict[str, Any] = {}
    found = {kind: values}
    for each in fields(settings):
        value = getattr(settings, each.name)
        if each.name in TITLES:
            found |= _values(each.name, value)
        elif not is_dataclass(value):
            values[each.name] = value
    return found


def _input(kind: str, name: str, hint: Any) -> dict[str, Any]:
    """How a setting is changed."""
    if name in RANGES[kind]:
        low, high, step = RANGES[kind][name]
        optional = NoneType in get_args(hint)
        return {"input": "range", "low": low, "high": high, "step": step, "optional": optional}
    if get_origin(hint) is Literal:
        return {"input": "choice", "choices": list(get_args(hint))}
    return {"input": "check" if hint is bool else "list"}


def field_help(configuration: type) -> Mapping[str, str]:
    """What stands below each field of a class; nothing where its source is not installed."""
    inherited = [field_help(parent) for parent in reversed(configuration.__bases__)]
    found = {name: text for texts in inherited for name, text in texts.items()}
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(configuration))).body[0]
    except (OSError, TypeError):
        return found
    name = ""
    for node in getattr(tree, "body", []):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and name:
            found[name] = " ".join(str(node.value.value).split())
            name = ""
        else:
            name = ""
    return found


def changes(settings: Any) -> dict[str, Any]:
    """What a configuration is set to beside its defaults; those that it holds likewise."""
    default = type(settings)()
    values = ((each.name, getattr(settings, each.name)) for each in fields(settings))
    return {name: value for name, value in values if value != getattr(default, name)}
