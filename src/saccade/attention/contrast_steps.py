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
    even, odd = _waves(angle, period, sigma, size)
    return even / np.linalg.norm(even), odd / np.linalg.norm(odd)


def gabor_energies(
    image: FloatMap, angles: Sequence[float], period: float, sigma: float, size: int
) -> list[FloatMap]:
    """Gabor energy: the magnitude of the responses to each pair in quadrature (A.6).

    The filters are those of `gabor_pair`. A wave in an isotropic window is a sum of two products
    of waves along x and y, which are separable and serve both diagonals.

    Args:
        image: (h, w) float32 or float64.
        angles: in radians, see `gabor_pair`.
        period: wavelength in pixels.
        sigma: standard deviation of the isotropic Gaussian window in pixels.
        size: side of the filters in pixels, odd.

    Returns:
        One (h, w) map for each angle.
    """
    offset = np.arange(size) - (size - 1) / 2
    window = np.exp(-(offset**2) / (2 * sigma**2))
    mean = cv2.boxFilter(image, -1, (size, size), borderType=cv2.BORDER_REFLECT)

    @cache
    def product(wave_x: str, kx: float, wave_y: str, ky: float, norm: float) -> FloatMap:
        """The response to a product of waves of zero mean, divided by the norm of the filter."""
        x, y = (
            window * (np.cos(k * offset) if wave == "cos" else np.sin(k * offset))
            for wave, k in ((wave_x, kx), (wave_y, ky))
        )
        filtered = cv2.sepFilter2D(image, -1, x / norm, y, borderType=cv2.BORDER_REFLECT)
        if wave_x == wave_y == "cos":
            return filtered - float(x.sum() * y.sum() / norm) * mean
        return filtered

    energies = []
    for angle in angles:
        kx, ky = (2 * np.pi / period * np.array([-np.sin(angle), np.cos(angle)])).round(12)
        slope = np.sign(kx * ky)
        kx, ky = abs(kx), abs(ky)
        even_norm, odd_norm = _norms(angle, period, sigma, size)
        even = product("cos", kx, "cos", ky, even_norm)
        if slope == 0:
            wave_x, wave_y = ("sin", "cos") if kx else ("cos", "sin")
            odd = product(wave_x, kx, wave_y, ky, odd_norm)
        else:
            sines = product("sin", kx, "sin", ky, even_norm)
            along_x, along_y = (
                product("sin", kx, "cos", ky, odd_norm),
                product("cos", kx, "sin", ky, odd_norm),
            )
            even = even - sines if slope > 0 else even + sines
            odd = along_x + along_y if slope > 0 else along_x - along_y
        # cv2.magnitude rounds differently with where its input lies in memory
        energy = even * even
        energy += odd * odd
        energies.append(np.sqrt(energy, out=energy))
    return energies


@cache
def _norms(angle: float, period: float, sigma: float, size: int) -> tuple[float, float]:
    """Norms of the filters of `gabor_pair`, rounded so that mirrored angles have equal ones."""
    even, odd = _waves(angle, period, sigma, size)
    return round(float(np.linalg.norm(even)), 12), round(float(np.linalg.norm(odd)), 12)


def _waves(angle: float, period: float, sigma: float, size: int) -> tuple[FloatArray, FloatArray]:
    """An even and an odd wave of zero mean in an isotropic window."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    across = y * np.cos(angle) - x * np.sin(angle)
    window = np.exp(-(x**2 + y**2) / (2 * sigma**2))
    phase = 2 * np.pi * across / period
    even, odd = (wave - wave.mean() for wave in (window * np.cos(phase), window * np.sin(phase)))
    return even, odd


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
