"""Odometry and truth that lie beside the images of a drive, whatever its layout.

odometry.csv             see `odometry_csv`; or odometry_oxts.csv
groundtruth.tum          truth of the robot, on the ground; or of the left camera, in its frame:
                         groundtruth_tum.txt, groundtruth_kitti.txt, poses.txt or, as KITTI's
                         benchmark has it, ../../poses/NAME.txt
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
from saccade.datasets.drives.odometry_csv import read_odometry
from saccade.datasets.drives.odometry_increments import OdometryIncrements, unknown_increments
from saccade.frames import Camera, Drive, Frame
from saccade.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True, eq=False)
class Truth:
    """Where the robot really was, if known."""

    trajectory: Trajectory | None = None
    """As `Drive.truth`."""
    off_plane: FloatArray | None = None
    """As `Drive.truth_off_plane`."""

    @classmethod
    def of_camera(cls, poses: Poses, camera: Camera, begin: float) -> "Truth":
        """That of a robot whose camera had some poses.

        Args:
            poses: of the camera, in any world.
            camera: on the robot.
            begin: seconds of the first frame, from where the robot's truth begins.
        """
        robot = robot_poses(poses, camera, begin)
        return cls(project_to_plane(robot), off_plane_components(robot))


def read_increments(path: Path, time: FloatArray, number: IntArray) -> OdometryIncrements | None:
    """Odometry of a folder, if it has any.

    Args:
        path: the folder.
        time: (n,) seconds of the frames.
        number: (n,) their numbers among all that the camera took.
    """
    for name in ("odometry.csv", "odometry_oxts.csv"):
        if (path / name).exists():
            return read_odometry(path / name, time, number)
    return None


def read_increments_or_unknown(
    path: Path, time: FloatArray, number: IntArray
) -> OdometryIncrements:
    """Odometry of a folder, or steps of which nothing is known."""
    return read_increments(path, time, number) or unknown_increments(time)


def read_truth(path: Path, clock: FloatArray, camera: Camera, begin: float) -> Truth:
    """Truth of a folder, if it has any.

    Args:
        path: the folder.
        clock: (n,) seconds of all frames, for truth without times.
        camera: on the robot.
        begin: seconds of the first frame.
    """
    if (path / "groundtruth.tum").exists():
        poses = read_tum_poses(path / "groundtruth.tum")
        return Truth(project_to_plane(poses), off_plane_components(poses))
    if (path / "groundtruth_tum.txt").exists():
        return Truth.of_camera(read_tum_poses(path / "groundtruth_tum.txt"), camera, begin)
    benchmark = path.resolve().parent.parent / "poses" / f"{path.resolve().name}.txt"
    for file in (path / "groundtruth_kitti.txt", path / "poses.txt", benchmark):
        if file.exists():
            return Truth.of_camera(read_kitti_poses(file, clock), camera, begin)
    return Truth()


def assemble_drive(
    name: str,
    calibration: Calibration,
    time: FloatArray,
    load: Callable[[int], Frame],
    steps: OdometryIncrements,
    truth: Truth,
    remarks: tuple[str, ...],
) -> Drive:
    """A drive of its parts; it begins where its calibration says, or else where its truth does."""
    start = np.zeros(3)
    if calibration.start is not None:
        start = np.array(calibration.start)
    elif truth.trajectory is not None:
        start = truth.trajectory.at(time[:1])[0]
    return Drive(
        name=name,
        camera=calibration.camera,
        time=time,
        control=steps.control,
        control_covariance=steps.covariance,
        load=load,
        start=start,
        odometry_bias=calibration.odometry_bias,
        truth=truth.trajectory,
        truth_off_plane=truth.off_plane,
        remarks=remarks,
    )
