"""Range-bearing observations as Cartesian ones and back; controls as relative poses."""

from collections.abc import Callable

import numpy as np

from saccade.errors import LogError
from saccade.types import FloatArray, LandmarkLog


def to_range_bearing(
    xy: FloatArray, covariance: FloatArray, name_of: Callable[[int], str]
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing of points in the robot's frame, to first order.

    Args:
        xy: (k, 2) forward and left in metres.
        covariance: (k, 2, 2) square metres.
        name_of: name of a point in the file, for the message.

    Returns:
        (k, 2) range and bearing, and their covariance (k, 2, 2).

    Raises:
        LogError: a point coincides with the robot, where it has no bearing.
    """
    x, y = xy[:, 0], xy[:, 1]
    r = np.hypot(x, y)
    for k in np.flatnonzero(r < 1e-9)[:1].tolist():
        raise LogError(f"{name_of(k)}: expected a landmark away from the robot, found range 0")
    J = np.empty((len(xy), 2, 2))
    J[:, 0, 0], J[:, 0, 1] = x / r, y / r
    J[:, 1, 0], J[:, 1, 1] = -y / r / r, x / r / r
    R = J @ covariance @ J.transpose(0, 2, 1)
    return np.stack([r, np.arctan2(y, x)], 1), (R + R.transpose(0, 2, 1)) / 2


def to_cartesian(observation: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points in the robot's frame, to first order: the inverse of `to_range_bearing`.

    Args:
        observation: (k, 2) range in metres, bearing in radians.
        covariance: (k, 2, 2).

    Returns:
        (k, 2) forward and left in metres, and their covariance (k, 2, 2).
    """
    r, c, s = observation[:, 0], np.cos(observation[:, 1]), np.sin(observation[:, 1])
    A = np.empty((len(observation), 2, 2))
    A[:, 0, 0], A[:, 0, 1] = c, -r * s
    A[:, 1, 0], A[:, 1, 1] = s, r * c
    return np.stack([r * c, r * s], 1), A @ covariance @ A.transpose(0, 2, 1)


def to_relative_poses(log: LandmarkLog) -> tuple[FloatArray, FloatArray]:
    """The controls of a log as relative poses: forward, left and turn.

    Returns:
        (t, 3), and their covariance (t, 3, 3), to first order.

    Raises:
        LogError: the controls are those of a custom motion model.
    """
    if log.motion == "custom":
        raise LogError(
            f"{log.name}: expected controls of drive or compose, found those of a "
            "custom motion model"
        )
    if log.motion == "compose":
        return log.control, log.control_covariance
    d, phi = log.control.T
    c, s = np.cos(phi), np.sin(phi)
    A = np.zeros((len(d), 3, 2))
    A[:, 0, 0], A[:, 0, 1] = c, -d * s
    A[:, 1, 0], A[:, 1, 1] = s, d * c
    A[:, 2, 1] = 1.0
    return np.stack([d * c, d * s, phi], 1), A @ log.control_covariance @ A.transpose(0, 2, 1)
