"""Controls of the page of `saccade serve`, and its settings as Python and as a command."""

import shlex
from dataclasses import asdict, fields, is_dataclass
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import tomli_w

from saccade.attention.models import KINDS
from saccade.errors import RANGE, Slider
from saccade.serving.playground import PlaygroundNoise
from saccade.settings import (
    DEFAULT,
    FREE_VIEWING,
    NONE,
    field_help,
    load_settings,
    preset_names,
)
from saccade.slam.config import RETRACTIONS
from saccade.slam.consistency import chi_square_band
from saccade.viewing.slam import ELLIPSE_LABEL, ELLIPSE_SCALE

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

INITIAL = {"attention": FREE_VIEWING}
"""Presets with which the page opens where these are not the default."""
HIDDEN = {"attention": ("face_weight",)}
"""Settings without effect here: the page has no detector of faces."""
SHOWN_FIRST = {
    "attention": ("contrast_weight", "symmetry_weight", "boolean_weight", "center_prior"),
    "contrast": ("intensity_weight", "color_weight", "orientation_weight", "sharpening"),
    "symmetry": ("kind", "outer", "sigma", "gain"),
    "boolean": ("thresholds", "dilation", "smoothing"),
    "scanpath": ("inhibition_sigma", "inhibition_time_constant"),
    "sift": ("contrast_threshold", "edge_ratio", "max_keypoints", "spread"),
    "must": ("contrast_threshold", "radius", "falloff", "max_keypoints"),
    "symroid": ("seed_threshold", "max_keypoints", "upright"),
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
        "noise": setting_controls(PlaygroundNoise),
        "values": asdict(PlaygroundNoise()),
        "nees_band": list(chi_square_band(3)),
        "ellipse_scale": ELLIPSE_SCALE,
        "ellipse_label": ELLIPSE_LABEL,
    }


def setting_controls(
    configuration: type, shown_first: tuple[str, ...] = ()
) -> list[dict[str, Any]]:
    """The control of each setting of a configuration, except nested configurations.

    Args:
        configuration: a dataclass; the type hint and the range of a setting say which control it
            gets, a number without slider a field.
        shown_first: names of the settings at the top.
    """
    help_texts, hints = field_help(configuration), get_type_hints(configuration)
    settings = {each.name: each.metadata.get(RANGE) for each in fields(configuration)}
    sliders = {name: each and each.slider for name, each in settings.items()}
    names = [name for name in settings if not _is_group(hints[name])]
    return [
        {"name": name, "help": help_texts.get(name, ""), **_control(hints[name], sliders[name])}
        for name in (*shown_first, *(each for each in names if each not in shown_first))
    ]


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
            for each in setting_controls(type(settings), first)
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


def _control(hint: Any, limits: Slider | None) -> dict[str, Any]:
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


FIXATIONS = 10
"""Default length of a scanpath."""


def read_python(name: str) -> str:
    """The lines that read a photograph."""
    return f"import saccade\n\nimage = saccade.read_image({name!r})"


def attention_python(model: str, settings: Any, path: Any, fixations: int) -> str:
    """The lines that compute saliency and scanpath."""
    config = f", {_constructor(settings)}" if changes(settings) else ""
    options = f", fixations={fixations}" if fixations != FIXATIONS else ""
    if changes(path):
        options += f", config={_constructor(path)}"
    return (
        f"maps = saccade.{KINDS[model]}_saliency(image{config})\n"
        f"path = saccade.scanpath(maps.saliency, image.shape{options})"
    )


def detection_python(detector: str, settings: Any) -> str:
    """The line that detects interest points."""
    config = _constructor(settings) if changes(settings) else ""
    return f"points = saccade.{DETECTORS[detector]}({config})(image)"


def attention_command(name: str, model: str, settings: Any, path: Any, fixations: int) -> str:
    """The command that computes saliency and scanpath."""
    options = ["--model", model] if model != "attention" else []
    options += ["--fixations", str(fixations)] if fixations != FIXATIONS else []
    options += ["--scanpath", "winner-take-all"]
    default = type(settings)()
    if model == "attention" and settings == default:
        options += ["--bare"]
    elif model == "attention":
        default = load_settings(model, FREE_VIEWING)
    command = _command("look", name, options, KINDS[model], _toml_value(settings, default))
    if changes(path):
        command = f"# scanpath settings: in Python only\n{command}"
    return command


def detection_command(name: str, detector: str, settings: Any) -> str:
    """The command that detects interest points."""
    options = [] if detector == "sift" else ["--detector", detector]
    return _command("detect", name, options, detector, _toml_value(settings, type(settings)()))


def changes(settings: Any, default: Any = None) -> dict[str, Any]:
    """The settings of a configuration that differ from another, by default from their defaults."""
    default = type(settings)() if default is None else default
    values = ((each.name, getattr(settings, each.name)) for each in fields(settings))
    return {name: value for name, value in values if value != getattr(default, name)}


def _constructor(settings: Any) -> str:
    """A configuration as the Python expression that makes it."""
    arguments = ", ".join(
        f"{name}={_constructor(value) if is_dataclass(value) else repr(value)}"
        for name, value in changes(settings).items()
    )
    return f"saccade.{type(settings).__name__}({arguments})"


def _toml_value(value: Any, default: Any) -> Any:
    if is_dataclass(value):
        return {
            name: _toml_value(each, getattr(default, name, None))
            for name, each in changes(value, default).items()
        }
    return NONE if value is None else value


def _command(command: str, name: str, options: list[str], kind: str, table: dict[str, Any]) -> str:
    """A command, preceded by the file with the table of settings that it needs."""
    photo = shlex.quote(f"./{name}" if name.startswith("-") else name)
    line = " ".join(("saccade", command, photo, *options))
    if not table:
        return line
    return f"cat > {kind}.toml <<'END'\n{tomli_w.dumps(table)}END\n{line} --config {kind}.toml"
