"""Parameters of the textbook that can be changed without editing a copy of it."""

import ast
import re
from collections.abc import Iterable
from types import ModuleType
from typing import Any, NamedTuple

from saccade.errors import ConfigError, require


class Parameter(NamedTuple):
    """A constant of a textbook file, with its range."""

    constant: str
    low: float
    high: float


PARAMETERS: dict[str, dict[str, Parameter]] = {
    "contrast": {
        "center": Parameter("CENTER", 0, 4),
        "delta": Parameter("DELTA", 1, 4),
        "wavelength": Parameter("WAVELENGTH", 2, 20),
        "sigma": Parameter("SIGMA", 0.5, 7),
        "phase": Parameter("PHASE", -4, 4),
        "map_level": Parameter("MAP_LEVEL", 1, 6),
    },
    "sift": {
        "s": Parameter("S", 1, 8),
        "octaves": Parameter("OCTAVES", 1, 8),
        "tau_c": Parameter("TAU_C", 0, 1),
        "tau_r": Parameter("TAU_R", 1, 100),
        "base_sigma": Parameter("BASE_SIGMA", 0.5, 5),
    },
}
"""Parameters of each system by name."""
NAMES = [f"{system}.{name}" for system, table in PARAMETERS.items() for name in table]
"""Names as in --set."""


def parse_changes(texts: Iterable[str]) -> dict[str, dict[str, str]]:
    """Changed parameters of each system, from texts such as "contrast.delta=2,3".

    Raises:
        ConfigError: unknown name.
    """
    changes: dict[str, dict[str, str]] = {system: {} for system in PARAMETERS}
    for text in texts:
        name, _, value = text.partition("=")
        require(name in NAMES, "set", f"NAME=VALUE with one of {', '.join(NAMES)}", text)
        system, _, parameter = name.partition(".")
        changes[system][parameter] = value
    return changes


def changed_source(source: str, system: str, changes: dict[str, str]) -> str:
    """The source of a textbook file with other values of its constants.

    Args:
        source: Python.
        system: "contrast" or "sift".
        changes: values by parameter, as texts.

    Raises:
        ConfigError: a value of the wrong type, or outside its range.
    """
    for name, text in changes.items():
        constant, low, high = PARAMETERS[system][name]
        pattern = re.compile(rf"^{constant} = (.*?)(?=\s*(?:#.*)?$)", re.MULTILINE)
        (printed,) = pattern.findall(source)
        value = _value(text, ast.literal_eval(printed), low, high)
        if value is None:
            raise ConfigError(
                f"set: {system}.{name}: expected a value such as {printed}, "
                f"from {low:g} to {high:g}, found {text!r}"
            )
        source = pattern.sub(f"{constant} = {value!r}", source)
    return source


def _value(text: str, printed: Any, low: float, high: float) -> Any:
    """The value with the type of the printed one; None if it has another type, or is too large."""
    kind = type(printed[0] if isinstance(printed, tuple) else printed)
    try:
        values = tuple(kind(part) for part in text.strip("() ").split(","))
    except ValueError:
        return None
    if not all(low <= each <= high for each in values):
        return None
    if isinstance(printed, tuple):
        return values
    return values[0] if len(values) == 1 else None


def load_module(source: str, file: str) -> ModuleType:
    """The source of a textbook file as a module, which `saccade.textbook` is not affected by."""
    module = ModuleType(f"saccade.textbook.{file.removesuffix('.py')}")
    exec(compile(source, file, "exec"), module.__dict__)
    return module
