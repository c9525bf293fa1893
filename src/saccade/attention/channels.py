"""What contrast is looked for in: intensity, color opponency and orientation."""

import numpy as np

from saccade.pyramid import FloatMap


def intensity(rgb: FloatMap) -> FloatMap:
    """(H, W) mean of red, green and blue (A.1)."""
    return (rgb[..., 0] + rgb[..., 1] + rgb[..., 2]) / 3


def opponency(rgb: FloatMap, dark: float) -> tuple[FloatMap, FloatMap]:
    """Red against green and blue against yellow (A.2-A.3).

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
