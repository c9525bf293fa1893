"""The steps of the contrast model: on images mirrored at their borders, and as they are printed.

What the print of A.4-A.14 leaves open is as in `saccade.textbook.contrast_saliency`: a binomial
kernel, replicated borders, linear interpolation of a coarser level, whose sample k stands at sample
2 k of the finer one, and a single even Gabor filter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import ChannelName, intensity, opponency
from saccade.attention.contrast_config import ContrastConfig
from saccade.attention.normalize import normalize, rescale
from saccade.io.image import in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, deepest_level, halve, level_shape, resize
from saccade.types import FloatArray


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


def gabor_energy(image: FloatMap, angle: float, period: float, sigma: float, size: int) -> FloatMap:
    """(h, w) magnitude of the responses to a `gabor_pair` in quadrature (A.6), by its factors."""
    even_x, odd_x, (cos_y, sin_y) = gabor_factors(angle, period, sigma, size)
    mean = cv2.boxFilter(image, -1, (size, size), borderType=cv2.BORDER_REFLECT)

    def response(x: FloatArray, y: FloatArray) -> FloatMap | float:
        if not (x.any() and y.any()):  # a wave along one axis has no sine along the other
            return 0.0
        return cv2.sepFilter2D(image, -1, x, y, borderType=cv2.BORDER_REFLECT)

    even = response(even_x[0], cos_y) - float(even_x[0].sum() * cos_y.sum()) * mean
    even -= response(even_x[1], sin_y)
    odd = response(odd_x[0], sin_y) + response(odd_x[1], cos_y)
    energy = even * even + odd * odd  # cv2.magnitude rounds differently with where its input lies
    return np.sqrt(energy, out=energy)


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

    @property
    def gabors(self) -> list[tuple[float, float, float, int]]:
        """Arguments of `gabor_pair` for each orientation."""
        c = self.config
        return [
            (float(np.deg2rad(angle)), c.gabor_period, c.gabor_sigma, c.gabor_size)
            for angle in c.orientations
        ]

    def orientation_responses(self, level: FloatMap) -> list[FloatMap]:
        """One map for each orientation (A.6)."""
        return [gabor_energy(level, *gabor) for gabor in self.gabors]

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
            cv2.filter2D(level, -1, gabor_pair(*gabor)[0], borderType=PRINTED_BORDER)
            for gabor in self.gabors
        ]

    def normalize(self, values: FloatMap) -> FloatMap:
        """N; maxima that differ by rounding are equal."""
        return super().normalize(np.round(rescale(values), EQUAL_DIGITS))
