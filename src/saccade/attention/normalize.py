"""The normalization operator N, smoothing, sharpening and position priors.

N promotes maps with few outstanding maxima over those with many. Every method first scales the map
to [0, 1]. A flat map becomes 0.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.errors import require
from saccade.extras import import_function
from saccade.scale.pyramid import FloatMap
from saccade.types import FloatArray

FLAT = 2e-6
"""Maximum range of a flat map: the rounding of float32 for images in [0, 1]."""

EXCITATION = (0.5, 0.02)
"""Strength and standard deviation of the excitation; the deviation is a fraction of the longer side
of the map (Itti & Koch 2000)."""
INHIBITION = (1.5, 0.25)
"""Strength and standard deviation of the surround's inhibition, in the units of `EXCITATION`."""
GLOBAL_INHIBITION = 0.02
"""Amount subtracted in each iteration, as a fraction of the maximum of the map."""
MIN_GAUSSIAN_SIGMA = 0.5
"""Minimum standard deviation in pixels for a sampled Gaussian to sum to its strength."""
KERNEL_CUT = 0.01
"""Truncation of the Gaussians, as a fraction of their peak."""
MAX_SMOOTHING = 1 / 8
"""Maximum standard deviation of the smoothing, as a fraction of a side of the map."""


def rescale(values: FloatMap) -> FloatMap:
    """The map scaled linearly to [0, 1]; a flat map becomes 0."""
    low, high = values.min(), values.max()
    if high - low <= FLAT:
        return np.zeros_like(values)
    scaled: FloatMap = (values - low) / (high - low)
    return scaled


def smooth(values: FloatMap, sigma: float) -> FloatMap:
    """The map smoothed by a Gaussian of `sigma` cells, at most `MAX_SMOOTHING` of each side."""
    if sigma == 0:
        return values
    y, x = (min(sigma, MAX_SMOOTHING * side) for side in values.shape)
    return cv2.GaussianBlur(values, (0, 0), x, sigmaY=y, borderType=cv2.BORDER_REFLECT)


def sharpen(saliency: FloatMap, exponent: float) -> FloatMap:
    """The map scaled to [0, 1] and raised to a power; unchanged for an exponent of 1."""
    return saliency if exponent == 1 else rescale(saliency) ** exponent


def position_prior(
    shape: tuple[int, ...],
    center_sigma: float | None,
    center_height: float = 0.0,
    border_distance: float | None = None,
) -> FloatArray:
    """Position prior: the preference for the center and against the border of any image.

    Args:
        shape: (h, w) cells that tile the image.
        center_sigma: standard deviation of the center prior, a Gaussian, as a fraction of each
            side; None for no center prior.
        center_height: height of that Gaussian's center above the middle, as a fraction of the
            image's height.
        border_distance: width d of the border prior `1 - exp(-distance / d)`, as a fraction of each
            side; None for no border prior.

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


class Parameters(NamedTuple):
    """Parameters of the normalizations; each reads those that it needs."""

    threshold: float = 0.1
    """Minimum height of the local maxima that count, in a map scaled to [0, 1]."""
    radius: float | None = 0.05
    """Radius of the neighborhood of a local maximum, as a fraction of the longer side of the map,
    at least one pixel; None for the 8 neighbors."""
    iterations: int = 3
    """Number of iterations of the iterative normalization."""


DEFAULTS = Parameters()


def promotion(values: FloatMap, threshold: float, radius: int, without_highest: bool) -> float:
    """Weight `(1 - m)^2`, with the mean m of the local maxima; 1 for one maximum, 0 without any.

    A single maximum equals 1 after scaling, and the formula would suppress the map instead of
    promoting it.
    """
    maxima = local_maxima(values, threshold, radius)
    n = len(maxima)
    if n < 2:
        return float(n)
    total = float(maxima.sum())
    mean = (total - float(maxima.max())) / (n - 1) if without_highest else total / n
    return (1 - mean) ** 2


def local_maxima(values: FloatMap, threshold: float, radius: int) -> FloatMap:
    """(n,) heights of the local maxima, in arbitrary order.

    A maximum is the highest pixel in the square of `2 radius + 1` around it, clipped to the map;
    adjacent maxima form a plateau and count once.

    Args:
        values: (h, w).
        threshold: minimum height of a maximum.
        radius: radius of the neighborhood in pixels.
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


