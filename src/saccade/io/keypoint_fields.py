"""Validation of the fields of keypoints, for input and output."""

import re
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.types import Keypoints


class Field(NamedTuple):
    """A numeric field with one value per point."""

    dtype: type[np.float32] | type[np.int32]
    default: float
    """Default value if the field is missing."""


MAX_BYTE = 255
FIELDS = {
    "size": Field(np.float32, 2.0),  # COLMAP's scale of 1
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
    """Validates and converts arrays to keypoints.

    Args:
        source: file and image, for error messages.
        xy: (n, 2) image pixels.
        descriptors: (n, d) numbers, or None. Whole numbers from 0 to 255 become bytes, other
            numbers float32.
        fields: (n,) size, angle, response and octave as in `Keypoints`. Missing fields, or None,
            take the defaults of `FIELDS`.

    Raises:
        KeypointsError: inconsistent shapes, NaN, or numbers out of range.
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
        numeric = rows.dtype.kind in "fiu" and rows.dtype != np.uint8
        whole = not numeric or bool(((rows >= 0) & (rows <= MAX_BYTE) & (rows % 1 == 0)).all())
        kind: type[Any] = np.uint8 if whole else np.float32
        columns["descriptors"] = _convert(source, "descriptors", rows, shape, kind)
    return Keypoints(xy=_convert(source, "xy", positions, (n, 2), np.float32), **columns)


def checked(source: str, points: Keypoints) -> Keypoints:
    """Converts points to the proper dtypes; raises as `keypoints_from`."""
    return keypoints_from(source, **vars(points))


def columns_of(points: Keypoints) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table of points: x, y and `FIELDS`."""
    x, y = points.xy.T
    return {"x": x, "y": y, **{name: getattr(points, name) for name in FIELDS}}


def check_name(name: str) -> str:
    """Validates the name of an image for all formats.

    Raises:
        KeypointsError: the name is empty, not text, or starts or ends with a slash.
    """
    if not name or name != name.strip("/") or re.search(r"[\0\ud800-\udfff]", name):
        raise KeypointsError(f"image: expected a name such as folder/photo.jpg, found {name!r}")
    return name


def _convert(
    source: str, name: str, values: npt.NDArray[Any], shape: tuple[int, ...], dtype: type[Any]
) -> npt.NDArray[Any]:
    """Converts values to a dtype that must be able to represent them."""
    if values.shape != shape:
        raise KeypointsError(f"{source}: {name}: expected shape {shape}, found {values.shape}")
    if values.dtype.kind not in "fiu":
        raise KeypointsError(f"{source}: {name}: expected numbers, found {values.dtype}")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = np.array(values, dtype)
    # A float that overflows float32 becomes infinite; an integer wraps around.
    lost = ~np.isfinite(converted) if dtype is np.float32 else converted != values
    if lost.any():
        found = values[lost].flat[0]
        raise KeypointsError(f"{source}: {name}: expected {np.dtype(dtype)}, found {found}")
    return converted
