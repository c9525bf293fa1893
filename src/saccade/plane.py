"""Poses and points on the plane: composed, relative to one another, with their covariances."""

import numpy as np

from saccade.types import FloatArray, LandmarkLog


def rotations(angle: FloatArray) -> FloatArray:
    """(n, 2, 2) matrices that turn vectors by angles (n,) in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def rotated(xy: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (n, 2) turned by angles (n,) in radians."""
    x, y, c, s = *xy.T, np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y], 1)


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """Poses (n, 3) in the frames of others (n, 3): meters ahead and left, radians."""
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


def to_relative_poses(log: LandmarkLog) -> tuple[FloatArray, FloatArray]:
    """The controls of a log as relative poses (t, 3), and their covariance (t, 3, 3)."""
    A = relative_pose_jacobian(log)
    covariance = A @ log.control_covariance @ A.transpose(0, 2, 1)
    if log.motion == "compose":
        return log.control, covariance
    return np.column_stack([to_points(log.control), log.control[:, 1]]), covariance


def relative_pose_jacobian(log: LandmarkLog) -> FloatArray:
    """(t, 3, c) Jacobians of the relative poses of a log by its controls."""
    if log.motion == "compose":
        return np.broadcast_to(np.eye(3), (len(log.control), 3, 3))
    A = np.zeros((len(log.control), 3, 2))
    A[:, :2] = rotations(log.control[:, 1])
    A[:, :2, 1] *= log.control[:, :1]
    A[:, 2, 1] = 1.0
    return A
