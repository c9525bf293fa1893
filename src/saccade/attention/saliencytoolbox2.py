"""The contrast model's steps as Walther & Koch's SaliencyToolbox 2 takes them.

Written from a description of what that program computes, which its outputs confirm to the last
digits. It differs from the equations in brightness, an asymmetric pyramid kernel, borders,
comparison at the size of the map by nearest neighbors, faded borders and the ranges of N.
Borders are "energy-preserving": what of a kernel lies inside the image counts for the whole.

Source: Walther & Koch (2006), *Modeling attention to salient proto-objects*.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention import channels
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.normalize import inhibit_laterally
from saccade.image import as_rgb
from saccade.pyramid import FloatMap, gabor_pair, resize

LUMA = (0.298936, 0.587043, 0.114021)
"""Brightness by red, green and blue."""
KERNEL = np.array([1, 5, 10, 10, 5, 1, 1]) / 33
"""Of the pyramids, applied as a convolution."""
SHORT_KERNELS = {1: np.array([1.0]), 2: np.array([1, 1]) / 2, 3: np.array([1, 2, 1]) / 4}
"""What reduces an axis of so few samples to one, where the image is short along either."""
FEATURE_RANGE = 10.0
"""To which a feature map is scaled before it is weighted."""
SALIENCY_RANGE = 2.0
"""To which the saliency map is scaled."""
FADED_BORDER = 1 / 20
"""Part of the longer side that fades to nothing at each border of a feature map."""


@dataclass(frozen=True)
class SaliencyToolbox2Steps:
    """The counterpart of `saccade.attention.mirrored.MirroredSteps`, in double precision."""

    config: ContrastConfig
    dtype: ClassVar[type[np.floating[Any]]] = np.float64

    @staticmethod
    def deepest_level(shape: tuple[int, int]) -> int:
        """The first level whose shorter side is a single pixel."""
        return min(shape).bit_length() - 1

    @staticmethod
    def level_shape(shape: tuple[int, int], level: int) -> tuple[int, int]:
        """Sides are halved and rounded down, but not to less than a pixel."""
        return max(1, shape[0] >> level), max(1, shape[1] >> level)

    def channels(
        self, pixels: npt.NDArray[Any], finest: int
    ) -> tuple[int, FloatMap, dict[str, FloatMap]]:
        """Level 0, intensity and opponents there (A.1-A.3)."""
        del finest
        rgb = whole_levels(as_rgb(pixels, dtype=self.dtype))
        brightness = rgb @ np.array(LUMA)
        if self.config.color == "linear":
            red_green, blue_yellow = channels.linear_opponency(rgb)
        else:
            red_green, blue_yellow = channels.quotient_opponency(rgb, self.config.dark)
        return 0, brightness, {"red-green": red_green, "blue-yellow": blue_yellow}

    @staticmethod
    def halve(level: FloatMap) -> FloatMap:
        """Every other sample of the smoothed level, without the last of an odd number (A.4-A.5)."""
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

    def oriented(self, level: FloatMap) -> list[FloatMap]:
        """The sum of the magnitudes of an even and an odd response, zeros around (A.6)."""
        config = self.config
        maps = []
        for angle in config.orientations:
            pair = gabor_pair(
                np.deg2rad(angle), config.gabor_period, config.gabor_sigma, config.gabor_size
            )
            even, odd = (
                np.abs(cv2.filter2D(level, -1, filter_, borderType=cv2.BORDER_CONSTANT))
                for filter_ in pair
            )
            maps.append(even + odd)
        return maps

    resize = staticmethod(resize)

    @staticmethod
    def contrast(center: FloatMap, surround: FloatMap, map_shape: tuple[int, int]) -> FloatMap:
        """How far center and surround are apart at the size of the map (A.7-A.10)."""
        difference = np.abs(nearest(center, map_shape) - nearest(surround, map_shape))
        return fade_borders(difference)

    def normalize(self, values: FloatMap) -> FloatMap:
        """N of a feature map."""
        return self._promote(rescale(values, FEATURE_RANGE), FEATURE_RANGE)

    def normalize_sum(self, values: FloatMap) -> FloatMap:
        """N of a sum of promoted maps, whose range tells how strong they are and is kept."""
        return self._promote(np.maximum(values, 0), None)

    def conspicuity(self, parts: Sequence[FloatMap]) -> FloatMap:
        """N of the mean of the sub-features, by the number of features (A.11-A.13)."""
        config = self.config
        weights = (config.intensity_weight, config.color_weight, config.orientation_weight)
        features = sum(weight > 0 for weight in weights)
        return self.normalize_sum(sum(parts[1:], start=parts[0])) / len(parts) / features

    def saliency(self, intensity: FloatMap, color: FloatMap, orientation: FloatMap) -> FloatMap:
        """N of the weighted sum (A.14)."""
        config = self.config
        w_I, w_C, w_O = config.intensity_weight, config.color_weight, config.orientation_weight
        weighted = w_I * intensity + w_C * color + w_O * orientation
        return self._promote(rescale(weighted, SALIENCY_RANGE), SALIENCY_RANGE)

    def _promote(self, values: FloatMap, top: float | None) -> FloatMap:
        """A map of the range [0, top], or of any range, weighted by the chosen normalization."""
        config = self.config
        if config.normalization == "iterative":
            return inhibit_laterally(values, config.iterations, narrowest=0)
        if config.normalization == "none":
            return values
        if top is None:
            return promote_by_maxima(values, float(values.max()), 1.0)
        return promote_by_maxima(values, top, config.maxima_threshold * top)


def whole_levels(rgb: FloatMap) -> FloatMap:
    """An image of 8 or 16 bit that went through float32, as if it had not.

    float32 does not hold k / 255: what is that far from whole levels everywhere was whole.

    Args:
        rgb: (H, W, 3) float64.
    """
    for top in (255, 65535):
        levels = np.rint(rgb * top)
        if np.abs(levels - rgb * top).max() <= top * np.finfo(np.float32).eps:
            whole: FloatMap = levels / top
            return whole
    return rgb


def nearest(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """The map at another size by nearest neighbors, the lower one at a tie."""
    rows, columns = (
        (2 * np.arange(1, new + 1) - 1) * old // (2 * new)
        for old, new in zip(values.shape, shape, strict=True)
    )
    return values[np.ix_(rows, columns)]


def fade_borders(values: FloatMap) -> FloatMap:
    """The map times a ramp from nothing at each border."""
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
    """The map stretched to [0, top]; the middle of the range where it is flat."""
    values = np.maximum(values, 0)
    low, high = values.min(), values.max()
    if high == low:
        return np.full_like(values, top / 2)
    scaled: FloatMap = (values - low) / (high - low) * top
    return scaled


def promote_by_maxima(values: FloatMap, top: float, threshold: float) -> FloatMap:
    """The map times `(top - m)^2`, m the mean of the local maxima; `top^2` for one or none.

    A local maximum lies inside the border, reaches the threshold, and none of its four
    neighbors is higher. Where there is none the toolbox stops with an error.
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
    smooth = cv2.filter2D(level, -1, line, borderType=cv2.BORDER_CONSTANT)
    inside = np.convolve(np.ones(level.shape[axis]), KERNEL)[len(KERNEL) // 2 :]
    inside = inside[: level.shape[axis]]
    whole: FloatMap = smooth / (inside[:, None] if axis == 0 else inside)
    return whole
