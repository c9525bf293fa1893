"""Maps from files and from other models: their values, channels and aspect.

Other programs write saliency, densities and log densities, as gray pictures or as numbers, and some
write pictures with a color map, exchange height and width, or keep the bars of a network's input.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, require
from saccade.types import Float32Array, FloatArray

KINDS = ("saliency", "density", "log-density")
"""Kinds of values of a map: of any scale, nonnegative, or natural logarithms of a density."""
MAX_SALIENCY = 1e15
"""Maximum magnitude in a map, for which sums of squares stay finite in float32."""
GRAY = 0.01
"""Maximum difference of the channels of a gray picture, as a fraction of its range: JPEG's."""
SUM = 0.02
"""Maximum error of the sum of the exponentials of a log density."""
SAME_ASPECT = 0.02
"""Maximum relative difference of the aspects of a map and of its image."""
FLAT_BAR = 0.02
"""Maximum range of the values in a bar, as a fraction of the range of the map."""


def as_saliency(
    values: Any, name: str, image_shape: tuple[int, int] | None = None, kind: str | None = None
) -> Float32Array:
    """The map of another program as saliency.

    Args:
        values: (h, w), or (h, w, 3) with equal channels, or (h, w, 4) opaque; numbers.
        name: name of the map, for error messages.
        image_shape: (H, W) of the image, whose aspect the map must have; None for any.
        kind: one of `KINDS`; None for a log density if no value is above 0 and the exponentials sum
            to 1, else saliency.

    Returns:
        (h, w), linear in the density of a density or log density.

    Raises:
        ImageError: no map, a picture in colors, not finite, or another aspect than the image.
        ConfigError: unknown kind.
    """
    require(kind in (None, *KINDS), "kind", f"one of {', '.join(KINDS)}", kind)
    array = single_channel(values, name)
    if kind == "log-density" or (kind is None and is_log_density(array)):
        array = np.exp(array.astype(np.float64) - float(array.max()))
    found = "NaN or others" if np.isnan(array).any() else f"{array.min():g} to {array.max():g}"
    if not (np.abs(array.astype(np.float64)) < MAX_SALIENCY).all():
        expected = f"{name}: expected finite numbers of shape (h, w) under {MAX_SALIENCY:g}"
        raise ImageError(f"{expected}, found {found}")
    if kind == "density" and (array.min() < 0 or array.max() <= 0):
        raise ImageError(f"{name}: expected a density of numbers from 0, found {found}")
    if image_shape is not None:
        check_aspect(array, name, image_shape)
    return array.astype(np.float32)


def is_log_density(array: npt.NDArray[Any]) -> bool:
    """Whether no value is above 0 and the exponentials sum to 1."""
    if array.dtype.kind != "f" or not array.max() <= 0 or array.size < 2:
        return False
    return bool(abs(float(np.exp(array.astype(np.float64)).sum()) - 1) < SUM)


def single_channel(values: Any, name: str) -> npt.NDArray[Any]:
    """The values of a map as (h, w)."""
    expected = f"{name}: expected finite numbers of shape (h, w)"
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise ImageError(f"{expected}: {error}") from error
    if array.ndim > 3 or (array.ndim == 3 and 1 in array.shape):
        array = array.reshape([side for side in array.shape if side != 1] or [1])
    numeric = array.dtype.kind in "buif" and array.size > 0
    if numeric and array.ndim == 3 and array.shape[2] in (2, 3, 4):
        return _gray(array, name)
    if not numeric or array.ndim != 2:
        raise ImageError(f"{expected}, found {array.dtype} of shape {array.shape}")
    return array


def _gray(array: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
    """The channel of a gray picture (h, w, 2 to 4), opaque if it has an alpha channel."""
    colors, numbers = array, array.astype(np.float64)
    if array.shape[2] in (2, 4):
        if np.ptp(array[..., -1]) > 0:
            raise ImageError(
                f"{name}: expected a map of one channel, found one with transparent pixels; save "
                "the values themselves as .npy or as a gray image without alpha"
            )
        colors, numbers = array[..., :-1], numbers[..., :-1]
    apart = np.ptp(numbers, axis=2).max()
    top = 255.0 if array.dtype == np.uint8 else max(float(np.ptp(numbers)), 1e-12)
    if apart > GRAY * top:
        raise ImageError(
            f"{name}: expected a map of one channel, found a picture in colors, probably with a "
            "color map such as jet; save the values themselves as .npy or as a gray image"
        )
    return np.asarray(colors[..., 0])


def check_aspect(array: npt.NDArray[Any], name: str, image_shape: tuple[int, int]) -> None:
    """Rejects a map (h, w) of another aspect than its image (H, W), with the likely cause."""
    (h, w), (height, width) = array.shape, image_shape[:2]
    if has_aspect((h, w), (height, width)):
        return
    cause = "resize it to the image"
    if bars := letterbox(array, (height, width)):
        top, bottom, left, right = bars
        cause = (
            "it has the bars of a letterbox around the image; crop it to rows "
            f"{top} to {bottom - 1} and columns {left} to {right - 1}"
        )
    elif has_aspect((w, h), (height, width)):
        cause = "height and width are exchanged; transpose it"
    expected = f"the aspect of the image of {width} x {height}"
    raise ImageError(f"{name}: expected {expected}, found a map of {w} x {h}: {cause}")


def has_aspect(shape: tuple[int, int], image_shape: tuple[int, int]) -> bool:
    """Whether a map (h, w) has the aspect of an image (H, W), to 2 % or a cell."""
    (h, w), (height, width) = shape, image_shape
    across, down = h * width / height, w * height / width
    near = abs(across / w - 1) <= SAME_ASPECT
    return near or abs(across - w) <= 1 or abs(down - h) <= 1


def letterbox(
    array: npt.NDArray[Any], image_shape: tuple[int, int]
) -> tuple[int, int, int, int] | None:
    """Top, bottom, left and right of an image (H, W) between flat bars in a map; None without."""
    (h, w), (height, width) = array.shape, image_shape
    scale = min(h / height, w / width)
    rows, columns = round(height * scale), round(width * scale)
    top, left = (h - rows) // 2, (w - columns) // 2
    values: FloatArray = array.astype(np.float64)
    limit = FLAT_BAR * max(float(np.ptp(values)), 1e-12)
    sides = (values[: max(top - 1, 0)], values[top + rows + 1 :])
    if columns < w:
        sides = (values[:, : max(left - 1, 0)], values[:, left + columns + 1 :])
    bars = [each for each in sides if each.size]
    if not bars or any(float(np.ptp(each)) > limit for each in bars):
        return None
    return top, top + rows, left, left + columns
