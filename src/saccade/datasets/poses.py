"""Timed poses in space, and their projection to the plane."""

from typing import NamedTuple

import numpy as np

from saccade.errors import LogError
from saccade.types import FloatArray, Trajectory


class Poses(NamedTuple):
    """n timed poses in SE(3)."""

    time: FloatArray
    """(n,) seconds."""
    rotation: FloatArray
    """(n, 3, 3) from the body frame to the world frame."""
    position: FloatArray
    """(n, 3) metres, in the world frame."""


def rotation_matrices(quaternion: FloatArray, name: str) -> FloatArray:
    """Matrices (n, 3, 3) of quaternions (n, 4) x, y, z, w, which are normalized."""
    length = np.linalg.norm(quaternion, axis=1)
    if (length < 0.5).any():
        row = int(np.argmin(length))
        raise LogError(f"{name}: expected unit quaternions, found length {length[row]:.3g}, {row=}")
    x, y, z, w = (quaternion / length[:, None]).T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], 1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], 1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1),
        ],
        1,
    )


def project_to_plane(poses: Poses) -> Trajectory:
    """Projection of the robot's poses to the plane z = 0: x, y, and the heading of its x axis."""
    x_axis = poses.rotation[:, :, 0]
    heading = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    return Trajectory(poses.time, np.column_stack([poses.position[:, :2], heading]))


def interpolate_poses(poses: Poses, time: FloatArray) -> Poses:
    """Poses at times (n,), the rotation along the shortest arc; the ends extend beyond."""
    from scipy.spatial.transform import Rotation

    after = np.searchsorted(poses.time, time).clip(1, len(poses.time) - 1)
    before = after - 1
    span = poses.time[after] - poses.time[before]
    fraction = (time - poses.time[before]) / np.where(span > 0, span, 1.0)
    fraction = np.where(span > 0, fraction, 0.0).clip(0.0, 1.0)[:, None]
    step = poses.position[after] - poses.position[before]
    start = Rotation.from_matrix(poses.rotation[before])
    turn = (start.inv() * Rotation.from_matrix(poses.rotation[after])).as_rotvec()
    rotation = (start * Rotation.from_rotvec(fraction * turn)).as_matrix()
    return Poses(time, rotation, poses.position[before] + fraction * step)
