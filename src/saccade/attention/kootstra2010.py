"""The steps of the contrast model as equations A.4-A.14 print them.

What the print leaves open is as in `saccade.textbook.contrast_saliency`: a binomial kernel,
replicated borders, linear interpolation of a coarser level, whose sample k stands at sample 2 k of
the finer one, and a single even Gabor filter.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from saccade.attention.mirrored import MirroredArithmetic
from saccade.attention.normalize import rescale
from saccade.scale.pyramid import FloatMap, level_shape

BORDER = cv2.BORDER_REPLICATE
EQUAL_DIGITS = 9
"""Values of a map in [0, 1] that agree to so many decimals are equal."""


@dataclass(frozen=True)
class Kootstra2010Arithmetic(MirroredArithmetic):
    """The printed steps, in double precision."""

    dtype: ClassVar[type[np.floating[Any]]] = np.float64

    @staticmethod
    def halve(level: FloatMap) -> FloatMap:
        """Every second sample of the smoothed level, beginning with the first (A.4-A.5)."""
        return cv2.pyrDown(level, borderType=BORDER)

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
            borderMode=BORDER,
        )

    def orientation_responses(self, level: FloatMap) -> list[FloatMap]:
        """The signed response to one even Gabor filter for each orientation (A.6)."""
        return [cv2.filter2D(level, -1, even, borderType=BORDER) for even, _ in self.gabor_pairs]

    def normalize(self, values: FloatMap) -> FloatMap:
        """N; maxima that differ by rounding are equal."""
        return super().normalize(np.round(rescale(values), EQUAL_DIGITS))
