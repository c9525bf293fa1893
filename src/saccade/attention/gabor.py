"""Gabor filters: oriented responses in quadrature (A.6)."""

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np

from saccade.scale.pyramid import FloatMap
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
