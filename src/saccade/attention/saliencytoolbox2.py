"""The steps of the contrast model in Walther & Koch's SaliencyToolbox 2.

Written from a description of the program's computation; results agree with its outputs to the last
digits. It differs from the equations in the weights of brightness, an asymmetric pyramid kernel,
borders, nearest-neighbor comparison at the size of the map, faded borders and the ranges of N.
Borders are "energy-preserving": a kernel is normalized by its part inside the image.

Source: Walther & Koch (2006), *Modeling attention to salient proto-objects*.
"""

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import ChannelName, opponency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.contrast_steps import Shape, Steps, add, gabor_pair, gabors, weighted_sum
from saccade.attention.normalize import fraction_inside, inhibit_laterally
from saccade.io.image import in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, resize

BRIGHTNESS_WEIGHTS = (0.298936, 0.587043, 0.114021)
"""Brightness by red, green and blue."""
KERNEL = np.array([1, 5, 10, 10, 5, 1, 1]) / 33
"""Kernel of the pyramids, applied as a convolution."""
SHORT_KERNELS = {1: np.array([1.0]), 2: np.array([1, 1]) / 2, 3: np.array([1, 2, 1]) / 4}
"""Kernels that reduce an axis of 1, 2 or 3 samples to one, for images with a short side."""
FEATURE_RANGE = 10.0
"""Maximum of a feature map before it is weighted."""
SALIENCY_RANGE = 2.0
"""Maximum of the saliency map before it is weighted."""
FADED_BORDER = 1 / 20
"""Width of the ramp at each border of a feature map, as a fraction of its longer side."""


def level_shape(shape: Shape, level: int) -> Shape:
    """Shape of a level: each halving rounds down, to at least one pixel."""
    return max(1, shape[0] >> level), max(1, shape[1] >> level)


def split_channels(
    pixels: npt.NDArray[Any], config: ContrastConfig, finest: int
) -> tuple[int, dict[ChannelName, FloatMap]]:
    """Intensity and color opponency at level 0 (A.1-A.3)."""
    del finest
    rgb = whole_levels(repeat_gray(in_unit_range(pixels, np.float64)))
    opponents = opponency(rgb, config.color, config.dark)
    return 0, {"intensity": rgb @ np.array(BRIGHTNESS_WEIGHTS), **opponents}


