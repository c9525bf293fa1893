"""Exceptions, and checks of settings that raise them.

Every message names the file, line or argument, what was expected and what was found.
"""

from dataclasses import fields
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, get_args, get_origin


class SaccadeError(Exception):
    """Invalid input or failed output; the message is one line."""


class ImageError(SaccadeError, ValueError):
    """Not an image, or one that the algorithm cannot use."""


class ImageWarning(UserWarning):
    """An image that is probably not meant as it is read."""


class LogWarning(UserWarning):
    """A part of a landmark log that is left out or assumed."""


class KeypointsError(SaccadeError, ValueError):
    """Interest points that cannot be used, or a file that does not hold them."""


class LogError(SaccadeError, ValueError):
    """A landmark log that is invalid or of another format."""


class DriveError(SaccadeError, ValueError):
    """A camera drive that is invalid or of another layout."""


class ConfigError(SaccadeError, ValueError):
    """A setting outside its range, or an unknown one."""


class OutputError(SaccadeError, OSError):
    """A result that could not be written."""


def require(holds: bool, name: str, expected: str, found: object) -> None:
    """Raise `ConfigError` unless `holds`; `name` is the setting, `expected` its range."""
    if not holds:
        raise ConfigError(f"{name}: expected {expected}, found {found!r}")


def require_types(config: Any) -> None:
    """Raise `ConfigError` unless numbers and choices of a dataclass are of their declared types.

    Whole numbers become of the declared type: a kernel would be compiled for either.
    """
    for field in fields(config):
        value, options = getattr(config, field.name), get_args(field.type)
        optional = NoneType in options
        kind = options[0] if optional else field.type
        if optional and value is None:
            continue
        if kind is int:
            whole = isinstance(value, Real) and (
                isinstance(value, Integral) or float(value).is_integer()
            )
            require(whole, field.name, "a whole number", value)
            object.__setattr__(config, field.name, int(value))
        elif kind is float:
            require(isinstance(value, Real), field.name, "a number", value)
            object.__setattr__(config, field.name, float(value))
        elif get_origin(kind) is Literal:
            choices = get_args(kind)
            require(value in choices, field.name, " or ".join(map(repr, choices)), value)


def require_ranges(config: Any, **ranges: tuple[float, float]) -> None:
    """Raise `ConfigError` unless settings, by name, lie between a minimum and a maximum."""
    for name, (low, high) in ranges.items():
        value = getattr(config, name)
        require(low <= value <= high, name, f"{low} to {high}", value)
