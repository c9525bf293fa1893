"""The fields of interest points, checked wherever they come in or go out."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.files import one_line, open_file
from saccade.types import Keypoints

UNKNOWN_SIZE = 2.0
"""Pixels, of points that come without a size: a scale of 1, as COLMAP has it."""


def keypoints_from(
    source: str,
    xy: npt.ArrayLike,
    size: npt.ArrayLike | None = None,
    angle: npt.ArrayLike | None = None,
    response: npt.ArrayLike | None = None,
    octave: npt.ArrayLike | None = None,
    descriptors: npt.ArrayLike | None = None,
) -> Keypoints:
    """Points from their fields; what is not known is None.

    Args:
        source: what an error message names: a file, and an image in it.
        xy: (n, 2) image pixels.
        size: (n,) diameter in pixels; `UNKNOWN_SIZE` where it is not known.
        angle: (n,) radians; 0 where it is not known.
        response: (n,); 0 where it is not known.
        octave: (n,) whole numbers; 0 where it is not known.
        descriptors: (n, d), whole numbers from 0 to 255.

    Raises:
        KeypointsError: shapes that do not fit together, NaN, or numbers out of range.
    """
    places = np.asarray(xy)
    if places.ndim != 2 or places.shape[1] != 2:
        raise KeypointsError(f"{source}: xy: expected shape (n, 2), found {places.shape}")
    n = len(places)
    return Keypoints(
        xy=_checked(source, "xy", places, (n, 2), np.float32),
        size=_column(source, "size", size, n, np.float32, UNKNOWN_SIZE),
        angle=_column(source, "angle", angle, n, np.float32, 0),
        response=_column(source, "response", response, n, np.float32, 0),
        octave=_column(source, "octave", octave, n, np.int32, 0),
        descriptors=None if descriptors is None else _bytes(source, np.asarray(descriptors), n),
    )


def checked(source: str, points: Keypoints) -> Keypoints:
    """The points in their proper dtypes; raises as `keypoints_from` does."""
    return keypoints_from(source, **vars(points))


def check_name(name: str) -> str:
    """The name of an image, if it is one that every format can hold.

    Raises:
        KeypointsError: it is empty, no text, or a path that starts or ends with a slash.
    """
    if not name or name != name.strip("/") or re.search(r"[\0\ud800-\udfff]", name):
        raise KeypointsError(f"image: expected a name such as folder/photo.jpg, found {name!r}")
    return name


@contextmanager
def reading(path: Path, expected: str, *errors: type[Exception]) -> Iterator[None]:
    """Turn what a library raises about a file into one line that names it.

    Args:
        path: the file.
        expected: what it should have been.
        errors: what the library raises besides OSError where the file is something else.

    Raises:
        KeypointsError: the file cannot be read, or is not what was expected.
    """
    try:
        with open_file(path):
            pass  # the libraries say the same in many words
    except IsADirectoryError:
        pass
    except OSError as error:
        raise KeypointsError(f"{path}: cannot be read: {error.strerror}") from error
    kinds: tuple[type[Exception], ...] = (OSError, *errors)
    try:
        yield
    except (KeypointsError, MemoryError):
        raise
    except kinds as error:
        raise KeypointsError(f"{path}: expected {expected}: {one_line(error)}") from error


def _column(
    source: str,
    name: str,
    values: npt.ArrayLike | None,
    count: int,
    dtype: npt.DTypeLike,
    default: float,
) -> npt.NDArray[Any]:
    if values is None:
        return np.full(count, default, dtype)
    return _checked(source, name, np.asarray(values), (count,), dtype)


def _checked(
    source: str, name: str, values: npt.NDArray[Any], shape: tuple[int, ...], dtype: npt.DTypeLike
) -> npt.NDArray[Any]:
    if values.shape != shape:
        raise KeypointsError(f"{source}: {name}: expected shape {shape}, found {values.shape}")
    if values.dtype.kind not in "fiu":
        raise KeypointsError(f"{source}: {name}: expected numbers, found {values.dtype}")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = np.array(values, dtype)
    # Of real numbers what float32 cannot hold is infinite; of whole ones it is another number.
    lost = ~np.isfinite(converted) if np.dtype(dtype).kind == "f" else converted != values
    if lost.any():
        worst = values[lost].flat[0]
        raise KeypointsError(f"{source}: {name}: expected {np.dtype(dtype)}, found {worst}")
    return converted


def _bytes(source: str, values: npt.NDArray[Any], count: int) -> npt.NDArray[np.uint8]:
    if values.ndim != 2 or len(values) != count:
        raise KeypointsError(
            f"{source}: descriptors: expected shape ({count}, d), found {values.shape}"
        )
    if values.dtype == np.uint8:
        return np.array(values)
    if values.dtype.kind not in "fiu":
        raise KeypointsError(f"{source}: descriptors: expected numbers, found {values.dtype}")
    with np.errstate(invalid="ignore"):
        converted = values.astype(np.uint8)
    if (converted != values).any():
        worst = values[converted != values].flat[0]
        raise KeypointsError(
            f"{source}: descriptors: expected whole numbers from 0 to 255, found {worst}"
        )
    return converted
