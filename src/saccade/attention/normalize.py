"""How a map with few strong places is promoted over one with many: the operator N.

Every form first scales the map to [0, 1]. A flat map has nothing to promote: it becomes 0.
"""

from typing import Literal, get_args

import cv2
import numpy as np

from saccade.pyramid import FloatMap

Normalization = Literal["local-maxima", "local-maxima-1998", "iterative", "none"]
NORMALIZATIONS: tuple[Normalization, ...] = get_args(Normalization)

FLAT = 2e-6
"""A map whose values span less is flat: in an image in [0, 1] it is float32 rounding."""

EXCITATION = (0.5, 0.02)
"""Strength, and standard deviation by the map's longer side (Itti & Koch 2000)."""
INHIBITION = (1.5, 0.25)
"""The same for the surround."""
GLOBAL_INHIBITION = 0.02
"""What every place loses in each iteration, by the map's maximum."""
NARROWEST = 0.5
"""Standard deviation in pixels under which a sampled Gaussian no longer sums to its strength."""
KERNEL_CUT = 0.01
"""The Gaussians are cut where they fall below this part of their peak."""
WIDEST = 1 / 8
"""Part of a map's side over which its smoothing would leave nothing but its mean."""


def normalize(
    values: FloatMap,
    method: Normalization,
    *,
    threshold: float = 0.1,
    radius: float = 0.05,
    iterations: int = 3,
) -> FloatMap:
    """The map, scaled to [0, 1] and weighted by how much a few places stand out in it.

    Args:
        values: (h, w).
        method: "local-maxima" takes all local maxima into the mean m of `(1 - m)^2`,
            "local-maxima-1998" all but the global one (Itti, Koch & Niebur 1998),
            "iterative" lets places inhibit each other (Itti & Koch 2000), "none" only scales.
        threshold: local maxima below this do not count.
        radius: how far around itself a local maximum is the highest, as part of the map's
            longer side, but at least a pixel.
        iterations: of the iterative method.
    """
    scaled = rescale(values)
    if method == "iterative":
        return inhibit_laterally(scaled, iterations)
    if method == "none":
        return scaled
    pixels = max(1, round(radius * max(values.shape)))
    maxima = local_maxima(scaled, threshold, pixels)
    return scaled * (promotion(maxima) if method == "local-maxima" else promotion_1998(maxima))


def rescale(values: FloatMap) -> FloatMap:
    """The map stretched to [0, 1]; 0 where it is flat."""
    low, high = values.min(), values.max()
    if high - low <= FLAT:
        return np.zeros_like(values)
    scaled: FloatMap = (values - low) / (high - low)
    return scaled


def smooth(values: FloatMap, sigma: float) -> FloatMap:
    """The map under a Gaussian of this many cells, but no wider than a part of each side."""
    if sigma == 0:
        return values
    y, x = (min(sigma, WIDEST * side) for side in values.shape)
    return cv2.GaussianBlur(values, (0, 0), x, sigmaY=y, borderType=cv2.BORDER_REFLECT)


def sharpen(saliency: FloatMap, exponent: float) -> FloatMap:
    """The map in [0, 1] to a power; as it is for the power 1."""
    return saliency if exponent == 1 else rescale(saliency) ** exponent


def promotion(maxima: FloatMap) -> float:
    """`(1 - m)^2` with m the mean of the maxima; 1 for a single one, 0 for none.

    Taken literally a lone maximum, which is 1, would wipe out the map that it should promote.
    """
    if len(maxima) == 0:
        return 0.0
    return 1.0 if len(maxima) == 1 else (1 - float(maxima.sum()) / len(maxima)) ** 2


def promotion_1998(maxima: FloatMap) -> float:
    """`(1 - m)^2` with m the mean of the maxima but the highest; 1 for a single one, 0 for none."""
    if len(maxima) < 2:
        return float(len(maxima))
    others = (float(maxima.sum()) - float(maxima.max())) / (len(maxima) - 1)
    return (1 - others) ** 2


def local_maxima(values: FloatMap, threshold: float, radius: int) -> FloatMap:
    """The heights of the local maxima.

    A maximum is a pixel with none higher in the square of `2 radius + 1` around it, as far as
    the map goes; maxima that touch are a plateau and count as one.

    Args:
        values: (h, w).
        threshold: lower maxima are left out.
        radius: in pixels.

    Returns:
        (n,) heights, in no particular order.
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


def inhibit_laterally(values: FloatMap, iterations: int, narrowest: float = NARROWEST) -> FloatMap:
    """Places excite themselves, inhibit their wide surround, and few survive.

    Each iteration is `m <- max(0, m + Gex * m - Gin * m - 0.02 max(m))`, Gex a narrow and
    strong, Gin a wide Gaussian, both renormalized where they leave the map.

    Args:
        values: (h, w), not negative.
        iterations: how often.
        narrowest: the least standard deviation of the Gaussians, in pixels.

    Source: Itti & Koch (2000).
    """
    excitation, inhibition = (
        gaussian_kernel(strength, max(fraction * max(values.shape), narrowest), values.shape)
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
    longest = min(shape) // 2 - 1
    if longest > 0:
        radius = min(radius, longest)
    x = np.arange(-radius, radius + 1)
    kernel: FloatMap = np.exp(-(x**2) / (2 * sigma**2)) * strength / (sigma * np.sqrt(2 * np.pi))
    return kernel


def truncated_filter(values: FloatMap, kernel: FloatMap) -> FloatMap:
    """The map filtered along both axes; the part of the kernel inside it counts for the whole."""
    inside = [
        np.convolve(np.ones(side), kernel)[len(kernel) // 2 :][:side] / kernel.sum()
        for side in values.shape
    ]
    filtered = cv2.sepFilter2D(values, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    whole: FloatMap = filtered / np.outer(*inside).astype(values.dtype)
    return whole
