"""Appendix A: the contrast-saliency model, equations A.1-A.14.

As in the source, c is the center level and s the surround level. "Open" marks a choice that the
source leaves open.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import convolve, label, map_coordinates, maximum_filter, maximum_position

from saccade.errors import ImageError
from saccade.io.image import as_rgb
from saccade.types import FloatArray, Image, IntArray

R, G, B = 0, 1, 2  # along the last axis of an image
CENTER = (2, 3, 4)  # c
DELTA = (3, 4)
SCALES = [(c, c + delta) for c in CENTER for delta in DELTA]  # c, s
THETAS = (0, 45, 90, 135)  # in degrees: the direction of a bar, from x towards y (down)
BLACK = np.finfo(np.float64).tiny
"""Open: A.2 and A.3 are 0 / 0 for black; 0 / BLACK = 0 means no color."""
KERNEL = np.outer([1, 4, 6, 4, 1], [1, 4, 6, 4, 1]) / 256
"""Open: G; the binomial of variance 1 is the smallest kernel that is nearly a Gaussian."""
BORDER: Final = "nearest"
"""Open: the last row or column is replicated outside, which adds no contrast."""
WAVELENGTH = 4.0
"""Open: wavelength of the Gabor kernel, in samples, for bars two samples wide, the finest."""
SIGMA = 2.25
"""Open: standard deviation of the kernel, in samples, for a bandwidth of one octave."""
PHASE = 0.0
"""Open: phase of the kernel, which makes it even."""
RADIUS = 7
"""Open: truncation of the kernel, in samples, at three sigma."""
ORDER: Final = 1
"""Open: bilinear interpolation; steps of order 0 would count as maxima in N."""
MAP_LEVEL = 4
"""Open: (+) adds at the scale of the coarsest center, so that no map is upsampled."""
FLAT = 1e-12
"""Open: maximum range of a flat map, which is rounding."""
DIGITS = 9
"""Open: decimals to which a map in [0, 1] is rounded before its maxima are compared."""


@dataclass(frozen=True, eq=False, repr=False)
class Normalized:
    """A map after N."""

    map: FloatArray
    """(h, w) scaled to [0, 1], times the weight."""
    mean_of_maxima: float
    """m; 0 for a flat map."""
    weight: float
    """(1 - m)^2; 1 if there is only one maximum, 0 for a flat map."""
    maxima: IntArray
    """(k, 2) row and column of the local maxima whose mean is m."""


@dataclass(frozen=True, eq=False, repr=False)
class FeatureMap:
    """The contrast between a center and a surround level."""

    contrast: FloatArray
    """(h, w), as large as the center level."""
    normalized: Normalized
    """Contrast after N."""


@dataclass(frozen=True, eq=False, repr=False)
class ContrastSaliency:
    """The saliency map and all intermediate results; maps are (H / 16, W / 16), rounded up."""

    saliency: FloatArray
    """S, in [0, 1]."""
    intensity: FloatArray
    """The conspicuity map I."""
    color: FloatArray
    """The conspicuity map C."""
    orientation: FloatArray
    """The conspicuity map O."""
    channels: dict[str, FloatArray]
    """(H, W) "intensity", "red_green" and "blue_yellow"."""
    pyramids: dict[str, tuple[FloatArray, ...]]
    """Levels 0 to 8 of each channel and of "orientation_0", _45, _90 and _135."""
    features: dict[tuple[str, int, int], FeatureMap]
    """The 42 feature maps, by name of the pyramid, c and s."""
    sums: dict[str, Normalized]
    """N of the sums over scales in A.12 and A.13, by name of the pyramid."""
    conspicuity: dict[str, Normalized]
    """N(I), N(C) and N(O) of A.14: "intensity", "color" and "orientation"."""


def contrast_saliency(image: Image) -> ContrastSaliency:
    """Contrast saliency from intensity, color and orientation: the whole of appendix A.

    Takes any `saccade.types.Image` of at least 17 x 17 pixels; anything else raises `ImageError`.

    Examples:
        >>> image = np.full((320, 320, 3), 0.5)
        >>> image[60:70, 200:210] = 1, 0, 0  # a red square
        >>> S = contrast_saliency(image).saliency  # a sample every 16 pixels
        >>> print(np.argwhere(S == S.max()))
        [[ 4 13]]
    """
    rgb = as_rgb(image, dtype=np.float64)
    if min(rgb.shape[:2]) <= 2**MAP_LEVEL:  # the maps would be one row or one column
        raise ImageError(f"image: expected sides over {2**MAP_LEVEL} pixels, found {rgb.shape[:2]}")

    # Step 1: channels, and a pyramid of each
    channels = {each.__name__: each(rgb) for each in (intensity, red_green, blue_yellow)}
    P = {name: build_pyramid(channel) for name, channel in channels.items()}
    P |= {f"orientation_{theta}": oriented_pyramid(P["intensity"], theta) for theta in THETAS}

    # Step 2: contrast between centers and surrounds
    contrasts = {(p, c, s): across_scale_difference(P[p][c], P[p][s]) for p in P for c, s in SCALES}
    F = {key: FeatureMap(contrast, normalize(contrast)) for key, contrast in contrasts.items()}

    # Step 3: conspicuity maps
    shape = P["intensity"][MAP_LEVEL].shape
    added = {p: across_scale_sum([F[p, c, s].normalized.map for c, s in SCALES], shape) for p in P}
    I = added.pop("intensity")  # A.11
    N = {name: normalize(total) for name, total in added.items()}
    C = N["red_green"].map + N["blue_yellow"].map  # A.12
    O = np.sum([N[f"orientation_{theta}"].map for theta in THETAS], axis=0)  # A.13

    # Step 4: the saliency map
    M = {"intensity": normalize(I), "color": normalize(C), "orientation": normalize(O)}
    S = (M["intensity"].map + M["color"].map + M["orientation"].map) / 3  # A.14
    return ContrastSaliency(S, I, C, O, channels, P, features=F, sums=N, conspicuity=M)


def intensity(rgb: FloatArray) -> FloatArray:
    """I, (H, W) of (H, W, 3)."""
    return (rgb[..., R] + rgb[..., G] + rgb[..., B]) / 3  # A.1


def red_green(rgb: FloatArray) -> FloatArray:
    """RG, (H, W) of (H, W, 3)."""
    return (rgb[..., R] - rgb[..., G]) / rgb.max(-1, initial=BLACK)  # A.2


def blue_yellow(rgb: FloatArray) -> FloatArray:
    """BY, (H, W) of (H, W, 3)."""
    return (rgb[..., B] - np.minimum(rgb[..., R], rgb[..., G])) / rgb.max(-1, initial=BLACK)  # A.3


def low_pass(image: FloatArray) -> FloatArray:
    """I'[l-1] of I[l-1]."""
    return convolve(image, KERNEL, mode=BORDER)  # A.4


