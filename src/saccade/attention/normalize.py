"""The normalization operator N, and what a map of saliency is treated by after it.

N promotes maps with few outstanding maxima over those with many. Every method first scales the map
to [0, 1]. A flat map becomes 0.
"""

from collections.abc import Callable
from typing import Any, Literal

import cv2
import numpy as np

from saccade.scale.pyramid import FloatMap
from saccade.types import FloatArray

Normalization = Literal["local-maxima", "local-maxima-1998", "iterative", "none"]

FLAT = 2e-6
"""A map of a smaller range is flat: for images in [0, 1] it is float32 rounding."""

EXCITATION = (0.5, 0.02)
"""Strength, and standard deviation as a fraction of the longer side of the map (Itti & Koch
2000)."""
INHIBITION = (1.5, 0.25)
"""Strength and standard deviation of the inhibition of the surround, likewise."""
GLOBAL_INHIBITION = 0.02
"""Subtracted in each iteration, as a fraction of the maximum of the map."""
MIN_SIGMA = 0.5
"""Standard deviation in pixels below which a sampled Gaussian no longer sums to its strength."""
KERNEL_CUT = 0.01
"""The Gaussians are truncated where they fall below this fraction of their peak."""
MAX_SMOOTHING = 1 / 8
"""Largest standard deviation of the smoothing, as a fraction of a side of the map."""


def rescale(values: FloatMap) -> FloatMap:
    """The map scaled linearly to [0, 1]; 0 where it is flat."""
    low, high = values.min(), values.max()
    if high - low <= FLAT:
        return np.zeros_like(values)
    scaled: FloatMap = (values - low) / (high - low)
    return scaled


def smooth(values: FloatMap, sigma: float) -> FloatMap:
    """The map filtered by a Gaussian of `sigma` cells, at most `MAX_SMOOTHING` of each side."""
    if sigma == 0:
        return values
    y, x = (min(sigma, MAX_SMOOTHING * side) for side in values.shape)
    return cv2.GaussianBlur(values, (0, 0), x, sigmaY=y, borderType=cv2.BORDER_REFLECT)


def sharpen(saliency: FloatMap, exponent: float) -> FloatMap:
    """The map scaled to [0, 1] to a power; unchanged for the power 1."""
    return saliency if exponent == 1 else rescale(saliency) ** exponent


def position_prior(
    shape: tuple[int, ...],
    center_sigma: float | None,
    center_height: float = 0.0,
    border_distance: float | None = None,
) -> FloatArray:
    """Where people look whatever an image shows: its center, and not its border.

    Args:
        shape: (h, w) cells that tile the image.
        center_sigma: standard deviation, as a fraction of each side, of a Gaussian about the
            center; None for no such factor.
        center_height: height of that Gaussian's center above the middle, as a fraction of the
            image's height.
        border_distance: distance d from the border, as a fraction of each side, in the factor
            `1 - exp(-distance / d)`; None for no such factor.

    Returns:
        (h, w) in [0, 1], a factor of the saliency.
    """
    y, x = ((np.arange(side) + 0.5) / side - 0.5 for side in shape)
    prior = np.ones(shape)
    if center_sigma is not None:
        above, across = (y + center_height) / center_sigma, x / center_sigma
        prior *= np.outer(np.exp(-(above**2) / 2), np.exp(-(across**2) / 2))
    if border_distance is not None:
        distance = np.minimum(0.5 - abs(y)[:, None], 0.5 - abs(x))
        prior *= 1 - np.exp(-distance / border_distance)
    return prior


def promotion(values: FloatMap, threshold: float, radius: int, without_highest: bool) -> float:
    """The weight `(1 - m)^2` with the mean m of the local maxima; 1 for a single one, 0 for none.

    A single maximum is 1 after scaling: the formula would suppress the map that it should promote.
    """
    maxima = local_maxima(values, threshold, radius)
    n = len(maxima)
    if n < 2:
        return float(n)
    total = float(maxima.sum())
    mean = (total - float(maxima.max())) / (n - 1) if without_highest else total / n
    return (1 - mean) ** 2


