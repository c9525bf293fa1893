"""Where people look whatever an image shows: its center, and not its border."""

import numpy as np

from saccade.types import FloatArray


def position_prior(
    shape: tuple[int, ...],
    center_sigma: float | None,
    center_height: float = 0.0,
    border_distance: float | None = None,
) -> FloatArray:
    """Factor of the saliency by the position alone.

    Args:
        shape: (h, w) cells that tile the image.
        center_sigma: standard deviation, as a fraction of each side, of a Gaussian about the
            center; None for no such factor.
        center_height: height of that Gaussian's center above the middle, as a fraction of the
            image's height.
        border_distance: distance d from the border, as a fraction of each side, in the factor
            `1 - exp(-distance / d)`; None for no such factor.

    Returns:
        (h, w) in [0, 1].
    """
    y, x = ((np.arange(side) + 0.5) / side - 0.5 for side in shape)
    prior = np.ones(shape)
    if center_sigma is not None:
        above, across = (y + center_height) / center_sigma, x / center_sigma
        prior *= np.outer(np.exp(-(above**2) / 2), np.exp(-(across**2) / 2))
    if border_distance is not None:
        distance = np.minimum(0.5 - abs(y)[:, None], 0.5 - abs(x))
        prior *= 1 - np.exp(-distance / border_distance)
    return prior
