"""Validation of measurements, for records, readers and the steps of a filter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, LogError


def check_arrays(
    record: Any,
    shapes: Mapping[str, tuple[int, ...]],
    ascending: Sequence[str],
    error: type[LogError | DriveError],
) -> None:
    """Raise `error` unless the arrays of a named record have these shapes and are finite.

    Args:
        record: has a `name`, for the message.
        shapes: by name of the array.
        ascending: names of those that must not decrease.
        error: to raise.
    """
    for name, shape in shapes.items():
        array = getattr(record, name)
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "iuf":
            found = " ".join(repr(array).split())[:60]
            raise error(f"{record.name}: {name}: expected an array of numbers, found {found}")
        if array.shape != shape:
            raise error(f"{record.name}: {name}: expected shape {shape}, found {array.shape}")
        if not np.isfinite(array).all():
            raise error(f"{record.name}: {name}: expected finite numbers, found NaN")
    for name in ascending:
        decreases = np.diff(getattr(record, name)) < 0
        if decreases.any():
            entry = int(np.argmax(decreases)) + 1
            raise error(f"{record.name}: {name}: goes back at entry {entry}; sort by {name}")


def invalid_range_bearing(z: npt.NDArray[np.float64]) -> tuple[int, str, str] | None:
    """The first of observations (k, 2) that is no range and bearing, with what was expected.

    Returns:
        Its number, what was expected and what was found; None if all are valid.
    """
    for k, (distance, bearing) in enumerate(z.tolist()):
        if distance < 0:
            return k, "a range of 0 m or more", f"{distance:g}"
        if abs(bearing) > 2 * np.pi:
            hint = "degrees? Multiply bearings, turns and headings by pi / 180"
            return k, "a bearing in radians, within 2 pi", f"{bearing:g}: {hint}"
    return None
