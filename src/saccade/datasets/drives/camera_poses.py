"""Poses of a camera in space, and their projection to the robot's ground plane."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.text import read_rows, read_table
from saccade.errors import LogError
from saccade.frames import Camera
from saccade.types import FloatArray, Trajectory

TUM_COLUMNS = ("time", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


@dataclass(frozen=True, eq=False, repr=False)
class Poses:
    """n timed poses in SE(3)."""

    time: FloatArray
    """(n,) seconds."""
    rotation: FloatArray
    """(n, 3, 3) from the body frame to the world frame."""
    position: FloatArray
    """(n, 3) metres, in the world frame."""

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"Poses({len(self)} in SE(3))"


def read_tum_poses(path: Path) -> Poses:
    """Lines of `time x y z qx qy qz qw`; `#` begins a comment."""
    table = read_table(path, TUM_COLUMNS)
    if len(table) == 0:
        raise LogError(f"{path}: expected poses, found none")
    return Poses(table[:, 0], rotation_matrices(table[:, 4:], str(path)), table[:, 1:4])


def read_kitti_poses(path: Path, time: FloatArray) -> Poses:
    """Lines of the twelve numbers of a (3, 4) pose, row by row.

    Args:
        path: the file.
        time: (n,) seconds of the frames, one for each line.
    """
    rows = [row.require_cells(12, "numbers").numbers() for row in read_rows(path)]
    if len(rows) != len(time):
        raise LogError(f"{path}: expected {len(time)} poses as in times.txt, found {len(rows)}")
    matrix = np.array(rows).reshape(-1, 3, 4)
    return Poses(time, matrix[:, :, :3], matrix[:, :, 3])


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


def robot_poses(poses: Poses, camera: Camera, start_time: float) -> Poses:
    """Poses of the robot, from those of its camera.

    The world frame becomes the robot's frame at the pose nearest to `start_time`, in seconds: x
    ahead, y to the left, z up by the mounting of the camera.
    """
    rotation = poses.rotation @ camera.rotation.T
    position = poses.position - rotation @ camera.position
    first = int(np.argmin(np.abs(poses.time - start_time)))
    to_start = rotation[first].T
    return Poses(poses.time, to_start @ rotation, (position - position[first]) @ to_start.T)


def project_to_plane(poses: Poses) -> Trajectory:
    """Projection of the robot's poses to the plane z = 0: x, y, and the heading of its x axis."""
    x_axis = poses.rotation[:, :, 0]
    heading = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    return Trajectory(poses.time, np.column_stack([poses.position[:, :2], heading]))


def off_plane_components(poses: Poses) -> FloatArray:
    """(n, 3) dropped by the projection: height in metres, pitch (nose up) and roll in radians."""
    R = poses.rotation
    pitch = np.arcsin(R[:, 2, 0].clip(-1, 1))
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return np.column_stack([poses.position[:, 2], pitch, roll])
