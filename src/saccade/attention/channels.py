"""Feature channels of the contrast model: intensity, color opponency and orientation."""

from typing import Literal, NamedTuple

import cv2
import numpy as np

from saccade.scale.pyramid import FloatMap

Color = Literal["linear", "quotient"]
ChannelName = Literal["intensity", "red-green", "blue-yellow", "orientation"]
Conspicuity = Literal["intensity", "color", "orientation"]

CONSPICUITY: dict[ChannelName, Conspicuity] = {
    "intensity": "intensity",
    "red-green": "color",
    "blue-yellow": "color",
    "orientation": "orientation",
}
"""Conspicuity map to which each channel contributes (A.11-A.13)."""

OPPONENT = np.array([[1 / 3, 1 / 3, 1 / 3], [1, -1, 0], [-0.5, -0.5, 1]])
"""Intensity (A.1), red-green and blue-yellow as linear functions of red, green and blue."""


LEAST_VARIANCE = 1.0
"""Smallest variance of a whitened channel: one unit of L*a*b* is barely visible."""


class Channel(NamedTuple):
    """A feature channel; each orientation is a channel of its own."""

    name: ChannelName
    angle: float | None = None
    """Direction of the bars in degrees, from x towards y; None for other channels."""


def intensity(rgb: FloatMap) -> FloatMap:
    """(H, W) mean of red, green and blue (A.1)."""
    return cv2.transform(rgb, OPPONENT[:1])


def opponency(rgb: FloatMap, color: Color, dark: float) -> dict[ChannelName, FloatMap]:
    """(H, W) red-green and blue-yellow, each in [-1, 1].

    Args:
        rgb: (H, W, 3) in [0, 1].
        color: "linear" or "quotient".
        dark: see `quotient_opponency`.
    """
    quotient = color == "quotient"
    planes = quotient_opponency(rgb, dark) if quotient else linear_opponency(rgb)
    return {"red-green": planes[0], "blue-yellow": planes[1]}


def linear_opponency(rgb: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Red-green and blue-yellow as differences of intensities.

    A dim color counts less than a bright one, so that dark pixels need no threshold.
    """
    return cv2.transform(rgb, OPPONENT[1:2]), cv2.transform(rgb, OPPONENT[2:])


def quotient_opponency(rgb: FloatMap, dark: float) -> tuple[FloatMap, FloatMap]:
    """Red-green and blue-yellow divided by the brightest color (A.2-A.3).

    Args:
        rgb: (H, W, 3) in [0, 1].
        dark: minimum value of the brightest color; in darker pixels hue is noise and both are 0.
    """
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    brightest = np.maximum(np.maximum(r, g), b)
    lit = (brightest >= dark) & (brightest > 0)
    scale = np.divide(1, brightest, out=np.zeros_like(brightest), where=lit)
    return (r - g) * scale, (b - np.minimum(r, g)) * scale  # A.2, A.3


def whitened(colors: FloatMap) -> FloatMap:
    """Decorrelated color channels of unit variance: principal components of CIE L*a*b*.

    Components with a variance below `LEAST_VARIANCE` are not amplified to unit variance, so that
    noise in a gray photograph does not become color.

    Args:
        colors: (h, w) gray or (h, w, 3) RGB, in [0, 1].

    Returns:
        (h, w, 3).
    """
    rgb = np.repeat(colors[:, :, None], 3, 2) if colors.ndim == 2 else np.ascontiguousarray(colors)
    lab = cv2.cvtColor(rgb.astype(np.float32, copy=False), cv2.COLOR_RGB2LAB)
    lab -= lab.mean((0, 1), dtype=np.float64).astype(np.float32)
    planes = [lab[:, :, i] for i in range(3)]
    covariance = [[(a * b).mean(dtype=np.float64) for b in planes] for a in planes]
    values, vectors = np.linalg.eigh(np.array(covariance))
    return cv2.transform(lab, (vectors / np.sqrt(np.maximum(values, LEAST_VARIANCE))).T)
