"""Exceptions, and checks of settings that raise them.

Every message names the file, line or argument, what was expected and what was found.
"""

from dataclasses import dataclass, field, fields
from math import inf
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, cast, get_args, get_origin


class SaccadeError(Exception):
    """Invalid input or failed output; the message is one line, whatever it quotes."""

    def __str__(self) -> str:
        return " ".join(super().__str__().splitlines())


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


@dataclass(frozen=True)
class Range:
    """Values that a number may have."""

    low: float
    """Smallest value, or the one that all are above."""
    high: float
    """Largest value, or the one that all are below."""
    closed: tuple[bool, bool]
    """Whether `low` and `high` are values themselves."""

    def __contains__(self, value: float) -> bool:
        above = self.low <= value if self.closed[0] else self.low < value
        return above and (value <= self.high if self.closed[1] else value < self.high)

    def __str__(self) -> str:
        if self.closed == (True, True):
            return f"{self.low:g} to {self.high:g}"
        low = f"at least {self.low:g}" if self.closed[0] else f"above {self.low:g}"
        high = f"at most {self.high:g}" if self.closed[1] else f"below {self.high:g}"
        return " and ".join([low] * (self.low > -inf) + [high] * (self.high < inf)) or "finite"


RANGE = "range"
"""Key of the `Range` in the metadata of a field."""


def setting(
    default: Any,
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    above: float = -inf,
    below: float = inf,
) -> Any:
    """A field of `Settings` for a number, or None, or a tuple of numbers, in a range.

    Args:
        default: its value.
        minimum: smallest value.
        maximum: largest value.
        above: in place of `minimum`, a value that is itself too small.
        below: in place of `maximum`, a value that is itself too large.
    """
    low = above if minimum is None else minimum
    high = below if maximum is None else maximum
    closed = minimum is not None, maximum is not None
    return field(default=default, metadata={RANGE: Range(low, high, closed)})


class Settings:
    """Base of dataclasses whose fields have the types and ranges that they declare.

    Whole numbers become of the declared type: a kernel would be compiled for either.

    Raises:
        ConfigError: a value of another type or outside its range.
    """

    def __post_init__(self) -> None:
        """Check every field; a class adds what concerns several of them together."""
        for each in fields(cast("Any", self)):
            value, options = getattr(self, each.name), get_args(each.type)
            optional = NoneType in options
            kind = options[0] if optional else each.type
            if optional and value is None:
                continue
            if kind is int:
                whole = isinstance(value, Real) and (
                    isinstance(value, Integral) or float(value).is_integer()
                )
                require(whole, each.name, "a whole number", value)
                object.__setattr__(self, each.name, int(value))
            elif kind is float:
                require(isinstance(value, Real), each.name, "a number", value)
                object.__setattr__(self, each.name, float(value))
            elif get_origin(kind) is Literal:
                choices = get_args(kind)
                require(value in choices, each.name, " or ".join(map(repr, choices)), value)
            allowed = each.metadata.get(RANGE)
            if allowed is None:
                continue
            count = len(get_args(kind)) if get_origin(kind) is tuple else None
            numbers = (value,) if count is None else value
            if len(numbers) != (count or 1) or not all(number in allowed for number in numbers):
                words = f"{allowed}, or none" if optional else str(allowed)
                words = words if count is None else f"{count} numbers, {words}"
                require(False, each.name, words, value)
