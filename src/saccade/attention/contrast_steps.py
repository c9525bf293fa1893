"""The steps of the contrast model, as functions that its loop calls by name.

A variant of the model, or another array library, is another set of `Steps`: `MIRRORED` is the
default, `KOOTSTRA2010` has the steps as they are published. What the print of A.4-A.14 leaves open
is as in `saccade.textbook.contrast_saliency`: a binomial kernel, replicated borders, linear
interpolation of a coarser level, whose sample k stands at sample 2 k of the finer one, and a single
even Gabor filter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import ChannelName, intensity, opponency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.normalize import normalize, rescale, sharpen, smooth
from saccade.io.image import in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, deepest_level, halve, level_shape, resize
from saccade.types import FloatArray

Shape: TypeAlias = tuple[int, int]

PUBLISHED_BORDER = cv2.BORDER_REPLICATE
"""Border of the steps as published."""
EQUAL_DIGITS = 9
"""Number of decimals to which equal values of a map in [0, 1] agree."""


@dataclass(frozen=True)
class Steps:
    """Functions of which the contrast model is composed."""

    level_shape: Callable[[Shape, int], Shape]
    """Shape of a pyramid level of an image of a shape."""
    deepest_level: Callable[[Shape], int]
    """Number of the coarsest level of an image of a shape."""
    split_channels: Callable[[Any, ContrastConfig, int], tuple[int, dict[ChannelName, FloatMap]]]
    """Number of a pyramid level, at most the one that is given, and the intensity and opponents of
    pixels there (A.1-A.3)."""
    halve: Callable[[FloatMap], FloatMap]
    """The next level of a pyramid (A.4-A.5)."""
    orientations: Callable[[FloatMap, ContrastConfig], list[FloatMap]]
    """Responses of a level of intensity to each orientation (A.6)."""
    difference: Callable[[FloatMap, FloatMap, Shape, ContrastConfig], FloatMap]
    """Contrast of a center and a surround, for a map of a shape (A.7-A.10)."""
    resize: Callable[[FloatMap, Shape], FloatMap]
    """A map at another size."""
    normalize: Callable[[FloatMap, ContrastConfig], FloatMap]
    """N of a feature map."""
    normalize_sum: Callable[[FloatMap, ContrastConfig], FloatMap]
    """N of a sum of normalized maps."""
    conspicuity: Callable[[Sequence[FloatMap], ContrastConfig], FloatMap]
    """Conspicuity map of the maps of its channels (A.11-A.13)."""
    saliency: Callable[[FloatMap, FloatMap, FloatMap, ContrastConfig], FloatMap]
    """Saliency of the conspicuity of intensity, color and orientation (A.14)."""
    smooth: Callable[[FloatMap, float], FloatMap] = smooth
    """A map after a Gaussian of so many cells."""
    sharpen: Callable[[FloatMap, float], FloatMap] = sharpen
    """A map scaled to [0, 1] to a power."""


@cache
def gabor_factors(
    angle: float, period: float, sigma: float, size: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The pair of `gabor_pair` as sums of products of waves along x and along y.

    Returns:
        (2, size) cosine and sine along x for the even filter, the same for the odd one, and those
        along y for both: even = cos cos - sin sin less its mean, odd = cos sin + sin cos.
    """
    offset = np.arange(size) - (size - 1) / 2
    window = np.exp(-(offset**2) / (2 * sigma**2))
    wave_numbers = 2 * np.pi / period * np.array([-np.sin(angle), np.cos(angle)])
    along_x, along_y = (
        window * np.array([np.cos(k * offset), np.sin(k * offset)]) for k in wave_numbers.round(12)
    )
    even, odd = gabor_sums(along_x, along_x, along_y)
    return along_x / np.linalg.norm(even), along_x / np.linalg.norm(odd), along_y


