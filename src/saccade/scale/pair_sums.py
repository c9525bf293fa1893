"""Symmetry of gradients: sums over the pairs that face each other across a pixel, at one scale.

The phase weight of Reisfeld, Wolfson & Yeshurun (1995) is a square: with gamma the angle of a
gradient from the line through the pair, and p = cos(gamma),

    (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j)) = (p_i - p_j)^2

so that neither an angle nor a cosine need be computed.
"""

from collections.abc import Callable

import cv2
import numpy as np

from saccade.scale._pair_sums_kernels import (
    MARGIN,
    add_isotropic,
    add_radial,
)
from saccade.scale._pair_sums_kernels import Gradients as Gradients
from saccade.scale._pair_sums_kernels import PairKernel as PairKernel
from saccade.scale.pyramid import FloatMap
from saccade.types import Float32Array

TINY = 1e-30
"""Magnitude below which a gradient has no direction."""


def pair_kernel(inner: int, outer: int, sigma: float) -> PairKernel:
    """The pairs on a square ring, weighted by the normal density at their distance.

    Args:
        inner: smallest distance from the pixel, along x or y, in pixels.
        outer: largest distance, likewise.
        sigma: standard deviation of the normal density of the distance between the two.
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
        gain: of the magnitude in the strength; larger values saturate sooner.
        border: OpenCV's border type.
    """
    plane = np.ascontiguousarray(channel, np.float32)
    cosine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 1, 0, borderType=border)
    sine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 0, 1, borderType=border)
    magnitude = np.sqrt(cosine * cosine + sine * sine)
    inverse = 1 / np.maximum(magnitude, np.float32(TINY))
    cosine *= inverse
    sine *= inverse
    magnitude *= np.float32(gain)
    return Gradients(np.log1p(magnitude, out=magnitude), cosine, sine)


def isotropic_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) sum over the pairs inside the image, and over the channels.

    Args:
        channels: gradients of equal shape.
        pairs: which count.
    """
    return sums_of(add_isotropic, channels, pairs)


def radial_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """`isotropic_sums` with each pair weighted by its axis's angle from the strongest one's.

    The axis of a pair is phi = (theta_i + theta_j) / 2, its weight sin^2(phi - phi_max): a pixel
    with a single axis of symmetry has none.
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
    distance = np.arange(-MARGIN, reach + 1)  # from a pixel to the outermost that takes part
    fits = (distance[:, None, None] >= pairs.offsets[:, 1]) & (
        distance[None, :, None] >= np.abs(pairs.offsets[:, 0])
    )
    weights = pairs.weights.astype(np.float64)
    fraction = (fits @ weights / weights.sum()).astype(np.float32)
    y, x = (
        np.minimum(np.arange(side), np.arange(side)[::-1]).clip(0, reach + MARGIN) for side in shape
    )
    return np.asarray(fraction[np.ix_(y, x)])
