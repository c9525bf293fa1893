"""Odometry and ground truth in files beside the images of a drive, whatever its layout.

odometry.csv             see `odometry`; or odometry_oxts.csv
gaze.csv                 optional, of a camera that turns: see `gaze`
groundtruth.tum          ground truth of the robot, on the ground; or of the left camera, in its
                         frame: groundtruth_tum.txt, groundtruth_kitti.txt, poses.txt or, as in
                         KITTI's benchmark, ../../poses/NAME.txt
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.datasets.drives.calibration import Calibration
from saccade.datasets.drives.frames import FrameTimes
from saccade.datasets.drives.gaze import with_recorded_turns
from saccade.datasets.drives.odometry import OdometryIncrements, read_odometry, unknown_increments
from saccade.datasets.poses import Poses, project_to_plane, rotation_matrices
from saccade.datasets.tables import read_rows, read_table
from saccade.errors import LogError
from saccade.frames import Camera, Drive, Frame
from saccade.types import FloatArray, Trajectory

TUM_COLUMNS = ("time", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


class Truth(NamedTuple):
    """Ground truth of a drive, if known: `Drive.truth` and `Drive.truth_off_plane`."""

    trajectory: Trajectory | None = None
    off_plane: FloatArray | None = None


def read_tum_poses(path: Path) -> Poses:
    """Lines of `time x y z qx qy qz qw`; `#` begins a comment."""
    table = read_table(path, TUM_COLUMNS)
    if len(table) == 0:
        raise LogError(f"{path}: expected poses, found none")
    return Poses(table[:, 0], rotation_matrices(table[:, 4:], str(path)), table[:, 1:4])


def read_kitti_poses(path: Path, time: FloatArray) -> Poses:
    """Lines of the twelve numbers of a (3, 4) pose, row by row; one for each time (n,)."""
    rows = [row.require_cells(12, "numbers").numbers() for row in read_rows(path)]
    if len(rows) != len(time):
        raise LogError(f"{path}: expected {len(time)} poses as in times.txt, found {len(rows)}")
    matrix = np.array(rows).reshape(-1, 3, 4)
    return Poses(time, matrix[:, :, :3], matrix[:, :, 3])


def camera_truth(poses: Poses, camera: Camera, start_time: float) -> Truth:
    """Ground truth from poses of the camera, in any world frame.

    The world frame becomes the robot's frame at the pose nearest to `start_time`, in seconds.
    """
    rotation = poses.rotation @ camera.rotation.T
    position = poses.position - rotation @ camera.position
    first = int(np.argmin(np.abs(poses.time - start_time)))
    to_start = rotation[first].T
    position = (position - position[first]) @ to_start.T
    return robot_truth(Poses(poses.time, to_start @ rotation, position))


def robot_truth(poses: Poses) -> Truth:
    """Ground truth from poses of the robot in space."""
    R = poses.rotation
    pitch = np.arcsin(R[:, 2, 0].clip(-1, 1))
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    off_plane = np.column_stack([poses.position[:, 2], pitch, roll])
    return Truth(project_to_plane(poses), off_plane)


def read_increments(folder: Path, frames: FrameTimes) -> OdometryIncrements | None:
    """Odometry of a folder, or None where it has none."""
    for name in ("odometry.csv", "odometry_oxts.csv"):
        if (folder / name).exists():
            return read_odometry(folder / name, frames)
    return None


def read_truth(folder: Path, frames: FrameTimes, camera: Camera) -> Truth:
    """Ground truth of a folder, if it has any; KITTI's has a pose for each recorded frame."""
    if (of_robot := folder / "groundtruth.tum").exists():
        return robot_truth(read_tum_poses(of_robot))
    start_time = float(frames.time[0])
    if (folder / "groundtruth_tum.txt").exists():
        return camera_truth(read_tum_poses(folder / "groundtruth_tum.txt"), camera, start_time)
    benchmark = folder.resolve().parent.parent / "poses" / f"{folder.resolve().name}.txt"
    for file in (folder / "groundtruth_kitti.txt", folder / "poses.txt", benchmark):
        if file.exists():
            return camera_truth(read_kitti_poses(file, frames.recorded), camera, start_time)
    return Truth()


def assemble_drive(
    name: str,
    folder: Path,
    calibration: Calibration,
    frames: FrameTimes,
    load: Callable[[int], Frame],
    increments: OdometryIncrements | None = None,
    truth: Truth | None = None,
) -> Drive:
    """A drive from its parts.

    Odometry and ground truth that are None are read from the folder; without odometry the motion is
    unknown. The start is that of the calibration, else that of the ground truth, else the origin.
    """
    if increments is None:
        increments = read_increments(folder, frames) or unknown_increments(frames.time)
    truth = truth or read_truth(folder, frames, calibration.camera)
    start = np.zeros(3)
    if calibration.start is not None:
        start = np.array(calibration.start)
    elif truth.trajectory is not None:
        start = truth.trajectory.at(frames.time[:1])[0]
    return Drive(
        name=name,
        camera=calibration.camera,
        time=frames.time,
        control=increments.control,
        control_covariance=increments.covariance,
        load=with_recorded_turns(folder, frames, load),
        start=start,
        odometry_bias=calibration.odometry_bias,
        truth=truth.trajectory,
        truth_off_plane=truth.off_plane,
        remarks=frames.remarks,
    )