def every_second_sample(image: FloatArray) -> FloatArray:
    """I[l] of I'[l-1]: half as high and wide, rounded up."""
    return image[::2, ::2]  # A.5


def build_pyramid(channel: FloatArray) -> tuple[FloatArray, ...]:
    """I[l], RG[l] or BY[l] at every level."""
    levels = [channel]
    for _ in range(8):  # l = 1 to 8
        levels.append(every_second_sample(low_pass(levels[-1])))
    return tuple(levels)


def gabor_kernel(degrees: float) -> FloatArray:
    """G_theta, (15, 15), of sum 0."""
    y, x = np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1]
    across = y * np.cos(np.radians(degrees)) - x * np.sin(np.radians(degrees))
    envelope = np.exp(-(x**2 + y**2) / (2 * SIGMA**2))
    wave = np.cos(2 * np.pi * across / WAVELENGTH + PHASE)
    return envelope * (wave - np.average(wave, weights=envelope))


def oriented_pyramid(pyramid: tuple[FloatArray, ...], degrees: float) -> tuple[FloatArray, ...]:
    """O[l, theta] of I[l] at every level, signed."""
    return tuple(convolve(I, gabor_kernel(degrees), mode=BORDER) for I in pyramid)  # A.6


def across_scale_difference(center: FloatArray, surround: FloatArray) -> FloatArray:
    """I, RG, BY or O[c, s], as large as level c."""
    return np.abs(center - resize(surround, center.shape))  # A.7, A.8, A.9, A.10


def normalize(feature_map: FloatArray) -> Normalized:
    """N: promotes maps with few outstanding maxima, demotes those with many similar ones."""
    if np.ptp(feature_map) < FLAT:
        return Normalized(np.zeros(feature_map.shape), 0.0, 0.0, np.empty((0, 2), np.int64))
    scaled = (feature_map - feature_map.min()) / np.ptp(feature_map)  # N, 1
    scaled = np.round(scaled, DIGITS)
    tops = (scaled == maximum_filter(scaled, 3)) & (scaled >= 0.10)
    groups, k = label(tops, np.ones((3, 3)))  # touching tops are equal: one maximum
    maxima = np.array(maximum_position(scaled, groups, range(1, k + 1)))
    m = np.mean(scaled[tuple(maxima.T)])
    weight = (1 - m) ** 2 if k > 1 else 1.0  # corrected: a single maximum has m = 1
    return Normalized(scaled * weight, float(m), float(weight), maxima)  # N, 2


def across_scale_sum(maps: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """(+): all maps at one scale, added."""
    return np.sum([resize(each, shape) for each in maps], axis=0)


def resize(image: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """A level resized to another level; open: coarser by A.4 and A.5, finer by interpolation."""
    while np.any(np.greater(image.shape, shape)):
        image = every_second_sample(low_pass(image))
    step = 2 ** np.ceil(np.log2(np.divide(shape, image.shape)))  # from sample to sample
    return map_coordinates(image, np.indices(shape) / step[:, None, None], order=ORDER, mode=BORDER)