def halve(level: FloatMap) -> FloatMap:
    """Smoothed level, subsampled by two; the last sample of an odd side is dropped (A.4-A.5)."""
    short = min(level.shape) <= max(SHORT_KERNELS)
    for axis in (0, 1):
        side = level.shape[axis]
        if short and side in SHORT_KERNELS:
            level = np.tensordot(SHORT_KERNELS[side], level, axes=(0, axis))
            level = np.expand_dims(level, axis)
        else:
            level = _smooth_along(level, axis)
            level = level[: side // 2 * 2 : 2] if axis == 0 else level[:, : side // 2 * 2 : 2]
    return level


def orientations(level: FloatMap, config: ContrastConfig) -> list[FloatMap]:
    """Sum of the magnitudes of an even and an odd Gabor response, zero-padded (A.6)."""
    responses = (
        [cv2.filter2D(level, -1, each, borderType=cv2.BORDER_CONSTANT) for each in pair]
        for pair in (gabor_pair(*gabor) for gabor in gabors(config))
    )
    return [np.abs(even) + np.abs(odd) for even, odd in responses]


def difference(
    center: FloatMap, surround: FloatMap, map_shape: Shape, config: ContrastConfig
) -> FloatMap:
    """Absolute difference of center and surround at the size of the map (A.7-A.10)."""
    del config
    return fade_borders(np.abs(nearest(center, map_shape) - nearest(surround, map_shape)))


def normalize(values: FloatMap, config: ContrastConfig, top: float | None = None) -> FloatMap:
    """N of a map in [0, top]; without `top`, of a map of any range."""
    return NORMALIZATIONS[str(config.normalization)](values, config, top)


def normalize_by_maxima(values: FloatMap, config: ContrastConfig, top: float | None) -> FloatMap:
    """The toolbox's `LocalMax`."""
    if top is None:
        return promote_by_maxima(values, float(values.max()), 1.0)
    return promote_by_maxima(values, top, config.maxima_threshold * top)


def normalize_iteratively(values: FloatMap, config: ContrastConfig, top: float | None) -> FloatMap:
    """The toolbox's `Iterative`."""
    del top
    return inhibit_laterally(values, config.iterations, min_sigma=0)


NORMALIZATIONS: dict[str, Callable[[FloatMap, ContrastConfig, float | None], FloatMap]] = {
    "local-maxima": normalize_by_maxima,
    "iterative": normalize_iteratively,
    "none": lambda values, config, top: values,
}
"""The toolbox's own normalizations, by their names in `saccade.attention.normalize`."""


def normalize_feature(values: FloatMap, config: ContrastConfig) -> FloatMap:
    """N of a feature map."""
    return normalize(rescale(values, FEATURE_RANGE), config, FEATURE_RANGE)


def normalize_sum(values: FloatMap, config: ContrastConfig) -> FloatMap:
    """N of a sum of normalized maps; its range is kept."""
    return normalize(np.maximum(values, 0), config)


def conspicuity(parts: Sequence[FloatMap], config: ContrastConfig) -> FloatMap:
    """N of the mean of the parts, divided by the number of features (A.11-A.13)."""
    features = sum(weight > 0 for weight in config.weights)
    return normalize_sum(add(parts, config), config) / len(parts) / features


def saliency(
    intensity: FloatMap, color: FloatMap, orientation: FloatMap, config: ContrastConfig
) -> FloatMap:
    """N of the weighted sum (A.14)."""
    weighted = weighted_sum(intensity, color, orientation, config)
    return normalize(rescale(weighted, SALIENCY_RANGE), config, SALIENCY_RANGE)


def whole_levels(rgb: FloatMap) -> FloatMap:
    """Undoes the rounding of an image of 8 or 16 bit that passed through float32.

    float32 cannot represent k / 255; an image that is within its precision of integer levels is
    rounded to them.

    Args:
        rgb: (H, W, 3) float64.
    """
    for top in (255, 65535):
        levels = np.rint(rgb * top)
        if np.abs(levels - rgb * top).max() <= top * np.finfo(np.float32).eps:
            restored: FloatMap = levels / top
            return restored
    return rgb


def nearest(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """The map resized by nearest neighbors; ties take the lower index."""
    rows, columns = (
        (2 * np.arange(1, new + 1) - 1) * old // (2 * new)
        for old, new in zip(values.shape, shape, strict=True)
    )
    return values[np.ix_(rows, columns)]


def fade_borders(values: FloatMap) -> FloatMap:
    """The map multiplied by a linear ramp that starts from 0 at each border."""
    width = int(max(values.shape) * FADED_BORDER + 0.5)
    faded = values.copy()
    for k in range(1, min(width, *values.shape) + 1):
        ramp = k / (width + 1)
        faded[k - 1] *= ramp
        faded[-k] *= ramp
        faded[:, k - 1] *= ramp
        faded[:, -k] *= ramp
    return faded


def rescale(values: FloatMap, top: float) -> FloatMap:
    """The map scaled linearly to [0, top]; top / 2 where it is flat."""
    values = np.maximum(values, 0)
    low, high = values.min(), values.max()
    if high == low:
        return np.full_like(values, top / 2)
    scaled: FloatMap = (values - low) / (high - low) * top
    return scaled


def promote_by_maxima(values: FloatMap, top: float, threshold: float) -> FloatMap:
    """The map times `(top - m)^2`, with the mean m of the local maxima; `top^2` for 0 or 1 maximum.

    A local maximum lies off the border, reaches the threshold and is at least as high as its four
    neighbors. Without any maximum the toolbox stops with an error.
    """
    middle = values[1:-1, 1:-1]
    higher = np.zeros(middle.shape, bool)
    for neighbor in (values[:-2, 1:-1], values[2:, 1:-1], values[1:-1, :-2], values[1:-1, 2:]):
        higher |= neighbor > middle
    maxima = middle[~higher & (middle >= threshold)]
    mean = float(maxima.mean()) if len(maxima) > 1 else 0.0
    return values * (top - mean) ** 2


def _smooth_along(level: FloatMap, axis: int) -> FloatMap:
    """The level convolved with the pyramid's kernel along an axis, borders energy-preserving."""
    kernel = KERNEL[::-1]  # OpenCV correlates
    line = kernel[:, None] if axis == 0 else kernel[None]
    filtered = cv2.filter2D(level, -1, line, borderType=cv2.BORDER_CONSTANT)
    inside = fraction_inside(KERNEL, level.shape[axis])
    smooth: FloatMap = filtered / (inside[:, None] if axis == 0 else inside)
    return smooth


SALIENCYTOOLBOX2 = Steps(
    level_shape=level_shape,
    deepest_level=lambda shape: min(shape).bit_length() - 1,
    split_channels=split_channels,
    halve=halve,
    orientations=orientations,
    difference=difference,
    resize=resize,
    normalize=normalize_feature,
    normalize_sum=normalize_sum,
    conspicuity=conspicuity,
    saliency=saliency,
)
"""The steps of SaliencyToolbox 2, in double precision."""
