"""Images as detectors need them: transparent pixels as a mask, and contrast over thresholds."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, ImageWarning, require
from saccade.io.image import (
    InBlocks,
    as_gray,
    check_image,
    in_turn,
    in_unit_range,
    repeat_gray,
)
from saccade.types import BoolArray, Float32Array, Image

OPAQUE = 0.5
"""Smallest opacity of a pixel that is part of an image."""
PERCENTILES = (0.5, 99.5)
"""Percentiles that a stretched image has at 0 and 1."""
STEP = 4
"""Distance of the pixels whose percentiles are taken, for images of more than `MANY` pixels."""
MANY = 100_000
DEFECTS = 4
"""Number of the darkest and of the brightest pixels that may be defects of the sensor."""


@contextmanager
def warnings_of(name: str) -> Iterator[None]:
    """Issues the warnings of a block with the name of the image."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ImageWarning)
        yield
    for each in caught:
        text = str(each.message).removeprefix("image: ")
        named = text if text.startswith(f"{name}: ") else f"{name}: {text}"
        warnings.warn(named, each.category, stacklevel=3)


def opaque_part(image: Image) -> tuple[Image, BoolArray | None]:
    """The image without its alpha channel, and where it is opaque.

    Each transparent pixel gets the color of the nearest opaque one, so that the rim of a cut-out is
    no edge.

    Args:
        image: see `saccade.types.Image`.

    Returns:
        (H, W) or (H, W, 3), and (H, W); None for an image without transparent pixels.
    """
    pixels = np.asarray(image)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or not pixels.size:
        return image, None
    full = 1.0 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max
    opaque: BoolArray = pixels[:, :, 3] >= OPAQUE * full
    colors = np.ascontiguousarray(pixels[:, :, :3])
    if opaque.all():
        return colors, None
    if not opaque.any():
        return np.zeros_like(colors), opaque
    from scipy import ndimage

    rows, columns = ndimage.distance_transform_edt(
        ~opaque, return_distances=False, return_indices=True
    )
    return colors[rows, columns], opaque


def gray_and_mask(
    image: Image, mask: npt.ArrayLike | None, run_in_blocks: InBlocks = in_turn
) -> tuple[Float32Array, BoolArray]:
    """(H, W) gray in [0, 1], and where both a mask and the alpha channel allow points.

    Args:
        image: see `saccade.types.Image`.
        mask: (H, W), not zero where points are kept; None for everywhere.
        run_in_blocks: see `as_gray`.

    Raises:
        ImageError: an invalid image, or a mask of another shape.
    """
    colors, opaque = opaque_part(image)
    gray = as_gray(colors, run_in_blocks=run_in_blocks)
    inside = check_mask(mask, gray.shape)
    return gray, inside if opaque is None else inside & opaque


def check_mask(mask: npt.ArrayLike | None, shape: tuple[int, ...]) -> BoolArray:
    """(H, W) where a mask is not zero; everywhere for None.

    Raises:
        ImageError: the mask does not have the shape of the image.
    """
    inside = np.ones(shape, np.bool_) if mask is None else np.asarray(mask) != 0
    if inside.shape != shape:
        raise ImageError(f"mask: expected the image's shape {shape}, found {inside.shape}")
    return inside


def contrast_limits(
    values: npt.NDArray[np.floating], percentiles: tuple[float, float] = PERCENTILES
) -> tuple[float, float]:
    """Two percentiles of the values of an image."""
    step = STEP if values.size > MANY else 1
    low, high = np.percentile(values[::step, ::step], percentiles)
    return float(low), float(high)


def stretch_contrast(
    image: Image, percentiles: tuple[float, float] = PERCENTILES, name: str = "image"
) -> Float32Array:
    """Stretches the values of an image between two percentiles to [0, 1].

    For images that use a small part of the range of their data type, as of a thermal camera.

    Args:
        image: see `saccade.types.Image`.
        percentiles: of all values, that become 0 and 1; values beyond are clipped.
        name: for error messages.

    Returns:
        (H, W) or (H, W, 3); (H, W, 4) of an image with transparent pixels; unchanged where both
        percentiles are equal.

    Raises:
        ConfigError: percentiles that are not ascending from 0 to 100.
        ImageError: as `check_image`.
    """
    low, high = percentiles
    require(0 <= low < high <= 100, "percentiles", "two ascending ones, 0 to 100", percentiles)
    colors, opaque = opaque_part(image)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImageWarning)  # of a small range, which is stretched here
        values = in_unit_range(check_image(colors, name), np.float64)
    darkest, brightest = contrast_limits(values, percentiles)
    if brightest > darkest:
        values = ((values - darkest) / (brightest - darkest)).clip(0, 1)
    if opaque is not None:
        values = np.dstack([repeat_gray(values), opaque])
    return values.astype(np.float32)


def warn_of_low_contrast(gray: Float32Array, least: float) -> None:
    """Warns if the values of an image span less than a contrast, and names the cure.

    Args:
        gray: (H, W) in [0, 1].
        least: smallest range of values in which points are found.
    """
    if gray.size <= 2 * DEFECTS:
        return
    ends = np.partition(gray.ravel(), (DEFECTS, gray.size - DEFECTS - 1))
    low, high = ends[DEFECTS], ends[-DEFECTS - 1]
    if 0 < high - low < least:
        warnings.warn(
            f"image: its values span {high - low:.2g} of the range from 0 to 1, too little for "
            "points over the contrast threshold; stretch it: saccade.stretch_contrast(image), "
            "or --stretch",
            ImageWarning,
            stacklevel=3,
        )
