"""Exceptions, and validated settings.

Every message names the file, line or argument, the expected value and the value found.
"""

from collections.abc import Iterable
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from math import inf
from numbers import Real
from types import NoneType, UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints


def printable(text: str) -> str:
    """The text in one line, with control characters escaped, as of a file name."""
    line = " ".join(text.splitlines())
    return "".join(c if c.isprintable() or c == " " else ascii(c)[1:-1] for c in line)


class SaccadeError(Exception):
    """Invalid input or failed output; the message is one line, whatever it quotes."""

    def __str__(self) -> str:
        return printable(super().__str__())


class ImageError(SaccadeError, ValueError):
    """Invalid image, or an image that the algorithm cannot use."""


class ImageWarning(UserWarning):
    """Image whose values are probably misinterpreted."""


class LogWarning(UserWarning):
    """Part of a landmark log that is left out or assumed."""


class KeypointsError(SaccadeError, ValueError):
    """Invalid interest points, or a file without them."""


class LogError(SaccadeError, ValueError):
    """Invalid landmark log, or unknown format."""


class DriveError(SaccadeError, ValueError):
    """Invalid camera drive, or unknown layout."""


class ConfigError(SaccadeError, ValueError):
    """Setting that is out of range or unknown."""


class OutputError(SaccadeError, OSError):
    """Result that cannot be written."""


def require(holds: bool, name: str, expected: str, found: object) -> None:
    """Raise `ConfigError` unless `holds`; `name` is the setting, `expected` its range."""
    if not holds:
        raise ConfigError(f"{name}: expected {expected}, found {found!r}")


@dataclass(frozen=True)
class Range:
    """An interval of numbers; infinity and NaN are outside unless an end is closed at infinity."""

    low: float = -inf
    high: float = inf
    closed: tuple[bool, bool] = (False, False)
    """Whether `low` and `high` belong to the interval."""

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
CHOICES = "choices"
"""Key of the table of the names that a field accepts in its metadata."""


def setting(
    default: Any = MISSING,
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    above: float = -inf,
    below: float = inf,
    choices: Iterable[str] = (),
) -> Any:
    """A field of `Settings` for a number in a range, None, a sequence of such numbers, or a name.

    Args:
        default: default value; without one the setting is required.
        minimum: smallest value.
        maximum: largest value.
        above: exclusive lower bound, in place of `minimum`.
        below: exclusive upper bound, in place of `maximum`.
        choices: names in the table of a kind, for pages that offer them; the class checks them,
            since functions may be accepted too.
    """
    low = above if minimum is None else minimum
    high = below if maximum is None else maximum
    closed = minimum is not None, maximum is not None
    metadata = {RANGE: Range(low, high, closed), CHOICES: tuple(choices)}
    return field(default=default, metadata=metadata)


class Settings:
    """Base class of frozen dataclasses with validated fields.

    Numbers are converted to the declared type and checked against the range, or for finiteness;
    lists become tuples.

    Raises:
        ConfigError: a value has the wrong type or is out of range.
    """

    def __post_init__(self) -> None:
        """Validates every field; subclasses add constraints between fields."""
        kinds = _declared_types(cast("Any", type(self)))
        for each in fields(cast("Any", self)):
            value, allowed = getattr(self, each.name), each.metadata.get(RANGE, Range())
            checked = _checked(value, kinds[each.name], each.name, allowed)
            object.__setattr__(self, each.name, checked)


NUMBERS = {int: "a whole number", float: "a number"}
"""Types of numbers in words."""


@cache
def _declared_types(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _checked(value: Any, kind: Any, name: str, allowed: Range) -> Any:
    """The value as its declared type `kind`, or a `ConfigError` that names the setting."""
    parts, origin = get_args(kind), get_origin(kind)
    if origin in (Union, UnionType):
        others = [each for each in parts if each is not NoneType]
        if len(others) == len(parts) or value is not None:
            return _checked(value, others[-1], name, allowed)  # names are followed by text
        return None
    if kind in (int, float):
        return _checked_number(value, kind, name, allowed)
    if origin is Literal:
        require(value in parts, name, " or ".join(map(repr, parts)), value)
    elif origin in (tuple, list):
        require(isinstance(value, tuple | list), name, "a list", value)
        kinds = parts[:1] * len(value) if origin is list or parts[-1] is ... else parts
        require(len(value) == len(kinds), name, f"{len(kinds)} values", value)
        return origin(
            _checked(item, each, name, allowed) for item, each in zip(value, kinds, strict=True)
        )
    elif isinstance(kind, type) and kind is not Any:
        require(isinstance(value, kind), name, kind.__name__, value)
    return value


def _checked_number(value: Any, kind: Any, name: str, allowed: Range) -> Any:
    """The number as its declared type; kernels are compiled for one type only."""
    try:
        is_number = not isinstance(value, bool) and isinstance(value, Real)
        number = kind(value) if is_number else None
    except (OverflowError, ValueError):  # infinite, NaN, or an integer too large for a float
        number = None
    if number is None or (kind is int and number != value):
        raise ConfigError(f"{name}: expected {NUMBERS[kind]}, found {value!r}")
    require(number in allowed, name, str(allowed), value)
    return number