def inhibit_laterally(
    values: FloatMap, iterations: int, min_sigma: float = MIN_GAUSSIAN_SIGMA
) -> FloatMap:
    """Lateral inhibition: iterated filtering by a difference of Gaussians.

    Each iteration is `m <- max(0, m + Gex * m - Gin * m - 0.02 max(m))`, Gex a narrow and
    strong, Gin a wide Gaussian, both renormalized at the borders.

    Args:
        values: (h, w), nonnegative.
        iterations: number of iterations.
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
    """(2 r + 1,) one axis of a scaled Gaussian, no longer than the map's shorter side."""
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
    """(side,) sum of the kernel weights that lie inside the axis, for each sample."""
    inside: FloatMap = np.convolve(np.ones(side), kernel)[len(kernel) // 2 :][:side]
    return inside


def weight_by_maxima(
    scaled: FloatMap,
    parameters: Parameters,
    *,
    without_highest: bool = False,
    promotion: Callable[[FloatMap, float, int, bool], Any] = promotion,
) -> FloatMap:
    """The map times `(1 - m)^2`, with the mean m of its local maxima.

    Args:
        scaled: (h, w) in [0, 1].
        parameters: threshold and radius of the maxima.
        without_highest: whether m leaves out the global maximum (Itti, Koch & Niebur 1998).
        promotion: function that computes the weight; replaceable for other array libraries.
    """
    threshold, radius, _ = parameters
    pixels = 1 if radius is None else max(1, round(radius * max(scaled.shape[-2:])))
    weighted: FloatMap = scaled * promotion(scaled, threshold, pixels, without_highest)
    return weighted


def weight_by_other_maxima(scaled: FloatMap, parameters: Parameters) -> FloatMap:
    """The map times `(1 - m)^2`, with the mean m of its local maxima without the global one."""
    return weight_by_maxima(scaled, parameters, without_highest=True)


def iterate(scaled: FloatMap, parameters: Parameters) -> FloatMap:
    """Lateral inhibition of a map in [0, 1] (Itti & Koch 2000)."""
    return inhibit_laterally(scaled, parameters.iterations)


def keep(scaled: FloatMap, parameters: Parameters) -> FloatMap:
    """The scaled map without promotion."""
    del parameters
    return scaled


Promote: TypeAlias = Callable[[FloatMap, Parameters], FloatMap]
"""Function from a map (h, w) in [0, 1] and the parameters to the promoted map."""
Normalization: TypeAlias = str | Promote
"""Name in `NORMALIZATIONS`, a function such as those in its rows, or module:function."""


class NormalizationRow(NamedTuple):
    """A normalization in the table."""

    promote: Promote
    """Promotes a map in [0, 1]."""
    variants: tuple[str, ...]
    """Variants of the contrast model that support it; "tensors" is `saccade.torch`."""


NUMPY = ("mirrored", "kootstra2010")
"""Variants that use the functions of the table; the others have their own."""
NORMALIZATIONS = {
    "local-maxima": NormalizationRow(weight_by_maxima, (*NUMPY, "saliencytoolbox2", "tensors")),
    "local-maxima-1998": NormalizationRow(weight_by_other_maxima, (*NUMPY, "tensors")),
    "iterative": NormalizationRow(iterate, (*NUMPY, "saliencytoolbox2")),
    "none": NormalizationRow(keep, (*NUMPY, "saliencytoolbox2", "tensors")),
}
"""The normalizations by name."""


def names_supported(variant: str) -> list[str]:
    """Names of the normalizations that a variant supports."""
    return [name for name, row in NORMALIZATIONS.items() if variant in row.variants]


def check_normalization(method: Normalization, variant: str) -> None:
    """Raises `ConfigError` unless a variant of the contrast model supports a normalization."""
    names, own = names_supported(variant), variant in NUMPY
    if own and (callable(method) or (isinstance(method, str) and ":" in method)):
        promote_of(method)
        return
    expected = f"one of {', '.join(names)}" + ", or module:function" * own
    named = getattr(method, "__name__", method)
    require(method in names, "normalization", f"{expected} for the variant {variant}", named)


def promote_of(method: Normalization) -> Promote:
    """The function of a normalization."""
    return method if callable(method) else _named(method)


@cache
def _named(name: str) -> Promote:
    if name in NORMALIZATIONS:
        return NORMALIZATIONS[name].promote
    return import_function("normalization", name)


def normalize(
    values: FloatMap,
    method: Normalization,
    parameters: Parameters = DEFAULTS,
    *,
    rescale: Callable[[FloatMap], FloatMap] = rescale,
    promote_of: Callable[[Normalization], Promote] = promote_of,
) -> FloatMap:
    """The operator N: scales the map to [0, 1] and promotes it if few maxima stand out.

    Args:
        values: (h, w).
        method: a name in `NORMALIZATIONS`, or a function such as those in its rows.
        parameters: parameters of the method.
        rescale: function that scales the map; replaceable for other array libraries.
        promote_of: function that returns the function of a method; replaceable likewise.
    """
    return promote_of(method)(rescale(values), parameters)
