"""Odometry and ground truth in files beside the images of a drive, whatever its layout.

odometry.csv             see `odometry_csv`; or odometry_oxts.csv
groundtruth.tum          ground truth of the robot, on the ground; or of the left camera, in its
                         frame: groundtruth_tum.txt, groundtruth_kitti.txt, poses.txt or, as in
                         KITTI's benchmark, ../../poses/NAME.txt
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.drives.camera_file import Calibration
from saccade.datasets.drives.camera_poses import (
    Poses,
    off_plane_components,
    project_to_plane,
    read_kitti_poses,
    read_tum_poses,
    robot_poses,
)
from saccade.datasets.drives.frame_times import FrameTimes
from saccade.datasets.drives.odometry_csv import read_odometry
from saccade.datasets.drives.odometry_increments import OdometryIncrements, unknown_increments
from saccade.frames import Camera, Drive, Frame
from saccade.types import FloatArray, Trajectory


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of a drive, if known."""

    trajectory: Trajectory | None = None
    """As `Drive.truth`."""
    off_plane: FloatArray | None = None
    """As `Drive.truth_off_plane`."""

    @classmethod
    def of_robot(cls, poses: Poses) -> "Truth":
        """Ground truth from poses of the robot in space."""
        return cls(project_to_plane(poses), off_plane_components(poses))

    @classmethod
    def of_camera(cls, poses: Poses, camera: Camera, start_time: float) -> "Truth":
        """Ground truth from poses of the camera, in any world frame.

        Args:
            poses: of the camera.
            camera: on the robot.
            start_time: seconds of the first frame, at which the robot is at the origin.
        """
        return cls.of_robot(robot_poses(poses, camera, start_time))


def read_increments(folder: Path, frames: FrameTimes) -> OdometryIncrements | None:
    """Odometry of a folder, or None where it has none."""
    for name in ("odometry.csv", "odometry_oxts.csv"):
        if (folder / name).exists():
            return read_odometry(folder / name, frames)
    return None


def read_truth(folder: Path, frames: FrameTimes, camera: Camera) -> Truth:
    """Ground truth of a folder, if it has any; KITTI's has a pose for each recorded frame."""
    if (folder / "groundtruth.tum").exists():
        return Truth.of_robot(read_tum_poses(folder / "groundtruth.tum"))
    start_time = float(frames.time[0])
    if (folder / "groundtruth_tum.txt").exists():
        poses = read_tum_poses(folder / "groundtruth_tum.txt")
        return Truth.of_camera(poses, camera, start_time)
    benchmark = folder.resolve().parent.parent / "poses" / f"{folder.resolve().name}.txt"
    for file in (folder / "groundtruth_kitti.txt", folder / "poses.txt", benchmark):
        if file.exists():
            poses = read_kitti_poses(file, frames.recorded)
            return Truth.of_camera(poses, camera, start_time)
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

    Args:
        name: of the drive.
        folder: with odometry and ground truth, which are read where they are None.
        calibration: the camera; the start pose, which is else that of the ground truth.
        frames: of the drive.
        load: see `Drive`.
        increments: odometry between the frames; unknown motion where the folder has none either.
        truth: ground truth.
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
        load=load,
        start=start,
        odometry_bias=calibration.odometry_bias,
        truth=truth.trajectory,
        truth_off_plane=truth.off_plane,
        remarks=frames.remarks,
    )
