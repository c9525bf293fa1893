"""The contrast model's steps on images that are mirrored at their borders: those of the default."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention import channels
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.normalize import normalize
from saccade.image import as_rgb
from saccade.pyramid import FloatMap, deepest_level, gabor_energies, halve, level_shape, resize


@dataclass(frozen=True)
class MirroredSteps:
    """The steps of the model on images that are mirrored at their borders."""

    config: ContrastConfig
    dtype: ClassVar[type[np.floating[Any]]] = np.float32

    deepest_level = staticmethod(deepest_level)
    level_shape = staticmethod(level_shape)
    halve = staticmethod(halve)  # A.4-A.5

    @staticmethod
    def resize(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
        """A map at another size."""
        return resize(values, shape)

    def channels(
        self, pixels: npt.NDArray[Any], finest: int
    ) -> tuple[int, FloatMap, dict[str, FloatMap]]:
        """The finest level whose channels are needed, and intensity and opponents there.

        Linear channels of the coarser image are the coarser level of the channels, so that it
        need not be converted before: in 8 bit it is a quarter as large.
        """
        linear = self.config.color == "linear"
        start = finest if linear else 0
        colors = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[:, :, :3])
        for _ in range(start):
            colors = self.halve(colors)
        rgb = as_rgb(colors, dtype=self.dtype)  # (h, w, 3)
        if linear:
            red_green, blue_yellow = channels.linear_opponency(rgb)
        else:
            red_green, blue_yellow = channels.quotient_opponency(rgb, self.config.dark)  # A.2-A.3
        opponents = {"red-green": red_green, "blue-yellow": blue_yellow}
        return start, channels.intensity(rgb), opponents  # A.1

    def oriented(self, level: FloatMap) -> list[FloatMap]:
        """One map for each orientation (A.6)."""
        config = self.config
        angles = [float(np.deg2rad(angle)) for angle in config.orientations]
        return gabor_energies(
            level, angles, config.gabor_period, config.gabor_sigma, config.gabor_size
        )

    def contrast(
        self, center: FloatMap, surround: FloatMap, map_shape: tuple[int, int]
    ) -> FloatMap:
        """How far the center is from its surround (A.7-A.10)."""
        difference = cv2.absdiff(center, self.resize(surround, center.shape))
        at_map = self.config.normalize_at == "map"
        return self.resize(difference, map_shape) if at_map else difference

    def normalize(self, values: FloatMap) -> FloatMap:
        """N."""
        config = self.config
        return normalize(
            values,
            config.normalization,
            threshold=config.maxima_threshold,
            radius=config.maxima_radius,
            iterations=config.iterations,
        )

    normalize_sum = normalize

    def conspicuity(self, parts: Sequence[FloatMap]) -> FloatMap:
        """The sum of its parts (A.11-A.13)."""
        return sum(parts[1:], start=parts[0])

    def saliency(self, intensity: FloatMap, color: FloatMap, orientation: FloatMap) -> FloatMap:
        """The weighted mean of what is conspicuous (A.14)."""
        N, config = self.normalize, self.config
        w_I, w_C, w_O = config.intensity_weight, config.color_weight, config.orientation_weight
        weighted = w_I * N(intensity) + w_C * N(color) + w_O * N(orientation)
        return weighted / (w_I + w_C + w_O)
