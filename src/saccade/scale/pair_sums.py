"""Gradient symmetry at one scale: sums over pairs on opposite sides of a pixel.

The phase weight of Reisfeld, Wolfson & Yeshurun (1995) is a square: with gamma the angle of a
gradient from the line through the pair, and p = cos(gamma),

    (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j)) = (p_i - p_j)^2

so that no trigonometric functions are needed.
"""

from collections.abc import Callable

import cv2
import numpy as np

from saccade.scale._pair_sums_kernels import (
    BORDER_WIDTH,
    add_isotropic,
    add_radial,
)
from saccade.scale._pair_sums_kernels import Gradients as Gradients
from saccade.scale._pair_sums_kernels import PairKernel as PairKernel
from saccade.scale.pyramid import FloatMap
from saccade.types import Float32Array

MIN_GRADIENT = 1e-30
"""Minimum magnitude of a gradient with a direction."""


def pair_kernel(inner: int, outer: int, sigma: float) -> PairKernel:
    """Pairs on a square ring, with Gaussian weights of their distance.

    Args:
        inner: minimum distance from the pixel, along x or y, in pixels.
        outer: maximum distance from the pixel, along x or y, in pixels.
        sigma: standard deviation of the Gaussian weight of the pair's distance, in pixels.
    """
    offsets = np.array(
        [
            (dx, dy)
            for dy in range(outer + 1)
            for dx in range(-outer, outer + 1)
            if max(abs(dx), dy) >= inner and (dy > 0 or dx > 0)
        ]
    )
    radii = np.hypot(*offsets.T)
    density = np.exp(-((2 * radii) ** 2) / (2 * sigma**2)) / (sigma * np.sqrt(2 * np.pi))
    directions = offsets / radii[:, None]
    return PairKernel(offsets, directions.astype(np.float32), density.astype(np.float32))


def gradients_of(channel: FloatMap, gain: float, border: int = cv2.BORDER_REFLECT) -> Gradients:
    """Direction and strength of the gradients of a channel.

    Args:
        channel: (h, w), with a range of about 1.
        gain: gain of the magnitude; strengths saturate sooner with larger values.
        border: OpenCV's border type.
    """
    plane = np.ascontiguousarray(channel, np.float32)
    cosine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 1, 0, borderType=border)
    sine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 0, 1, borderType=border)
    magnitude = np.sqrt(cosine * cosine + sine * sine)
    inverse = 1 / np.maximum(magnitude, np.float32(MIN_GRADIENT))
    cosine *= inverse
    sine *= inverse
    magnitude *= np.float32(gain)
    return Gradients(np.log1p(magnitude, out=magnitude), cosine, sine)


def isotropic_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) sum over the pairs inside the image, and over the channels.

    Args:
        channels: gradients of equal shape.
        pairs: the pairs and weights.
    """
    return sums_of(add_isotropic, channels, pairs)


def radial_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """`isotropic_sums` with pairs weighted by the angle between their axis and the strongest axis.

    The axis of a pair is phi = (theta_i + theta_j) / 2 and its weight sin^2(phi - phi_max), so that
    the sum is 0 for a single axis of symmetry.
    """
    return sums_of(add_radial, channels, pairs)


def sums_of(add: Callable[..., None], channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) sums of a kernel over the channels."""
    sums, scaled = np.zeros_like(channels[0].strength), pairs.scaled()
    for gradients in channels:
        add(gradients, scaled, sums)
    return sums


def fraction_inside(shape: tuple[int, ...], pairs: PairKernel) -> Float32Array:
    """(h, w) fraction of the weight of all pairs that lies inside the image."""
    reach = int(np.abs(pairs.offsets).max())
    distance = np.arange(-BORDER_WIDTH, reach + 1)  # distance to the outermost pixel with pairs
    fits = (distance[:, None, None] >= pairs.offsets[:, 1]) & (
        distance[None, :, None] >= np.abs(pairs.offsets[:, 0])
    )
    weights = pairs.weights.astype(np.float64)
    fraction = (fits @ weights / weights.sum()).astype(np.float32)
    y, x = (
        np.minimum(np.arange(side), np.arange(side)[::-1]).clip(0, reach + BORDER_WIDTH)
        for side in shape
    )
    return np.asarray(fraction[np.ix_(y, x)])
