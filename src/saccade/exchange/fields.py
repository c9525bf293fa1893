"""The fields of keypoints, checked wherever they come in or go out."""

import re
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.types import Keypoints


class Field(NamedTuple):
    """A field with a number for every point."""

    dtype: type[np.float32] | type[np.int32]
    default: float
    """Value of points that come without it."""


FIELDS = {
    "size": Field(np.float32, 2.0),  # a scale of 1, as COLMAP has it
    "angle": Field(np.float32, 0),
    "response": Field(np.float32, 0),
    "octave": Field(np.int32, 0),
}
"""The fields of `Keypoints` beside `xy` and `descriptors`."""


def keypoints_from(
    source: str,
    xy: npt.ArrayLike,
    descriptors: npt.ArrayLike | None = None,
    **fields: npt.ArrayLike | None,
) -> Keypoints:
    """Keypoints from arrays, checked and converted.

    Args:
        source: for error messages: a file, and an image in it.
        xy: (n, 2) image pixels.
        descriptors: (n, d) whole numbers from 0 to 255, or None.
        fields: (n,) each; size, angle, response and octave as in `Keypoints`. A field that is
            missing or None has the default of `FIELDS`.

    Raises:
        KeypointsError: shapes that do not fit together, NaN, or numbers out of range.
    """
    positions = np.asarray(xy)
    if positions.ndim != 2 or positions.shape[1] != 2:
        raise KeypointsError(f"{source}: xy: expected shape (n, 2), found {positions.shape}")
    n = len(positions)
    columns = {}
    for name, (dtype, default) in FIELDS.items():
        values = fields.get(name)
        filled = np.full(n, default) if values is None else np.asarray(values)
        columns[name] = _convert(source, name, filled, (n,), dtype)
    if descriptors is not None:
        rows = np.asarray(descriptors)
        shape = (n, rows.shape[1] if rows.ndim == 2 else 128)
        columns["descriptors"] = _convert(source, "descriptors", rows, shape, np.uint8)
    return Keypoints(xy=_convert(source, "xy", positions, (n, 2), np.float32), **columns)


def checked(source: str, points: Keypoints) -> Keypoints:
    """The points in their proper dtypes; raises as `keypoints_from` does."""
    return keypoints_from(source, **vars(points))


def columns_of(points: Keypoints) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of points: x, y and `FIELDS`."""
    x, y = points.xy.T
    return {"x": x, "y": y, **{name: getattr(points, name) for name in FIELDS}}


def check_name(name: str) -> str:
    """The name of an image, checked to be one that every format can hold.

    Raises:
        KeypointsError: it is empty, no text, or a path that starts or ends with a slash.
    """
    if not name or name != name.strip("/") or re.search(r"[\0\ud800-\udfff]", name):
        raise KeypointsError(f"image: expected a name such as folder/photo.jpg, found {name!r}")
    return name


def _convert(
    source: str, name: str, values: npt.NDArray[Any], shape: tuple[int, ...], dtype: type[Any]
) -> npt.NDArray[Any]:
    """The values in a dtype that must hold them."""
    if values.shape != shape:
        raise KeypointsError(f"{source}: {name}: expected shape {shape}, found {values.shape}")
    if values.dtype.kind not in "fiu":
        raise KeypointsError(f"{source}: {name}: expected numbers, found {values.dtype}")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = np.array(values, dtype)
    # A real number that overflows float32 becomes infinite, a whole one another number.
    lost = ~np.isfinite(converted) if dtype is np.float32 else converted != values
    if lost.any():
        expected = "whole numbers from 0 to 255" if dtype is np.uint8 else np.dtype(dtype)
        raise KeypointsError(f"{source}: {name}: expected {expected}, found {values[lost].flat[0]}")
    return converted
