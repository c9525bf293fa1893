"""Gaussian pyramids and the geometry of their levels, shared by attention and keypoints.

Every level of a pyramid covers the whole image with equal cells, so that cell k of n is centered at
pixel `(k + 0.5) * N / n - 0.5` of N. Borders reflect about the edge of the outermost pixel, a
symmetry that all levels preserve.
"""

from collections.abc import Sequence
from math import log2
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray

FloatMap: TypeAlias = npt.NDArray[Any]
"""(h, w) float32 or float64; results have the same dtype."""

MAX_LEVEL = 30
"""Maximum pyramid level, coarser than any level of an image."""
BINOMIAL = np.array([1, 4, 6, 4, 1], np.float32) / 16
"""Binomial kernel along an axis, with variance 1."""
BINOMIAL_SIZE = (5, 5)
"""Kernel size for which OpenCV's Gaussian equals `BINOMIAL`."""


def half_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Shape of the next level: half of each side, rounded up."""
    return (shape[0] + 1) // 2, (shape[1] + 1) // 2


def level_shape(shape: tuple[int, int], level: int) -> tuple[int, int]:
    """Shape of a level; the image is level 0."""
    for _ in range(level):
        shape = half_shape(shape)
    return shape


def deepest_level(shape: tuple[int, int]) -> int:
    """The coarsest level: the first whose shorter side is a single pixel."""
    return (min(shape) - 1).bit_length()


def coarser_levels(
    shape: tuple[int, int], viewing_size: int, finest_level: int, map_level: int
) -> int:
    """Number of levels by which a configuration's levels are shifted for an image.

    Args:
        shape: (H, W) of the image.
        viewing_size: reference length of the longer side in pixels.
        finest_level: finest of the levels; it stays at or above level 0.
        map_level: level of the map; it stays at or above level 1.
    """
    coarser = round(log2(max(shape) / viewing_size))
    return max(coarser, -finest_level, 1 - map_level)


def halve(image: FloatMap) -> FloatMap:
    """The next level of a pyramid (A.4-A.5): smoothed, then subsampled by two.

    Each sample is the mean of two smoothed neighbors. The combined kernel is [1 5 10 10 5 1] / 32,
    and a mirrored image yields the mirrored level.

    Args:
        image: (h, w) or (h, w, c); uint8, uint16, float32 or float64.

    Returns:
        (ceil(h / 2), ceil(w / 2)) or (..., c), of the same dtype; float32 in [0, 1] for integers,
        to avoid rounding.
    """
    if image.dtype.kind == "u":
        lines = BINOMIAL, BINOMIAL / np.iinfo(image.dtype).max
        smooth = cv2.sepFilter2D(image, cv2.CV_32F, *lines, borderType=cv2.BORDER_REFLECT)
    else:
        smooth = cv2.GaussianBlur(image, BINOMIAL_SIZE, 0, borderType=cv2.BORDER_REFLECT)
    return resize(smooth, half_shape(image.shape[:2]), cv2.INTER_LINEAR)


def resize(image: FloatMap, shape: tuple[int, int], interpolation: int | None = None) -> FloatMap:
    """Resizes an image: cell means for reduction, bilinear interpolation for enlargement."""
    if image.shape[:2] == shape:
        return image
    if interpolation is None:
        shrinks = shape[0] < image.shape[0] or shape[1] < image.shape[1]
        interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(image, (shape[1], shape[0]), interpolation=interpolation)


def cell_centers(
    rows: npt.ArrayLike,
    columns: npt.ArrayLike,
    map_shape: Sequence[int],
    image_shape: Sequence[int],
) -> FloatArray:
    """Centers of map cells in image pixels.

    Args:
        rows: (n,) row of each cell.
        columns: (n,) column of each cell.
        map_shape: (h, w), or more dimensions, of the map.
        image_shape: (H, W), or more dimensions, of the image that the map covers.

    Returns:
        (n, 2) x and y of the cells' centers in image pixels.
    """
    x = (np.asarray(columns) + 0.5) * (image_shape[1] / map_shape[1]) - 0.5
    y = (np.asarray(rows) + 0.5) * (image_shape[0] / map_shape[0]) - 0.5
    return np.stack([x, y], axis=-1).astype(np.float64)
