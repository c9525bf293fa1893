"""Configurations from presets and TOML files."""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from saccade.errors import ConfigError
from saccade.io.files import read_toml

KINDS = {
    "attention": ("saccade.attention.combined", "AttentionConfig"),
    "contrast": ("saccade.attention.contrast", "ContrastConfig"),
    "symmetry": ("saccade.attention.symmetry", "SymmetryConfig"),
    "boolean": ("saccade.attention.boolean_maps", "BooleanConfig"),
    "scanpath": ("saccade.attention.scanpath", "ScanpathConfig"),
    "scanpath-model": ("saccade.attention.scanpath_model", "ScanpathModelConfig"),
    "must": ("saccade.keypoints.must_config", "MustConfig"),
    "sift": ("saccade.keypoints.sift_config", "SiftConfig"),
    "symroid": ("saccade.keypoints.must_config", "SymRoidConfig"),
    "slam": ("saccade.slam", "EkfConfig"),
    "visual": ("saccade.visual", "VisualConfig"),
    "world": ("saccade.simulation", "WorldConfig"),
    "drive": ("saccade.simulation", "DriveConfig"),
}
"""Module and class of each kind of configuration."""

DEFAULT = "default"
"""Name of the preset of the default settings."""
FREE_VIEWING = "free_viewing"
"""Name of the preset of attention that shows where people look at a photograph."""
NONE = "none"
"""None in TOML, which has no null."""
MAX_INTEGER = 1 << 1023
"""Largest integer that a float can hold."""


def load_settings(kind: str, preset: str | None = None, path: Path | None = None) -> Any:
    """A preset, updated with the settings of a file.

    Args:
        kind: one of `KINDS`.
        preset: its name; None for the default.
        path: a TOML file as `saccade config` prints it.

    Raises:
        ConfigError: no such kind, preset or setting, or a value outside its range.
    """
    configuration = _configuration(kind)
    preset = DEFAULT if preset is None else preset
    presets = preset_names(kind)
    if preset not in presets:
        raise ConfigError(
            f"preset: expected one of {', '.join(presets)} for {kind}, found {preset!r}"
        )
    settings = configuration() if preset == DEFAULT else getattr(configuration, preset)()
    if path is None:
        return settings
    return update_settings(settings, read_toml(path, ConfigError), str(path))


def settings_from(kind: str, values: dict[str, Any], name: str) -> Any:
    """A configuration from a table of settings.

    Args:
        kind: one of `KINDS`.
        values: the settings; missing ones are the default.
        name: source of the table, for error messages.

    Raises:
        ConfigError: as `load_settings`.
    """
    return update_settings(load_settings(kind), values, name)


def load_model(path: str | Path) -> Any:
    """The model that `saccade fit` wrote.

    Args:
        path: its TOML file.

    Returns:
        A `saccade.attention.FittedModel`; its `maps(image)` has the saliency.

    Raises:
        ConfigError: as `load_settings`.
    """
    model = import_module("saccade.attention.fitted").FittedModel()
    return update_settings(model, read_toml(Path(path), ConfigError), str(path))


def preset_names(kind: str) -> list[str]:
    """The names of the presets of a kind, the default first."""
    configuration = _configuration(kind)
    names = (name for name, value in vars(configuration).items() if isinstance(value, classmethod))
    return [DEFAULT, *names]


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


def as_toml(settings: Any) -> str:
    """A configuration as TOML, with "none" for None."""
    import tomli_w

    return tomli_w.dumps(_table(settings))


def presets_as_toml(kind: str) -> str:
    """All presets of a kind as TOML, a table each."""
    import tomli_w

    return tomli_w.dumps({name: _table(load_settings(kind, name)) for name in preset_names(kind)})


def _table(settings: Any) -> dict[str, Any]:
    def without_none(items: list[tuple[str, Any]]) -> dict[str, Any]:
        return {name: NONE if value is None else value for name, value in items}

    return asdict(settings, dict_factory=without_none)


def _configuration(kind: str) -> Any:
    if kind not in KINDS:
        raise ConfigError(f"kind: expected one of {', '.join(KINDS)}, found {kind!r}")
    module, name = KINDS[kind]
    return getattr(import_module(module), name)


def update_settings(settings: Any, values: dict[str, Any], source: str) -> Any:
    """A configuration with the values of a table, whose source the errors name.

    Raises:
        ConfigError: no table, no such setting, or a value outside its range.
    """
    if not isinstance(values, dict):
        raise ConfigError(f"{source}: expected a table of settings, found {values!r}")
    names = [field.name for field in fields(settings)]
    unknown = sorted(set(values) - set(names))
    if unknown:
        expected = f"any of {', '.join(names)}"
        if DEFAULT in unknown:
            expected = "a single preset, as saccade config --preset prints it"
        raise ConfigError(f"{source}: no setting {unknown[0]!r}; expected {expected}")
    hints = get_type_hints(type(settings))
    changes = {
        name: _optional(value, hints[name], getattr(settings, name), f"{source}: {name}")
        for name, value in values.items()
    }
    try:
        return replace(settings, **changes)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def _optional(value: Any, hint: Any, current: Any, name: str) -> Any:
    """`value` converted to the type of its field, or None where the type allows it."""
    options = get_args(hint)
    if NoneType not in options:
        return _converted(value, current, name)
    if value is None or value == NONE:
        return None
    return _converted(value, options[0]() if current is None else current, name)


def _converted(value: Any, example: Any, name: str) -> Any:
    """`value` converted to the type of `example`: TOML has lists for tuples, and 1 for 1.0."""
    if is_dataclass(example):
        return update_settings(example, value, name)
    if isinstance(example, tuple) and isinstance(value, list):
        return tuple(_converted(each, example[0], name) if example else each for each in value)
    if type(example) is float and type(value) is int and abs(value) <= MAX_INTEGER:
        return float(value)
    if type(value) is not type(example):
        raise ConfigError(f"{name}: expected {type(example).__name__}, found {value!r}")
    return value
