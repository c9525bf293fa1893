"""Odometry and ground truth beside the images of a drive, in any layout.

odometry.csv             see `odometry`; or odometry_oxts.csv
gaze.csv                 optional, for a pan-tilt camera: pan_rad, tilt_rad, sigma_rad (see
                         `CameraTurn`) and optionally the reason; one row per recorded frame
groundtruth.tum          ground truth of the robot, on the ground; or of the left camera, in its
                         frame: groundtruth_tum.txt, groundtruth_kitti.txt, poses.txt or, as in
                         KITTI's benchmark, ../../poses/NAME.txt
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from saccade.datasets.drives.calibration import Calibration
from saccade.datasets.drives.frames import FrameTimes
from saccade.datasets.drives.odometry import OdometryIncrements, read_odometry, unknown_increments
from saccade.datasets.tables import one_of, read_csv, read_rows, read_table, write_table
from saccade.errors import DriveError, LogError
from saccade.frames import Camera, CameraTurn, Drive, Frame, Poses
from saccade.types import FloatArray, Trajectory

TUM_COLUMNS = ("time", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
GAZE_FILE = "gaze.csv"
GAZE_COLUMNS = ("pan_rad", "tilt_rad", "sigma_rad", "reason")
"""Columns of gaze.csv; `reason` is optional."""


START_UNKNOWN = (
    "the ground truth does not cover the first pose: the start is set to the origin, and only "
    "aligned errors are computed"
)
"""Remark on the start of a recording without ground truth."""


def read_tum_poses(path: Path) -> Poses:
    """Reads poses from lines of `time x y z qx qy qz qw`; `#` begins a comment."""
    table = read_table(path, TUM_COLUMNS)
    if len(table) == 0:
        raise LogError(f"{path}: expected poses, found none")
    return Poses.from_rows(table, str(path))


def read_kitti_poses(path: Path, time: FloatArray) -> Poses:
    """Reads poses from lines of twelve numbers, (3, 4) row by row; one line per time (n,)."""
    rows = [row.require_cells(12, "numbers").numbers() for row in read_rows(path)]
    if len(rows) != len(time):
        raise LogError(f"{path}: expected {len(time)} poses as in times.txt, found {len(rows)}")
    matrix = np.array(rows).reshape(-1, 3, 4)
    return Poses(time, matrix[:, :, :3], matrix[:, :, 3])


def camera_truth(poses: Poses, camera: Camera, start_time: float) -> Trajectory:
    """Ground truth from camera poses in any world frame.

    The new world frame is the robot's frame at the pose nearest to `start_time`, in seconds.
    """
    rotation = poses.rotation @ camera.rotation.T
    position = poses.position - rotation @ camera.position
    first = int(np.argmin(np.abs(poses.time - start_time)))
    to_start = rotation[first].T
    position = (position - position[first]) @ to_start.T
    return Poses(poses.time, to_start @ rotation, position).on_plane


def read_truth(folder: Path, frames: FrameTimes, camera: Camera) -> Trajectory | None:
    """Ground truth in a folder, or None; KITTI's has a pose for each recorded frame."""
    if (of_robot := folder / "groundtruth.tum").exists():
        return read_tum_poses(of_robot).on_plane
    start_time = float(frames.time[0])
    if (of_camera := folder / "groundtruth_tum.txt").exists():
        return camera_truth(read_tum_poses(of_camera), camera, start_time)
    benchmark = folder.resolve().parent.parent / "poses" / f"{folder.resolve().name}.txt"
    for file in (folder / "groundtruth_kitti.txt", folder / "poses.txt", benchmark):
        if file.exists():
            return camera_truth(read_kitti_poses(file, frames.recorded), camera, start_time)
    return None


def assemble_drive(
    name: str,
    folder: Path,
    calibration: Calibration,
    frames: FrameTimes,
    read: Callable[[int], Frame],
    increments: OdometryIncrements | None = None,
    truth: Trajectory | Literal["in the folder"] | None = "in the folder",
    turns: Sequence[CameraTurn] | None = None,
    assumptions: tuple[str, ...] = (),
) -> Drive:
    """Assembles a drive from its parts.

    `read` returns a recorded frame by number. Odometry and camera turns are read from the folder
    if they are None; without odometry the motion is unknown. The drive starts at the pose of the
    calibration, else at the true pose, else at the origin.
    """
    if increments is None:
        increments = read_odometry(folder, frames) or unknown_increments(frames.time)
    if truth == "in the folder":
        truth = read_truth(folder, frames, calibration.camera)
    if turns is None and (path := folder / GAZE_FILE).exists():
        turns = read_turns(path)
        if len(turns) != len(frames.recorded):
            raise DriveError(
                f"{path}: expected a row for each of {len(frames.recorded)} frames, found "
                f"{len(turns)}"
            )
    start, is_known = np.zeros(3), True
    if calibration.start is not None:
        start = np.array(calibration.start)
    elif truth is not None and not truth.covers(frames.time[:1])[0]:
        is_known, assumptions = False, (*assumptions, f"{folder}: {START_UNKNOWN}")
    elif truth is not None:
        start = truth.at(frames.time[:1])[0]
    numbers = frames.index.tolist()

    def load(i: int) -> Frame:
        frame = read(numbers[i])
        return replace(frame, turn=turns[numbers[i]]) if turns else frame

    return Drive(
        name=name,
        camera=calibration.camera.undistorted,
        time=frames.time,
        control=increments.control,
        control_covariance=increments.covariance,
        has_odometry=increments.is_measured,
        load=load,
        start=start,
        odometry_bias=calibration.odometry_bias,
        truth=truth,
        start_known=is_known,
        remarks=frames.remarks,
        assumptions=assumptions,
    )


def read_turns(path: Path) -> list[CameraTurn]:
    """Reads the camera turns of a file."""
    table, turns = read_csv(path, one_of(GAZE_COLUMNS, GAZE_COLUMNS[:3])), []
    for row in table.rows:
        pan, tilt, sigma = row.numbers(slice(3))
        turn = CameraTurn(pan, tilt, sigma, "".join(row.cells[3:]))
        if not (abs(turn.pan) <= 4 * np.pi and abs(turn.tilt) <= np.pi and 0 <= turn.sigma <= 1):
            raise row.error("pan, tilt and their standard deviation in radians", str(row.cells))
        turns.append(turn)
    return turns


def write_turns(path: Path, turns: Sequence[CameraTurn | None]) -> None:
    """Writes camera turns as CSV, with every digit; None means as mounted."""
    rows = [turn or CameraTurn(0.0) for turn in turns]
    columns = (np.array(column) for column in zip(*rows, strict=True))
    write_table(path, dict(zip(GAZE_COLUMNS, columns, strict=True)))
