"""What contrast is looked for in: intensity, color opponency and orientation."""

from typing import Literal, get_args

import cv2
import numpy as np

from saccade.pyramid import FloatMap

Color = Literal["linear", "quotient"]
COLORS: tuple[Color, ...] = get_args(Color)


def intensity(rgb: FloatMap) -> FloatMap:
    """(H, W) mean of red, green and blue (A.1)."""
    return cv2.transform(rgb, np.full((1, 3), 1 / 3))


def linear_opponency(rgb: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Red against green and blue against yellow, as differences of lights.

    A dim color counts less than a bright one, so that no rule for the dark is needed.

    Args:
        rgb: (H, W, 3) in [0, 1].

    Returns:
        (H, W) red-green in [-1, 1] and blue-yellow in [-1, 1].
    """
    red_green = cv2.transform(rgb, np.array([[1.0, -1.0, 0.0]]))
    blue_yellow = cv2.transform(rgb, np.array([[-0.5, -0.5, 1.0]]))
    return red_green, blue_yellow


def quotient_opponency(rgb: FloatMap, dark: float) -> tuple[FloatMap, FloatMap]:
    """Red against green and blue against yellow, by the brightest color (A.2-A.3).

    Args:
        rgb: (H, W, 3) in [0, 1].
        dark: where no color reaches this, hue is noise and both are 0.

    Returns:
        (H, W) red-green in [-1, 1] and blue-yellow in [-1, 1].
    """
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    brightest = np.maximum(np.maximum(r, g), b)
    lit = (brightest >= dark) & (brightest > 0)
    scale = np.divide(1, brightest, out=np.zeros_like(brightest), where=lit)
    return (r - g) * scale, (b - np.minimum(r, g)) * scale  # A.2, A.3
