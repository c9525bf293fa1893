"""Configurations from presets and TOML files."""

from dataclasses import asdict, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

from saccade.errors import ConfigError, require
from saccade.io.files import read_toml

KINDS = {
    "scanpath": ("saccade.attention.scanpath", "ScanpathConfig"),
    "scanpath-model": ("saccade.attention.scanpath_model", "ScanpathModelConfig"),
    "slam": ("saccade.slam", "EkfConfig"),
    "visual": ("saccade.visual", "VisualConfig"),
    "world": ("saccade.simulation", "WorldConfig"),
    "drive": ("saccade.simulation", "DriveConfig"),
}
"""Module and class of the kinds of configurations that are in no table."""
TABLES = {"saccade.attention.models": "MODELS", "saccade.keypoints.detectors": "DETECTORS"}
"""Module and name of the tables whose rows have a class of `settings`; their names are kinds."""

DEFAULT = "default"
"""Name of the preset of the default settings."""
FREE_VIEWING = "free_viewing"
"""Name of the attention preset for photographs viewed by people."""
NONE = "none"
"""Representation of None in TOML, which has no null."""


def load_settings(kind: str, preset: str | None = None, path: Path | None = None) -> Any:
    """A preset, updated with the settings of a file.

    Args:
        kind: one of `kinds()`.
        preset: name of the preset; None for the default.
        path: a TOML file, as printed by `saccade config`.

    Raises:
        ConfigError: unknown kind, preset or setting, or a value out of range.
    """
    configuration = _configuration(kind)
    preset = DEFAULT if preset is None else preset
    presets = preset_names(kind)
    require(preset in presets, "preset", f"one of {', '.join(presets)} for {kind}", preset)
    settings = configuration() if preset == DEFAULT else getattr(configuration, preset)()
    if path is None:
        return settings
    return update_settings(settings, read_toml(path, ConfigError), str(path))


def settings_from(kind: str, values: dict[str, Any], source: str) -> Any:
    """The default configuration of a kind with the settings of a table, as `update_settings`."""
    return update_settings(load_settings(kind), values, source)


def load_model(path: str | Path) -> Any:
    """The `saccade.attention.FittedModel` that `saccade fit` wrote.

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


def field_help(configuration: type) -> dict[str, str]:
    """The docstring of each field of a class; empty where its source is not installed."""
    from docstring_parser import parse_from_object

    return {
        each.arg_name: " ".join((each.description or "").split())
        for parent in reversed(configuration.__mro__[:-1])
        for each in parse_from_object(parent).params
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
    def writable(items: list[tuple[str, Any]]) -> dict[str, Any]:
        return {name: _text(value) for name, value in items}

    return asdict(settings, dict_factory=writable)


def _text(value: Any) -> Any:
    """The value for TOML: "none" for None, and module:function for a function."""
    if callable(value):
        return f"{value.__module__}:{value.__qualname__}"
    return NONE if value is None else value


def kinds() -> list[str]:
    """Names of the kinds of configurations."""
    tables = (getattr(import_module(module), name) for module, name in TABLES.items())
    return [*(kind for table in tables for kind in table), *KINDS]


def _configuration(kind: str) -> Any:
    if kind in KINDS:
        module, name = KINDS[kind]
        return getattr(import_module(module), name)
    for module, name in TABLES.items():
        if kind in (table := getattr(import_module(module), name)):
            return table[kind].settings
    raise ConfigError(f"kind: expected one of {', '.join(kinds())}, found {kind!r}")


def update_settings(settings: Any, values: Any, source: str) -> Any:
    """Updates a configuration with the values of a table, in which "none" means None.

    Args:
        settings: a `Settings`, or a dataclass of several.
        values: the table.
        source: its name, for error messages.

    Raises:
        ConfigError: not a table, an unknown setting, or a value out of range.
    """
    require(isinstance(values, dict), source, "a table of settings", values)
    kinds = get_type_hints(type(settings))
    unknown = sorted(set(values) - set(kinds))
    if unknown:
        expected = f"any of {', '.join(kinds)}"
        if DEFAULT in unknown:
            expected = "a single preset, as saccade config --preset prints it"
        raise ConfigError(f"{source}: no setting {unknown[0]!r}; expected {expected}")
    changes = dict[str, Any]()
    for name, value in values.items():
        current = getattr(settings, name)
        if is_dataclass(current):
            changes[name] = update_settings(current, value, f"{source}: {name}")
        elif value == NONE and NoneType in get_args(kinds[name]):
            changes[name] = None
        else:
            changes[name] = value
    try:
        return replace(settings, **changes)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
