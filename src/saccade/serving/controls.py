"""Controls of the page of `saccade serve`, and its settings as configuration files."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from saccade.attention import models
from saccade.errors import CHOICES
from saccade.keypoints.detectors import DETECTORS
from saccade.serving.playground import PlaygroundNoise
from saccade.settings import (
    DEFAULT,
    as_toml,
    field_help,
    load_settings,
    preset_names,
)
from saccade.slam import ERRORS
from saccade.slam.consistency import chi_square_band
from saccade.viewing.page import web_file
from saccade.viewing.slam import ELLIPSE_LABEL, ELLIPSE_SCALE

MODELS = {
    name: (name, *(each for each in get_type_hints(row.settings) if each in models.MODELS))
    for name, row in models.MODELS.items()
}
"""Configurations of each saliency model: its own, then nested configurations."""
SCANPATHS = {"most-probable": "scanpath-model", "winner-take-all": "scanpath"}
"""Configuration of each kind of scanpath, the default of `saccade look` first."""


GROUPS: dict[str, dict[str, Any]] = tomllib.loads(web_file("serving/controls.toml"))
"""Titles, order and sliders of the settings by kind; `web/controls.toml` documents them."""
for _name in MODELS:
    GROUPS.setdefault(_name, {"title": _name.capitalize(), "first": [], "sliders": {}})
for _name, _row in DETECTORS.items():
    GROUPS.setdefault(_name, {"title": _row.summary, "first": [], "sliders": {}})


def controls() -> dict[str, Any]:
    """The input of the page's script: groups of settings with their presets and controls."""
    kinds = [kind for kind, group in GROUPS.items() if "title" in group]
    return {
        "models": {name: list(parts) for name, parts in MODELS.items()},
        "scanpaths": SCANPATHS,
        "detectors": list(DETECTORS),
        "groups": [_group(kind) for kind in kinds],
        "playground": playground_controls(),
    }


def playground_controls() -> dict[str, Any]:
    """The filters of the SLAM playground, and the control and default of each noise."""
    return {
        "filters": list(ERRORS),
        "noise": setting_controls(PlaygroundNoise, GROUPS["playground"]),
        "values": asdict(PlaygroundNoise()),
        "nees_band": list(chi_square_band(3)),
        "ellipse_scale": ELLIPSE_SCALE,
        "ellipse_label": ELLIPSE_LABEL,
    }


def setting_controls(configuration: type, group: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The control of each setting of a configuration, except nested configurations.

    Args:
        configuration: a dataclass; the type of a setting chooses its control.
        group: sliders of the configuration, its labels and units, and its `first` and `hidden`
            settings.
    """
    help_texts, hints = field_help(configuration), get_type_hints(configuration)
    choices = {each.name: each.metadata.get(CHOICES, ()) for each in fields(configuration)}
    first, hidden = group.get("first", ()), group.get("hidden", ())
    names = (each.name for each in fields(configuration) if not _is_group(hints[each.name]))
    return [
        {
            "name": name,
            "label": group.get("labels", {}).get(name, name),
            "unit": group.get("units", {}).get(name, ""),
            "help": help_texts.get(name, ""),
            **_control(hints[name], group["sliders"].get(name), choices[name]),
        }
        for name in dict.fromkeys((*first, *names))
        if name not in hidden
    ]


def _group(kind: str) -> dict[str, Any]:
    group = GROUPS[kind]
    presets: dict[str, dict[str, dict[str, Any]]] = {}
    for name in preset_names(kind):
        values = _values(kind, load_settings(kind, name))
        if values not in presets.values():  # presets may differ in settings without a control
            presets[name] = values
    return {
        "kind": kind,
        "title": group["title"],
        "first": len(group["first"]),
        "presets": presets,
        "initial": group.get("initial", DEFAULT),
        "fields": setting_controls(type(load_settings(kind)), group),
    }


def _values(kind: str, settings: Any) -> dict[str, dict[str, Any]]:
    """Values of a configuration and of nested configurations with a group, by kind."""
    hints, values = get_type_hints(type(settings)), dict[str, Any]()
    by_kind = {kind: values}
    for name, hint in hints.items():
        value = getattr(settings, name)
        if name in GROUPS:
            by_kind |= _values(name, value)
        elif not _is_group(hint) and name not in GROUPS[kind].get("hidden", ()):
            values[name] = value
    return by_kind


def _is_group(hint: Any) -> bool:
    """Whether a type is a configuration, or a configuration or None."""
    return any(is_dataclass(each) for each in (hint, *get_args(hint)))


def _control(
    hint: Any, slider: Sequence[float] | None, choices: Sequence[str] = ()
) -> dict[str, Any]:
    """The control for a type; optional settings can be switched off, which gives None."""
    if choices:
        return {"input": "choice", "choices": list(choices)}
    if NoneType in get_args(hint):
        (inner,) = (each for each in get_args(hint) if each is not NoneType)
        return {**_control(inner, slider), "optional": True}
    if slider is not None:
        return {"input": "range", **dict(zip(("low", "high", "step"), slider, strict=True))}
    if get_origin(hint) is Literal:
        return {"input": "choice", "choices": list(get_args(hint))}
    return {"input": {bool: "check", int: "number", float: "number"}.get(hint, "list")}


def attention_file(model: str, settings: Any, fixations: int, scanpath: str) -> str:
    """The settings of a model as a configuration file for `saccade look`."""
    options = f"--model {model} --scanpath {scanpath} --length {fixations}"
    return f"# saccade look PHOTO {options} --config {model}.toml\n{as_toml(settings)}"


def detection_file(detector: str, settings: Any) -> str:
    """The settings of a detector as a configuration file for `saccade detect`."""
    command = f"saccade detect PHOTO --detector {detector} --config {detector}.toml"
    return f"# {command}\n{as_toml(settings)}"
