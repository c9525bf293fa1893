"""Observations in other forms, as range and bearing with their covariance."""

import numpy as np

from saccade.errors import LogError
from saccade.types import FloatArray


def to_range_bearing(
    xy: FloatArray, covariance: FloatArray, places: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing of points in the robot's frame, to first order.

    Args:
        xy: (k, 2) forward and left in metres.
        covariance: (k, 2, 2) square metres.
        places: (k,) where each came from, for the message.

    Returns:
        (k, 2) range and bearing, and their covariance (k, 2, 2).

    Raises:
        LogError: a point is at the robot itself, where it has no bearing.
    """
    x, y = xy[:, 0], xy[:, 1]
    r = np.hypot(x, y)
    if (r < 1e-9).any():
        where = places[int(np.argmax(r < 1e-9))]
        raise LogError(f"{where}: expected a landmark away from the robot, found range 0")
    J = np.empty((len(xy), 2, 2))
    J[:, 0, 0], J[:, 0, 1] = x / r, y / r
    J[:, 1, 0], J[:, 1, 1] = -y / r / r, x / r / r
    R = J @ covariance @ J.transpose(0, 2, 1)
    return np.stack([r, np.arctan2(y, x)], 1), (R + R.transpose(0, 2, 1)) / 2