def local_maxima(values: FloatMap, threshold: float, radius: int) -> FloatMap:
    """(n,) heights of the local maxima, in no particular order.

    A maximum is the highest pixel in the square of `2 radius + 1` around it, clipped to the map;
    adjacent maxima are a plateau and count as one.

    Args:
        values: (h, w).
        threshold: lower maxima are left out.
        radius: in pixels.
    """
    square = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    is_maximum = (values == cv2.dilate(values, square)) & (values >= threshold)
    maxima = np.flatnonzero(is_maximum)
    count, label = cv2.connectedComponents(is_maximum.view(np.uint8), connectivity=8)
    if count == len(maxima) + 1:
        return values.ravel()[maxima]
    height = np.zeros(count, values.dtype)
    height[label.ravel()[maxima]] = values.ravel()[maxima]
    return height[1:]


def normalize(
    values: FloatMap,
    method: Normalization,
    *,
    threshold: float = 0.1,
    radius: float | None = 0.05,
    iterations: int = 3,
    rescale: Callable[[FloatMap], FloatMap] = rescale,
    promotion: Callable[[FloatMap, float, int, bool], Any] = promotion,
) -> FloatMap:
    """The operator N: the map scaled to [0, 1] and weighted by how few maxima stand out in it.

    Args:
        values: (h, w).
        method: "local-maxima" weights by `(1 - m)^2` with the mean m of all local maxima,
            "local-maxima-1998" of all but the global one (Itti, Koch & Niebur 1998);
            "iterative" is lateral inhibition (Itti & Koch 2000), "none" only scales.
        threshold: lower local maxima are ignored.
        radius: of the neighborhood of a local maximum, as a fraction of the longer side of the
            map, at least a pixel; None for the 8 neighbors.
        iterations: of the iterative method.
        rescale: the scaling, which may be of another array library.
        promotion: the weight, likewise.
    """
    scaled = rescale(values)
    if method == "iterative":
        return inhibit_laterally(scaled, iterations)
    if method == "none":
        return scaled
    pixels = 1 if radius is None else max(1, round(radius * max(values.shape[-2:])))
    weighted: FloatMap = scaled * promotion(
        scaled, threshold, pixels, method == "local-maxima-1998"
    )
    return weighted


def inhibit_laterally(values: FloatMap, iterations: int, min_sigma: float = MIN_SIGMA) -> FloatMap:
    """Lateral inhibition: iterated filtering by a difference of Gaussians.

    Each iteration is `m <- max(0, m + Gex * m - Gin * m - 0.02 max(m))`, Gex a narrow and
    strong, Gin a wide Gaussian, both renormalized at the borders.

    Args:
        values: (h, w), not negative.
        iterations: their number.
        min_sigma: smallest standard deviation of the Gaussians, in pixels.

    Source: Itti & Koch (2000).
    """
    excitation, inhibition = (
        gaussian_kernel(strength, max(fraction * max(values.shape), min_sigma), values.shape)
        for strength, fraction in (EXCITATION, INHIBITION)
    )
    for _ in range(iterations):
        excited = truncated_filter(values, excitation)
        inhibited = truncated_filter(values, inhibition)
        values = values + excited - inhibited - GLOBAL_INHIBITION * values.max()
        values = np.maximum(values, 0)
    return values


def gaussian_kernel(strength: float, sigma: float, shape: tuple[int, int]) -> FloatMap:
    """One axis of a Gaussian of a strength, (2 r + 1,), no longer than the map's shorter side."""
    radius = int(sigma * np.sqrt(-2 * np.log(KERNEL_CUT)))
    max_radius = min(shape) // 2 - 1
    if max_radius > 0:
        radius = min(radius, max_radius)
    x = np.arange(-radius, radius + 1)
    kernel: FloatMap = np.exp(-(x**2) / (2 * sigma**2)) * strength / (sigma * np.sqrt(2 * np.pi))
    return kernel


def truncated_filter(values: FloatMap, kernel: FloatMap) -> FloatMap:
    """The map filtered along both axes; the kernel is renormalized at the borders."""
    rows, columns = (fraction_inside(kernel, side) / kernel.sum() for side in values.shape)
    filtered = cv2.sepFilter2D(values, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    renormalized: FloatMap = filtered / np.outer(rows, columns).astype(values.dtype)
    return renormalized


def fraction_inside(kernel: FloatMap, side: int) -> FloatMap:
    """(side,) sum of the part of a kernel that lies inside an axis, convolved at each sample."""
    inside: FloatMap = np.convolve(np.ones(side), kernel)[len(kernel) // 2 :][:side]
    return inside
