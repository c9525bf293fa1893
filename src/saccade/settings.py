"""Configurations from presets and TOML files."""

import tomllib
from dataclasses import asdict, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from saccade.errors import ConfigError
from saccade.files import read_text

KINDS = {
    "attention": ("saccade.attention.combined", "AttentionConfig"),
    "contrast": ("saccade.attention.contrast", "ContrastConfig"),
    "symmetry": ("saccade.attention.symmetry_config", "SymmetryConfig"),
    "scanpath": ("saccade.attention.scanpath", "ScanpathConfig"),
    "must": ("saccade.keypoints.must_config", "MustConfig"),
    "sift": ("saccade.keypoints.sift_config", "SiftConfig"),
    "symroid": ("saccade.keypoints.symroid_config", "SymRoidConfig"),
    "slam": ("saccade.slam", "EkfConfig"),
    "visual": ("saccade.visual", "VisualConfig"),
    "world": ("saccade.simulation", "WorldConfig"),
    "drive": ("saccade.simulation", "DriveConfig"),
}
"""Where the configuration of each kind lives."""

DEFAULT = "default"
NONE = "none"
"""None, in TOML, which has no null."""
LARGEST = 1 << 1023
"""Whole number that a float can hold."""


def load_settings(kind: str, preset: str | None = None, path: Path | None = None) -> Any:
    """A configuration: a preset, with the settings of a file on top.

    Args:
        kind: one of `KINDS`.
        preset: its name; None or "default" for the defaults.
        path: a TOML file as `saccade config` prints it.

    Raises:
        ConfigError: no such kind, preset or setting, or a value outside its range.
    """
    settings = _named(kind, preset or DEFAULT)
    if path is None:
        return settings
    return _changed(settings, _read_toml(path), str(path))


def settings_from(kind: str, values: dict[str, Any], name: str) -> Any:
    """A configuration of a kind from a table of its settings; `name` is what holds the table.

    Raises:
        ConfigError: as those of `load_settings`.
    """
    return _changed(_named(kind, DEFAULT), values, name)


def preset_names(kind: str) -> list[str]:
    """The names of the presets of a kind, the default first."""
    return [DEFAULT, *_presets(_configuration(kind))]


def as_toml(settings: Any) -> str:
    """A configuration as TOML, with "none" for None."""
    import tomli_w

    return tomli_w.dumps(asdict(settings, dict_factory=_with_none))


def presets_as_toml(kind: str) -> str:
    """Every preset of a kind, a table each."""
    import tomli_w

    return tomli_w.dumps(
        {name: asdict(_named(kind, name), dict_factory=_with_none) for name in preset_names(kind)}
    )


def _with_none(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: NONE if value is None else value for name, value in items}


def _configuration(kind: str) -> Any:
    if kind not in KINDS:
        raise ConfigError(f"kind: expected one of {', '.join(KINDS)}, found {kind!r}")
    module, name = KINDS[kind]
    return getattr(import_module(module), name)


def _presets(configuration: type) -> list[str]:
    return [name for name, value in vars(configuration).items() if isinstance(value, classmethod)]


def _named(kind: str, preset: str) -> Any:
    configuration = _configuration(kind)
    if preset == DEFAULT:
        return configuration()
    if preset not in _presets(configuration):
        raise ConfigError(
            f"preset: expected one of {', '.join(preset_names(kind))} for {kind}, found {preset!r}"
        )
    return getattr(configuration, preset)()


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"{path}: expected TOML: {error}") from error


def _changed(settings: Any, values: dict[str, Any], name: str) -> Any:
    """A configuration with the values of a table on top; `name` is that of the table."""
    names = [field.name for field in fields(settings)]
    unknown = sorted(set(values) - set(names))
    if unknown:
        raise ConfigError(f"{name}: no setting {unknown[0]!r}; expected any of {', '.join(names)}")
    hints = get_type_hints(type(settings))
    changes = {
        each: _optional(value, hints[each], getattr(settings, each), f"{name}: {each}")
        for each, value in values.items()
    }
    try:
        return replace(settings, **changes)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from error


def _optional(value: Any, hint: Any, current: Any, name: str) -> Any:
    """`value` in the type of its field, which may be None where the field's type allows it."""
    options = get_args(hint)
    if NoneType not in options:
        return _like(value, current, name)
    if value is None or value == NONE:
        return None
    return _like(value, options[0]() if current is None else current, name)


def _like(value: Any, model: Any, name: str) -> Any:
    """`value` in the type of `model`: TOML has lists for tuples and may write 1 for 1.0."""
    if is_dataclass(model) and isinstance(value, dict):
        return _changed(model, value, name)
    if isinstance(model, tuple) and isinstance(value, list):
        return tuple(_like(each, model[0], name) if model else each for each in value)
    if type(model) is float and type(value) is int and abs(value) <= LARGEST:
        return float(value)
    if type(value) is not type(model):
        raise ConfigError(f"{name}: expected {type(model).__name__}, found {value!r}")
    return value