def gabor_sums(
    even_x: FloatArray, odd_x: FloatArray, along_y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The even and the odd filter of `gabor_factors`."""
    even = np.outer(along_y[0], even_x[0]) - np.outer(along_y[1], even_x[1])
    return even - even.mean(), np.outer(along_y[1], odd_x[0]) + np.outer(along_y[0], odd_x[1])


def gabor_pair(
    angle: float, period: float, sigma: float, size: int
) -> tuple[FloatArray, FloatArray]:
    """An even and an odd Gabor filter, each of zero mean and unit energy.

    Args:
        angle: direction in radians, from x towards y, of the bars to which the pair responds.
        period: wavelength in pixels.
        sigma: standard deviation of the isotropic Gaussian window in pixels.
        size: side of the filters in pixels, odd.

    Returns:
        Two (size, size) filters, of phase 0 and pi / 2.
    """
    return gabor_sums(*gabor_factors(angle, period, sigma, size))


def filter_lines(image: FloatMap, along_x: FloatArray, along_y: FloatArray) -> FloatMap:
    """The image filtered along both axes, mirrored at its borders."""
    return cv2.sepFilter2D(image, -1, along_x, along_y, borderType=cv2.BORDER_REFLECT)


def box_mean(image: FloatMap, size: int) -> FloatMap:
    """Mean over a square of `size` pixels, mirrored at the borders."""
    return cv2.boxFilter(image, -1, (size, size), borderType=cv2.BORDER_REFLECT)


def magnitude(even: FloatMap, odd: FloatMap) -> FloatMap:
    """Root of the sum of squares; cv2.magnitude rounds differently with where its input lies."""
    energy: FloatMap = even * even + odd * odd
    np.sqrt(energy, out=energy)
    return energy


def gabor_energy(
    image: FloatMap,
    angle: float,
    period: float,
    sigma: float,
    size: int,
    *,
    filter_lines: Callable[[FloatMap, FloatArray, FloatArray], FloatMap] = filter_lines,
    box_mean: Callable[[FloatMap, int], FloatMap] = box_mean,
    magnitude: Callable[[FloatMap, FloatMap], FloatMap] = magnitude,
) -> FloatMap:
    """(h, w) magnitude of the responses to a `gabor_pair` in quadrature (A.6), by its factors."""
    even_x, odd_x, (cos_y, sin_y) = gabor_factors(angle, period, sigma, size)

    def response(x: FloatArray, y: FloatArray) -> Any:
        if not (x.any() and y.any()):  # a wave along one axis has no sine along the other
            return 0.0
        return filter_lines(image, x, y)

    mean = float(even_x[0].sum() * cos_y.sum()) * box_mean(image, size)
    even = response(even_x[0], cos_y) - mean
    even -= response(even_x[1], sin_y)
    return magnitude(even, response(odd_x[0], sin_y) + response(odd_x[1], cos_y))


def gabors(config: ContrastConfig) -> list[tuple[float, float, float, int]]:
    """Arguments of `gabor_pair` for each orientation."""
    window = config.gabor_period, config.gabor_sigma, config.gabor_size
    return [(float(np.deg2rad(angle)), *window) for angle in config.orientations]


def rgb_channels(
    pixels: npt.NDArray[Any], config: ContrastConfig, dtype: npt.DTypeLike = np.float32
) -> dict[ChannelName, FloatMap]:
    """Intensity and opponents of a checked image (A.1-A.3)."""
    rgb = repeat_gray(in_unit_range(pixels, dtype))  # (h, w, 3)
    return {"intensity": intensity(rgb), **opponency(rgb, config.color, config.dark)}


def split_channels(
    pixels: npt.NDArray[Any],
    config: ContrastConfig,
    finest: int,
    *,
    halve: Callable[[FloatMap], FloatMap] = halve,
    channels: Callable[[Any, ContrastConfig], dict[ChannelName, FloatMap]] = rgb_channels,
) -> tuple[int, dict[ChannelName, FloatMap]]:
    """A level, at most `finest`, and intensity and opponents there (A.1-A.3).

    Linear channels commute with subsampling, so that the image is halved before it is converted: in
    8 bit it is a quarter as large.
    """
    level = finest if config.color == "linear" else 0
    for _ in range(level):
        pixels = halve(pixels)
    return level, channels(pixels, config)


def gabor_energies(level: FloatMap, config: ContrastConfig) -> list[FloatMap]:
    """Magnitude of the response to each Gabor pair (A.6)."""
    return [gabor_energy(level, *gabor) for gabor in gabors(config)]


def difference(
    center: FloatMap,
    surround: FloatMap,
    map_shape: Shape,
    config: ContrastConfig,
    *,
    resize: Callable[[FloatMap, Shape], FloatMap] = resize,
    absdiff: Callable[[FloatMap, FloatMap], FloatMap] = cv2.absdiff,
) -> FloatMap:
    """Absolute difference of center and surround (A.7-A.10)."""
    contrast = absdiff(center, resize(surround, center.shape[-2:]))
    return resize(contrast, map_shape) if config.normalize_at == "map" else contrast


def normalize_map(
    values: FloatMap,
    config: ContrastConfig,
    *,
    normalize: Callable[..., FloatMap] = normalize,
) -> FloatMap:
    """N with the settings of a configuration."""
    return normalize(
        values,
        config.normalization,
        threshold=config.maxima_threshold,
        radius=config.maxima_radius,
        iterations=config.iterations,
    )


def add(parts: Sequence[FloatMap], config: ContrastConfig) -> FloatMap:
    """The sum of maps (A.11-A.13)."""
    del config
    return sum(parts[1:], start=parts[0])


def weighted_sum(
    intensity: FloatMap, color: FloatMap, orientation: FloatMap, config: ContrastConfig
) -> FloatMap:
    """The maps of intensity, color and orientation times their weights."""
    w_I, w_C, w_O = config.weights
    return w_I * intensity + w_C * color + w_O * orientation


def weighted_mean(
    intensity: FloatMap,
    color: FloatMap,
    orientation: FloatMap,
    config: ContrastConfig,
    *,
    normalize: Callable[[FloatMap, ContrastConfig], FloatMap] = normalize_map,
) -> FloatMap:
    """The weighted mean of the normalized conspicuity maps (A.14)."""
    maps = [normalize(each, config) for each in (intensity, color, orientation)]
    return weighted_sum(maps[0], maps[1], maps[2], config) / sum(config.weights)


MIRRORED = Steps(
    level_shape=level_shape,
    deepest_level=deepest_level,
    split_channels=split_channels,
    halve=halve,
    orientations=gabor_energies,
    difference=difference,
    resize=resize,
    normalize=normalize_map,
    normalize_sum=normalize_map,
    conspicuity=add,
    saliency=weighted_mean,
)
"""Steps on images that are mirrored at their borders."""


def halve_as_published(level: FloatMap) -> FloatMap:
    """Every second sample of the smoothed level, beginning with the first (A.4-A.5)."""
    return cv2.pyrDown(level, borderType=PUBLISHED_BORDER)


def resize_as_published(values: FloatMap, shape: Shape) -> FloatMap:
    """A level at the size of another: coarser by A.4-A.5, finer by linear interpolation."""
    while values.shape[0] > shape[0] or values.shape[1] > shape[1]:
        values = halve_as_published(values)
    if values.shape == shape:
        return values
    octaves = next(n for n in range(64) if level_shape(shape, n) == values.shape)
    step = 0.5**octaves
    return cv2.warpAffine(
        values,
        np.array([[step, 0, 0], [0, step, 0]]),
        (shape[1], shape[0]),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=PUBLISHED_BORDER,
    )


def gabor_responses(level: FloatMap, config: ContrastConfig) -> list[FloatMap]:
    """The signed response to one even Gabor filter for each orientation (A.6)."""
    even = (gabor_pair(*gabor)[0] for gabor in gabors(config))
    return [cv2.filter2D(level, -1, each, borderType=PUBLISHED_BORDER) for each in even]


def normalize_as_published(values: FloatMap, config: ContrastConfig) -> FloatMap:
    """N; maxima that differ by rounding are equal."""
    return normalize_map(np.round(rescale(values), EQUAL_DIGITS), config)


KOOTSTRA2010 = replace(
    MIRRORED,
    split_channels=partial(
        split_channels, halve=halve_as_published, channels=partial(rgb_channels, dtype=np.float64)
    ),
    halve=halve_as_published,
    orientations=gabor_responses,
    difference=partial(difference, resize=resize_as_published),
    resize=resize_as_published,
    normalize=normalize_as_published,
    normalize_sum=normalize_as_published,
    saliency=partial(weighted_mean, normalize=normalize_as_published),
)
"""The steps of A.1-A.14 as published, in double precision."""
