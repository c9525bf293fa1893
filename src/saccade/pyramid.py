"""Images at many scales and their oriented responses: shared by attention and keypoints.

Every level of a pyramid covers the whole image with equal cells, so that cell k of
n stands at pixel `(k + 0.5) * N / n - 0.5` of N. Borders reflect about the edge of
the outermost pixel, which this arrangement leaves unchanged from level to level.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray

FloatMap: TypeAlias = npt.NDArray[Any]
"""(h, w) float32 or float64; what is computed from it has the same dtype."""

DEEPEST = 30
"""Pyramid level that no image reaches."""
BINOMIAL_SIZE = (5, 5)
"""OpenCV's Gaussian of this size is [1 4 6 4 1] / 16 along both axes, of variance 1."""


def half_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Shape of the next level: half of each side, rounded up."""
    return (shape[0] + 1) // 2, (shape[1] + 1) // 2


def level_shape(shape: tuple[int, int], level: int) -> tuple[int, int]:
    """Shape of a level; the image is level 0."""
    for _ in range(level):
        shape = half_shape(shape)
    return shape


def deepest_level(shape: tuple[int, int]) -> int:
    """The last level there is: the first whose shorter side is a single pixel."""
    return (min(shape) - 1).bit_length()


def halve(image: FloatMap) -> FloatMap:
    """The next level of a pyramid (A.4-A.5): smoothed, then subsampled by two.

    The mean of two neighbours of the smoothed image is a sample between them: in all
    the kernel is [1 5 10 10 5 1] / 32, and a mirrored image gives the mirrored level.

    Args:
        image: (h, w) or (h, w, c); uint8, uint16, float32 or float64.

    Returns:
        (ceil(h / 2), ceil(w / 2)) or (..., c), of the same dtype.
    """
    smooth = cv2.GaussianBlur(image, BINOMIAL_SIZE, 0, borderType=cv2.BORDER_REFLECT)
    return resize(smooth, half_shape(image.shape[:2]), cv2.INTER_LINEAR)


def dyadic_pyramid(image: FloatMap, levels: int) -> list[FloatMap]:
    """Level 0, which is the image, to level `levels`, each half the size of the last (A.4-A.5).

    Args:
        image: (h, w) float32 or float64.
        levels: number of the last level; levels beyond `deepest_level` are left out.
    """
    pyramid = [image]
    for _ in range(min(levels, deepest_level(image.shape))):
        pyramid.append(halve(pyramid[-1]))
    return pyramid


def resize(image: FloatMap, shape: tuple[int, int], interpolation: int | None = None) -> FloatMap:
    """The image at another size: cell means where it shrinks, bilinear where it grows."""
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
    """Where the cells of a map stand in its image.

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


def gabor_pair(
    angle: float, period: float, sigma: float, size: int
) -> tuple[FloatArray, FloatArray]:
    """An even and an odd Gabor filter, each of zero mean and unit energy.

    Args:
        angle: direction in radians, from x towards y, of the bars that the pair answers to.
        period: wavelength in pixels.
        sigma: standard deviation of the round Gaussian window in pixels.
        size: side of the filters in pixels, odd.

    Returns:
        Two (size, size) filters, of phase 0 and pi / 2.
    """
    even, odd = _waves(angle, period, sigma, size)
    return even / np.linalg.norm(even), odd / np.linalg.norm(odd)


def gabor_energies(
    image: FloatMap, angles: Sequence[float], period: float, sigma: float, size: int
) -> list[FloatMap]:
    """How strongly each orientation is present: the magnitude of the responses of its pair (A.6).

    The filters are those of `gabor_pair`. A wave over a round window is a sum of two products of
    waves along x and y, which are filtered axis by axis and serve both diagonals.

    Args:
        image: (h, w) float32 or float64.
        angles: in radians, see `gabor_pair`.
        period: wavelength in pixels.
        sigma: standard deviation of the round Gaussian window in pixels.
        size: side of the filters in pixels, odd.

    Returns:
        One (h, w) map for each angle.
    """
    at = np.arange(size) - (size - 1) / 2
    window = np.exp(-(at**2) / (2 * sigma**2))
    mean = cv2.boxFilter(image, -1, (size, size), borderType=cv2.BORDER_REFLECT)

    @cache
    def product(wave_x: str, kx: float, wave_y: str, ky: float, norm: float) -> FloatMap:
        """The image under a product of waves, of zero mean, by the norm of the filter."""
        x, y = (
            window * (np.cos(k * at) if wave == "cos" else np.sin(k * at))
            for wave, k in ((wave_x, kx), (wave_y, ky))
        )
        filtered = cv2.sepFilter2D(image, -1, x / norm, y, borderType=cv2.BORDER_REFLECT)
        if wave_x == wave_y == "cos":
            return filtered - float(x.sum() * y.sum() / norm) * mean
        return filtered

    energies = []
    for angle in angles:
        kx, ky = (2 * np.pi / period * np.array([-np.sin(angle), np.cos(angle)])).round(12)
        turn = np.sign(kx * ky)
        kx, ky = abs(kx), abs(ky)
        even_norm, odd_norm = _norms(angle, period, sigma, size)
        even = product("cos", kx, "cos", ky, even_norm)
        if turn == 0:
            wave_x, wave_y = ("sin", "cos") if kx else ("cos", "sin")
            odd = product(wave_x, kx, wave_y, ky, odd_norm)
        else:
            sines = product("sin", kx, "sin", ky, even_norm)
            along_x, along_y = (
                product("sin", kx, "cos", ky, odd_norm),
                product("cos", kx, "sin", ky, odd_norm),
            )
            even = even - sines if turn > 0 else even + sines
            odd = along_x + along_y if turn > 0 else along_x - along_y
        # cv2.magnitude rounds differently with where its input lies in memory
        energy = even * even
        energy += odd * odd
        energies.append(np.sqrt(energy, out=energy))
    return energies


@cache
def _norms(angle: float, period: float, sigma: float, size: int) -> tuple[float, float]:
    """The norms that `gabor_pair` divides its filters by, alike for mirrored angles."""
    even, odd = _waves(angle, period, sigma, size)
    return round(float(np.linalg.norm(even)), 12), round(float(np.linalg.norm(odd)), 12)


def _waves(angle: float, period: float, sigma: float, size: int) -> tuple[FloatArray, FloatArray]:
    """An even and an odd wave of zero mean over a round window."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    across = y * np.cos(angle) - x * np.sin(angle)
    window = np.exp(-(x**2 + y**2) / (2 * sigma**2))
    phase = 2 * np.pi * across / period
    even, odd = (wave - wave.mean() for wave in (window * np.cos(phase), window * np.sin(phase)))
    return even, odd
