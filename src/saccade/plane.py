"""Geometry on the plane: composition and differences of poses, with covariances."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from saccade.errors import LogError
from saccade.motions import RelativePoses, find_motion, to_relative_poses
from saccade.types import BoolArray, FloatArray, LandmarkLog

MIN_BEARING_DISTANCE = 1e-9
"""Minimum distance in meters for a defined bearing."""


def rotations(angle: FloatArray) -> FloatArray:
    """(n, 2, 2) matrices that turn vectors by angles (n,) in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def rotated(xy: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (n, 2) turned by angles (n,) in radians."""
    x, y, c, s = *xy.T, np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y], 1)


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """Second poses (n, 3) in the frames of the first (n, 3): meters ahead and left, radians."""
    east, north, turn = (second - first).T
    c, s = np.cos(first[:, 2]), np.sin(first[:, 2])
    turn = turn - 2 * np.pi * np.rint(turn / (2 * np.pi))
    return np.stack([c * east + s * north, c * north - s * east, turn], 1)


def steps_between(pose: FloatArray) -> FloatArray:
    """Each pose (n, 3) in the frame of the previous, (n - 1, 3): meters ahead and left, radians."""
    return relative_poses(pose[:-1], pose[1:])


def path_of(steps: FloatArray) -> FloatArray:
    """Poses (n + 1, 3) from the origin by steps (n, 3) as of `steps_between`.

    Headings are not wrapped.
    """
    pose = np.zeros((len(steps) + 1, 3))
    np.cumsum(steps[:, 2], out=pose[1:, 2])
    np.cumsum(rotated(steps[:, :2], pose[:-1, 2]), 0, out=pose[1:, :2])
    return pose


def to_points(observation: FloatArray) -> FloatArray:
    """Points (k, 2), meters ahead and left, of ranges and bearings (k, 2)."""
    r, bearing = observation.T
    return np.stack([r * np.cos(bearing), r * np.sin(bearing)], 1)


def point_covariance(observation: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariances (k, 2, 2) of the points of ranges and bearings, by theirs, to first order."""
    A = rotations(observation[:, 1])
    A[:, :, 1] *= observation[:, :1]
    return np.asarray(A @ covariance @ A.transpose(0, 2, 1))


def to_range_bearing(
    xy: FloatArray, covariance: FloatArray, name_of: Callable[[int], str]
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing (k, 2) of points in the robot's frame, and their covariance (k, 2, 2).

    Args:
        xy: (k, 2) forward and left in meters.
        covariance: (k, 2, 2) in square meters; propagated to first order.
        name_of: name of a point in the file, for the message.

    Raises:
        LogError: a point at the robot.
    """
    x, y = xy[:, 0], xy[:, 1]
    r = np.hypot(x, y)
    for k in np.flatnonzero(r < MIN_BEARING_DISTANCE)[:1].tolist():
        raise LogError(f"{name_of(k)}: expected a landmark away from the robot, found range 0")
    J = np.empty((len(xy), 2, 2))
    J[:, 0, 0], J[:, 0, 1] = x / r, y / r
    J[:, 1, 0], J[:, 1, 1] = -y / r / r, x / r / r
    R = J @ covariance @ J.transpose(0, 2, 1)
    return np.stack([r, np.arctan2(y, x)], 1), (R + R.transpose(0, 2, 1)) / 2


def to_robot_frame(
    z: FloatArray, R: FloatArray, sensor: tuple[float, float, float], name: str = "observation"
) -> tuple[FloatArray, FloatArray]:
    """Observations transformed from the sensor frame to the robot frame.

    Args:
        z: (k, 2) range in meters and bearing in radians in the sensor's frame. One of the two may
            be NaN if the sensor is at the robot's origin.
        R: (k, 2, 2) their covariances; converted to first order.
        sensor: pose of the sensor in the robot's frame: meters ahead and to the left, radians.
        name: of the observations, for the message.

    Returns:
        Range and bearing (k, 2), and their covariances (k, 2, 2).

    Raises:
        LogError: a landmark at the robot, or a NaN of a sensor away from the robot's origin.
    """
    ahead, left, yaw = sensor
    turned = z + np.array([0.0, yaw])  # (k, 2)
    if ahead == left == 0:
        turned[:, 1] -= 2 * np.pi * np.rint(turned[:, 1] / (2 * np.pi))
        return turned, R
    for k in np.flatnonzero(np.isnan(z).any(1))[:1].tolist():
        raise LogError(
            f"{name} {k}: expected range and bearing of a sensor away from the robot's origin, "
            "found only one"
        )
    xy = to_points(turned) + np.array([ahead, left])
    return to_range_bearing(xy, point_covariance(turned, R), lambda k: f"{name} {k}")


def in_robot_frame(log: LandmarkLog) -> LandmarkLog:
    """The log with observations in the frame of the robot, as `to_robot_frame` converts them.

    The log itself if the sensor is at the robot's origin and looks ahead.
    """
    if not any(log.sensor):
        return log
    z, R = to_robot_frame(
        log.observation, log.observation_covariance, log.sensor, f"{log.name}, observation"
    )
    return replace(log, observation=z, observation_covariance=R, sensor=(0.0, 0.0, 0.0))


def relative_poses_of(log: LandmarkLog) -> RelativePoses:
    """The controls of a log as relative poses."""
    return to_relative_poses(find_motion(log.motion), log.control, log.control_covariance)


MIN_STEPS = 20
"""Minimum number of steps for a comparison of their lengths."""
MIN_JUMP = 1.0
"""Minimum length in meters of a jump of odometry."""
SPEED_RATIO = 8.0
"""Minimum speed of a jump, relative to the 95th percentile of speeds."""
RESET_RATIO = 3.0
"""The same for a reset, which also returns to the origin."""
MAX_RETURN = 0.1
"""Maximum distance from the origin after a reset, relative to the distance before it."""


def long_steps(time: FloatArray, path: FloatArray) -> tuple[BoolArray, BoolArray]:
    """(t,) True for steps that are jumps, and for steps that are resets to the origin.

    Args:
        time: (t + 1,) times of the poses in seconds.
        path: (t + 1, 3) poses of odometry; the first is the origin.
    """
    length = np.hypot(*steps_between(path)[:, :2].T)
    if len(length) < MIN_STEPS:
        return np.zeros(len(length), bool), np.zeros(len(length), bool)
    duration = np.diff(time)
    usual = float(np.median(duration[duration > 0])) if (duration > 0).any() else 1.0
    speed = length / np.maximum(duration, usual)
    common = float(np.quantile(speed, 0.95))
    distance = np.hypot(*(path[:, :2] - path[0, :2]).T)
    returns = distance[1:] < MAX_RETURN * distance[:-1]
    is_long = length > MIN_JUMP
    return is_long & (speed > SPEED_RATIO * common), (
        is_long & returns & (speed > RESET_RATIO * common)
    )
