"""The processing steps of the contrast model, as replaceable functions.

Each variant of the model, and each array library, has its own `Steps`. `MIRRORED` is the default;
`KOOTSTRA2010` follows the publication. Details that A.4-A.14 leave open follow
`saccade.textbook.contrast_saliency`: a binomial kernel, replicated borders, linear interpolation of
coarser levels, whose sample k lies at sample 2 k of the finer level, and a single even Gabor
filter.
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
from saccade.attention.normalize import Parameters, normalize, rescale, sharpen, smooth
from saccade.io.image import in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, deepest_level, halve, level_shape, resize
from saccade.types import FloatArray

Shape: TypeAlias = tuple[int, int]

PUBLISHED_BORDER = cv2.BORDER_REPLICATE
"""Border mode of the published steps."""
EQUAL_DIGITS = 9
"""Number of equal decimals of two equal values in [0, 1]; further decimals are rounding."""


@dataclass(frozen=True)
class Steps:
    """The functions that make up the contrast model."""

    level_shape: Callable[[Shape, int], Shape]
    """Shape of a pyramid level, from the image shape and the level."""
    deepest_level: Callable[[Shape], int]
    """Coarsest pyramid level of an image of a given shape."""
    split_channels: Callable[[Any, ContrastConfig, int], tuple[int, dict[ChannelName, FloatMap]]]
    """Intensity and color opponency at a pyramid level, and that level; the argument is the
    coarsest level allowed (A.1-A.3)."""
    halve: Callable[[FloatMap], FloatMap]
    """Next coarser pyramid level (A.4-A.5)."""
    orientations: Callable[[FloatMap, ContrastConfig], list[FloatMap]]
    """Response to each orientation at a level of intensity (A.6)."""
    difference: Callable[[FloatMap, FloatMap, Shape, ContrastConfig], FloatMap]
    """Contrast of a center and a surround, for a map of a given shape (A.7-A.10)."""
    resize: Callable[[FloatMap, Shape], FloatMap]
    """Resized map."""
    normalize: Callable[[FloatMap, ContrastConfig], FloatMap]
    """Feature map normalized by N."""
    normalize_sum: Callable[[FloatMap, ContrastConfig], FloatMap]
    """Sum of normalized maps, normalized again by N."""
    conspicuity: Callable[[Sequence[FloatMap], ContrastConfig], FloatMap]
    """Conspicuity map from the maps of its channels (A.11-A.13)."""
    saliency: Callable[[FloatMap, FloatMap, FloatMap, ContrastConfig], FloatMap]
    """Saliency from the conspicuity of intensity, color and orientation (A.14)."""
    smooth: Callable[[FloatMap, float], FloatMap] = smooth
    """Map smoothed by a Gaussian; its standard deviation is in cells."""
    sharpen: Callable[[FloatMap, float], FloatMap] = sharpen
    """Map scaled to [0, 1] and raised to a power."""


@cache
def gabor_factors(
    angle: float, period: float, sigma: float, size: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Separable factors of `gabor_pair`: waves along x and along y.

    Returns:
        Three (2, size) arrays of cosine and sine: along x for the even filter, along x for the odd
        filter, and along y for both. The even filter is cos cos - sin sin minus its mean, the odd
        filter cos sin + sin cos.
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
    """The even and odd filters, from the factors of `gabor_factors`."""
    even = np.outer(along_y[0], even_x[0]) - np.outer(along_y[1], even_x[1])
    return even - even.mean(), np.outer(along_y[1], odd_x[0]) + np.outer(along_y[0], odd_x[1])


def gabor_pair(
    angle: float, period: float, sigma: float, size: int
) -> tuple[FloatArray, FloatArray]:
    """An even and an odd Gabor filter, each with zero mean and unit energy.

    Args:
        angle: direction of the preferred bars in radians, from x towards y.
        period: wavelength in pixels.
        sigma: standard deviation of the isotropic Gaussian window in pixels.
        size: side of the filters in pixels, an odd number.

    Returns:
        Two (size, size) filters, with phases 0 and pi / 2.
    """
    return gabor_sums(*gabor_factors(angle, period, sigma, size))


def filter_lines(image: FloatMap, along_x: FloatArray, along_y: FloatArray) -> FloatMap:
    """The image filtered along both axes, with mirrored borders."""
    return cv2.sepFilter2D(image, -1, along_x, along_y, borderType=cv2.BORDER_REFLECT)


def box_mean(image: FloatMap, size: int) -> FloatMap:
    """Mean over a square of `size` pixels, with mirrored borders."""
    return cv2.boxFilter(image, -1, (size, size), borderType=cv2.BORDER_REFLECT)


def magnitude(even: FloatMap, odd: FloatMap) -> FloatMap:
    """Root of the sum of squares; the rounding of cv2.magnitude depends on memory alignment."""
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
    """(h, w) magnitude of the responses to a `gabor_pair`, by separable filtering (A.6)."""
    even_x, odd_x, (cos_y, sin_y) = gabor_factors(angle, period, sigma, size)

    def response(x: FloatArray, y: FloatArray) -> Any:
        if not (x.any() and y.any()):  # the sine is 0 for a wave along the other axis
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
    """Intensity and color opponency of a validated image (A.1-A.3)."""
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
    """Intensity and color opponency at a level up to `finest`, and that level (A.1-A.3).

    Linear channels commute with subsampling, so the image is halved before conversion: an 8-bit
    image takes a quarter of the memory.
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
    """The map normalized by N, with the configured settings."""
    parameters = Parameters(config.maxima_threshold, config.maxima_radius, config.iterations)
    return normalize(values, config.normalization, parameters)


def add(parts: Sequence[FloatMap], config: ContrastConfig) -> FloatMap:
    """The sum of maps (A.11-A.13)."""
    del config
    return sum(parts[1:], start=parts[0])


def weighted_sum(
    intensity: FloatMap, color: FloatMap, orientation: FloatMap, config: ContrastConfig
) -> FloatMap:
    """Weighted sum of the conspicuity maps of intensity, color and orientation."""
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
"""The default steps, with mirrored image borders."""


def halve_as_published(level: FloatMap) -> FloatMap:
    """Smoothed level, subsampled by two from its first sample (A.4-A.5)."""
    return cv2.pyrDown(level, borderType=PUBLISHED_BORDER)


def resize_as_published(values: FloatMap, shape: Shape) -> FloatMap:
    """Level resized to a coarser size by A.4-A.5, or to a finer size by linear interpolation."""
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
    """Signed response to an even Gabor filter for each orientation (A.6)."""
    even = (gabor_pair(*gabor)[0] for gabor in gabors(config))
    return [cv2.filter2D(level, -1, each, borderType=PUBLISHED_BORDER) for each in even]


def normalize_as_published(values: FloatMap, config: ContrastConfig) -> FloatMap:
    """Map normalized by N; maxima that differ by rounding count as equal."""
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
"""Steps A.1-A.14 as published, in double precision."""
