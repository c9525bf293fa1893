"""The steps of the contrast model: on images mirrored at their borders, and as they are printed.

What the print of A.4-A.14 leaves open is as in `saccade.textbook.contrast_saliency`: a binomial
kernel, replicated borders, linear interpolation of a coarser level, whose sample k stands at sample
2 k of the finer one, and a single even Gabor filter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import ChannelName, intensity, opponency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.gabor import gabor_energies, gabor_pair
from saccade.attention.normalize import normalize, rescale
from saccade.io.image import in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, deepest_level, halve, level_shape, resize
from saccade.types import FloatArray

PRINTED_BORDER = cv2.BORDER_REPLICATE
EQUAL_DIGITS = 9
"""Values of a printed map in [0, 1] that agree to so many decimals are equal."""


@dataclass(frozen=True)
class MirroredArithmetic:
    """The steps of the model; the published arithmetics override those in which they differ."""

    config: ContrastConfig
    dtype: ClassVar[type[np.floating[Any]]] = np.float32

    deepest_level = staticmethod(deepest_level)
    level_shape = staticmethod(level_shape)
    halve = staticmethod(halve)  # A.4-A.5

    @staticmethod
    def resize(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
        """A map at another size."""
        return resize(values, shape)

    def split_channels(
        self, pixels: npt.NDArray[Any], finest: int
    ) -> tuple[int, dict[ChannelName, FloatMap]]:
        """A pyramid level, at most `finest`, and intensity and opponents there (A.1-A.3).

        Linear channels commute with subsampling, so that the image is halved before it is
        converted: in 8 bit it is a quarter as large.
        """
        level = finest if self.config.color == "linear" else 0
        colors = pixels
        for _ in range(level):
            colors = self.halve(colors)
        rgb = repeat_gray(in_unit_range(colors, self.dtype))  # (h, w, 3)
        opponents = opponency(rgb, self.config.color, self.config.dark)
        return level, {"intensity": intensity(rgb), **opponents}

    def orientation_responses(self, level: FloatMap) -> list[FloatMap]:
        """One map for each orientation (A.6)."""
        config, angles = self.config, [float(np.deg2rad(a)) for a in self.config.orientations]
        return gabor_energies(
            level, angles, config.gabor_period, config.gabor_sigma, config.gabor_size
        )

    @property
    def gabor_pairs(self) -> list[tuple[FloatArray, FloatArray]]:
        """Even and odd filters for each orientation."""
        c = self.config
        return [
            gabor_pair(float(np.deg2rad(angle)), c.gabor_period, c.gabor_sigma, c.gabor_size)
            for angle in c.orientations
        ]

    def center_surround(
        self, center: FloatMap, surround: FloatMap, map_shape: tuple[int, int]
    ) -> FloatMap:
        """Absolute difference of center and surround (A.7-A.10)."""
        difference = cv2.absdiff(center, self.resize(surround, center.shape))
        at_map = self.config.normalize_at == "map"
        return self.resize(difference, map_shape) if at_map else difference

    def normalize(self, values: FloatMap) -> FloatMap:
        """N of a feature map."""
        config = self.config
        return normalize(
            values,
            config.normalization,
            threshold=config.maxima_threshold,
            radius=config.maxima_radius,
            iterations=config.iterations,
        )

    def normalize_sum(self, values: FloatMap) -> FloatMap:
        """N of a sum of normalized feature maps."""
        return self.normalize(values)

    def conspicuity(self, parts: Sequence[FloatMap]) -> FloatMap:
        """The sum of its parts (A.11-A.13)."""
        return sum(parts[1:], start=parts[0])

    def saliency(self, intensity: FloatMap, color: FloatMap, orientation: FloatMap) -> FloatMap:
        """The weighted mean of the normalized conspicuity maps (A.14)."""
        N = self.normalize
        weighted = self.weighted_sum(N(intensity), N(color), N(orientation))
        return weighted / sum(self.config.weights)

    def weighted_sum(self, *maps: FloatMap) -> FloatMap:
        """The maps of intensity, color and orientation times their weights."""
        w_I, w_C, w_O = self.config.weights
        return w_I * maps[0] + w_C * maps[1] + w_O * maps[2]


@dataclass(frozen=True)
class Kootstra2010Arithmetic(MirroredArithmetic):
    """The printed steps, in double precision."""

    dtype: ClassVar[type[np.floating[Any]]] = np.float64

    @staticmethod
    def halve(level: FloatMap) -> FloatMap:
        """Every second sample of the smoothed level, beginning with the first (A.4-A.5)."""
        return cv2.pyrDown(level, borderType=PRINTED_BORDER)

    @staticmethod
    def resize(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
        """A level at the size of another: coarser by A.4-A.5, finer by linear interpolation."""
        while values.shape[0] > shape[0] or values.shape[1] > shape[1]:
            values = Kootstra2010Arithmetic.halve(values)
        if values.shape == shape:
            return values
        octaves = next(n for n in range(64) if level_shape(shape, n) == values.shape)
        step = 0.5**octaves
        return cv2.warpAffine(
            values,
            np.array([[step, 0, 0], [0, step, 0]]),
            (shape[1], shape[0]),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=PRINTED_BORDER,
        )

    def orientation_responses(self, level: FloatMap) -> list[FloatMap]:
        """The signed response to one even Gabor filter for each orientation (A.6)."""
        return [
            cv2.filter2D(level, -1, even, borderType=PRINTED_BORDER) for even, _ in self.gabor_pairs
        ]

    def normalize(self, values: FloatMap) -> FloatMap:
        """N; maxima that differ by rounding are equal."""
        return super().normalize(np.round(rescale(values), EQUAL_DIGITS))
