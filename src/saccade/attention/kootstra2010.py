"""The contrast model's steps as equations A.4-A.14 print them.

What the print leaves open is as in `saccade.textbook.contrast_saliency`: a binomial kernel, borders
that go on as their outermost sample, linear interpolation between the samples of a coarser level,
of which sample k stands at sample 2 k of the finer one, and a single even Gabor filter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention import channels
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.normalize import normalize, rescale
from saccade.image import as_rgb
from saccade.pyramid import FloatMap, deepest_level, gabor_pair, level_shape

BORDER = cv2.BORDER_REPLICATE
EQUAL_DIGITS = 9
"""Values of a map in [0, 1] that agree to so many decimals are equally high."""


@dataclass(frozen=True)
class PrintedSteps:
    """The counterpart of `saccade.attention.contrast.MirroredSteps`, in double precision."""

    config: ContrastConfig
    dtype: ClassVar[type[np.floating[Any]]] = np.float64

    deepest_level = staticmethod(deepest_level)
    level_shape = staticmethod(level_shape)

    def channels(
        self, pixels: npt.NDArray[Any], finest: int
    ) -> tuple[int, FloatMap, dict[str, FloatMap]]:
        """Level 0, intensity and opponents there (A.1-A.3)."""
        del finest
        rgb = as_rgb(pixels, dtype=self.dtype)
        if self.config.color == "linear":
            red_green, blue_yellow = channels.linear_opponency(rgb)
        else:
            red_green, blue_yellow = channels.quotient_opponency(rgb, self.config.dark)
        return 0, channels.intensity(rgb), {"red-green": red_green, "blue-yellow": blue_yellow}

    @staticmethod
    def halve(level: FloatMap) -> FloatMap:
        """Every second sample of the smoothed level, beginning with the first (A.4-A.5)."""
        return cv2.pyrDown(level, borderType=BORDER)

    def oriented(self, level: FloatMap) -> list[FloatMap]:
        """The signed response to one even Gabor filter for each orientation (A.6)."""
        config = self.config
        wave = config.gabor_period, config.gabor_sigma, config.gabor_size
        filters = [gabor_pair(np.deg2rad(angle), *wave) for angle in config.orientations]
        return [cv2.filter2D(level, -1, even, borderType=BORDER) for even, _ in filters]

    @staticmethod
    def contrast(center: FloatMap, surround: FloatMap, map_shape: tuple[int, int]) -> FloatMap:
        """Absolute difference of center and surround at the size of the center (A.7-A.10)."""
        del map_shape
        return cv2.absdiff(center, resize(surround, center.shape[:2]))

    def normalize(self, values: FloatMap) -> FloatMap:
        """N."""
        config = self.config
        return normalize(
            np.round(rescale(values), EQUAL_DIGITS),
            config.normalization,
            threshold=config.maxima_threshold,
            radius=config.maxima_radius,
            iterations=config.iterations,
        )

    normalize_sum = normalize

    @staticmethod
    def resize(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
        """A level at the size of another."""
        return resize(values, shape)

    @staticmethod
    def conspicuity(parts: Sequence[FloatMap]) -> FloatMap:
        """The sum of its parts (A.11-A.13)."""
        return sum(parts[1:], start=parts[0])

    def saliency(self, intensity: FloatMap, color: FloatMap, orientation: FloatMap) -> FloatMap:
        """The weighted mean of the normalized conspicuity maps (A.14)."""
        N, config = self.normalize, self.config
        w_I, w_C, w_O = config.intensity_weight, config.color_weight, config.orientation_weight
        weighted = w_I * N(intensity) + w_C * N(color) + w_O * N(orientation)
        return weighted / (w_I + w_C + w_O)


def resize(level: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """A level at the size of another: coarser by A.4-A.5, finer by linear interpolation."""
    while level.shape[0] > shape[0] or level.shape[1] > shape[1]:
        level = PrintedSteps.halve(level)
    if level.shape == shape:
        return level
    octaves = next(n for n in range(64) if level_shape(shape, n) == level.shape)
    step = 0.5**octaves
    return cv2.warpAffine(
        level,
        np.array([[step, 0, 0], [0, step, 0]]),
        (shape[1], shape[0]),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=BORDER,
    )
