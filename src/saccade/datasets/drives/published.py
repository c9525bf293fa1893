"""Drives in the layouts of published recordings: EuRoC and TUM RGB-D.

EuRoC's micro aerial vehicles (ASL):

    mav0/cam0/               data.csv: `timestamp [ns],filename`; data/; sensor.yaml
    mav0/cam1/               optional, the right camera
    mav0/imu0/               optional: data.csv with rad/s and m/s^2, sensor.yaml
    mav0/state_groundtruth_estimate0/data.csv
                             optional: position and quaternion (w first) of the body
    odometry.csv             optional, beside mav0; see `odometry`

The robot's frame is that of a robot on which the left camera looks straight ahead; times count
from the first image. Both cameras are undistorted and rectified. Without odometry.csv the turn is
the gyroscope's, with its noise and bias, and the translation is unknown (see
`unknown_increments`).

TUM RGB-D, of a hand-held camera, where without odometry.csv the motion is unknown:

    rgb.txt                  lines of `time file`, the color images
    depth.txt                the same for the depth images, 16 bit, 5000 steps per metre
    groundtruth.txt          optional: `time x y z qx qy qz qw` of the color camera
    camera.toml              optional, see `calibration`; not required where the folder's name
                             contains freiburg1, 2 or 3
    odometry.csv             optional, see `odometry`
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.calibration import (
    CAMERA_FILE,
    Calibration,
    Lens,
    pinhole,
    read_calibration,
    rectify_stereo,
)
from saccade.datasets.drives.frames import (
    FrameTimes,
    associate,
    frame_reader,
    image_files,
)
from saccade.datasets.drives.odometry import (
    OdometryIncrements,
    SpeedNoise,
    increments_from_speeds,
    unknown_increments,
)
from saccade.datasets.drives.sidecar_files import (
    Poses,
    Truth,
    assemble_drive,
    camera_truth,
    read_increments,
    read_tum_poses,
    rotation_matrices,
)
from saccade.datasets.tables import Row, read_rows
from saccade.errors import DriveError
from saccade.frames import AHEAD, Camera, Drive
from saccade.types import FloatArray, IntArray

GYRO = SpeedNoise(ahead=0.0, left=0.0, turn=0.002, turn_bias=0.08)
"""Ten times the noise density of the ADIS16448 on these vehicles, since they rotate about all three
axes; and its uncalibrated bias."""


def read_euroc_drive(path: Path) -> Drive:
    """A drive from the folder that holds mav0, or from mav0."""
    top = path / "mav0" if (path / "mav0").is_dir() else path
    stamps, files = _images(top / "cam0")
    zero = int(stamps.min())
    frames = FrameTimes.sort(_seconds(stamps, zero), str(top / "cam0" / "data.csv"))
    body_from_sensor, lens = _read_camera(top / "cam0" / "sensor.yaml")
    camera, right_lens, right = lens.camera, None, None
    if (top / "cam1").is_dir():
        body_from_right, right_lens = _read_camera(top / "cam1" / "sensor.yaml")
        right_from_left = np.linalg.inv(body_from_right) @ body_from_sensor
        camera, lens, right_lens = rectify_stereo(
            lens, right_lens, right_from_left[:3, :3], right_from_left[:3, 3]
        )
        right_stamps, right_files = _images(top / "cam1")
        file_at = dict(zip(right_stamps.tolist(), right_files, strict=True))
        right = image_files(lambda number: file_at.get(int(stamps[number])))
    # the robot's frame is chosen so that the rectified camera looks straight ahead
    body_from_camera = body_from_sensor[:3, :3] @ lens.rotation.T
    calibration = Calibration(replace(camera, rotation=AHEAD.copy()))
    folder = top.parent if top.name == "mav0" else top
    increments = read_increments(folder, frames) or _gyroscope_increments(
        top / "imu0", frames.time, zero, body_from_camera
    )
    states = top / "state_groundtruth_estimate0" / "data.csv"
    poses = _camera_poses(states, zero, body_from_sensor[:3, 3], body_from_camera)
    truth = Truth() if poses is None else camera_truth(poses, calibration.camera, start_time=0.0)
    left = image_files(files.__getitem__)
    read = frame_reader(calibration, frames.recorded, left, right, lenses=(lens, right_lens))
    name = folder.resolve().name
    return assemble_drive(name, folder, calibration, frames, read, increments, truth)


def _read_sensor(path: Path) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Pose (4, 4) of a sensor in the body's frame, and all lists of numbers of a sensor.yaml."""
    rows = list(read_rows(path))
    text = "\n".join(" ".join(row.cells).split("#")[0] for row in rows)
    last = rows[-1].line if rows else 0
    values = {}
    for name, inside in re.findall(r"(\w+):\s*\[([^\]]*)\]", text):
        values[name] = np.array(Row(path, last, inside.replace(",", " ").split()).numbers())
    pose = values.get("data", np.eye(4))
    if pose.size != 16:
        raise DriveError(f"{path}: expected T_BS of 16 numbers, found {pose.size}")
    return pose.reshape(4, 4), values


def _read_camera(path: Path) -> tuple[FloatArray, Lens]:
    """Pose (4, 4) of a camera in the body's frame, and its intrinsics and distortion."""
    pose, values = _read_sensor(path)
    sizes = {"resolution": 2, "intrinsics": 4, "distortion_coefficients": 4}
    for name, size in sizes.items():
        found = values.get(name, np.zeros(0)).size
        if found != size:
            raise DriveError(f"{path}: expected {size} numbers as {name}, found {found}")
    (width, height), (fx, fy, cx, cy), distortion = (values[name].tolist() for name in sizes)
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return pose, Lens(matrix, tuple(distortion), pinhole(matrix, (width, height)), np.eye(3))


def _read_stamped(path: Path, columns: int) -> tuple[IntArray, FloatArray]:
    """Nanoseconds (n,) and numbers (n, columns) of an ASL data.csv; further columns are ignored."""
    stamps, table = [], []
    for row in read_rows(path, delimiter=","):
        if len(row.cells) < columns + 1:
            raise row.error(f"{columns + 1} cells", str(row.cells))
        stamps.append(row.integer(0, "nanoseconds", below=2**63))
        table.append(row.numbers(slice(1, columns + 1)))
    return np.array(stamps, np.int64), np.array(table, np.float64).reshape(-1, columns)


def _seconds(stamps: IntArray, zero: int) -> FloatArray:
    """Seconds from nanoseconds (n,) since another stamp, subtracted exactly."""
    return np.asarray((stamps - zero) * 1e-9, np.float64)


def _images(folder: Path) -> tuple[IntArray, list[Path]]:
    """Nanoseconds (n,) and files of a camera."""
    path = folder / "data.csv"
    rows = list(read_rows(path, delimiter=","))
    if not rows:
        raise DriveError(f"{path}: expected times and files, found none")
    stamps = [row.integer(0, "nanoseconds", below=2**63) for row in rows]
    return np.array(stamps), [folder / "data" / row.cells[-1] for row in rows]


def _gyroscope_increments(
    folder: Path, frame_time: FloatArray, zero: int, body_from_camera: FloatArray
) -> OdometryIncrements:
    """Turns by the gyroscope with unknown translation; unknown motion where there is none."""
    increments = unknown_increments(frame_time)
    if not (folder / "data.csv").exists():
        return increments
    stamps, rates = _read_stamped(folder / "data.csv", 3)
    if len(stamps) < 2:
        return increments
    yaml = folder / "sensor.yaml"
    body = _read_sensor(yaml)[0][:3, :3] if yaml.exists() else np.eye(3)
    rates = rates @ body.T @ body_from_camera @ AHEAD.T  # (k, 3) rad/s about ahead, left and up
    time = _seconds(stamps, zero)
    order = np.argsort(time, kind="stable")
    turns = increments_from_speeds(
        time[order], np.zeros(len(time)), rates[order, 2], frame_time, GYRO
    )
    increments.control[:, 2] = turns.control[:, 2]
    increments.covariance[:, 2, 2] = turns.covariance[:, 2, 2]
    return increments


def _camera_poses(
    path: Path, zero: int, position: FloatArray, body_from_camera: FloatArray
) -> Poses | None:
    """Ground truth of a camera at a position (3,) in the body's frame; None where it is missing."""
    if not path.exists():
        return None
    stamps, states = _read_stamped(path, 7)
    if len(stamps) == 0:
        return None
    body = rotation_matrices(states[:, [4, 5, 6, 3]], str(path))  # (n, 3, 3), w first in the file
    return Poses(_seconds(stamps, zero), body @ body_from_camera, states[:, :3] + body @ position)


DEPTH_UNIT = 1 / 5000
"""Metres per step of a depth image."""
MAX_TIME_DIFFERENCE = 0.02
"""Seconds between a color image and its depth image."""
CAMERAS = {
    1: ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    2: ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    3: ((535.4, 539.2, 320.1, 247.6), ()),
}
"""fx, fy, cx, cy and the distortion of the benchmark's three cameras, from its page on file
formats; images of the third are undistorted."""


def read_tum_drive(path: Path) -> Drive:
    """A drive from a folder."""
    recorded, files = _read_list(path / "rgb.txt")
    frames = FrameTimes.sort(recorded, str(path / "rgb.txt"))
    calibration = _tum_calibration(path)
    depth = None
    if (path / "depth.txt").exists():
        depth_time, depth_files = _read_list(path / "depth.txt")
        nearest = associate(recorded, depth_time, MAX_TIME_DIFFERENCE)
        beside = [depth_files[i] if i >= 0 else None for i in nearest.tolist()]
        depth = image_files(beside.__getitem__, calibration.depth_unit)
    truth = Truth()
    if (path / "groundtruth.txt").exists():
        poses = read_tum_poses(path / "groundtruth.txt")
        truth = camera_truth(poses, calibration.camera, float(frames.time[0]))
    left = image_files(files.__getitem__)
    read = frame_reader(calibration, recorded, left, depth=depth)
    return assemble_drive(path.resolve().name, path, calibration, frames, read, truth=truth)


def _read_list(path: Path) -> tuple[FloatArray, list[Path]]:
    """Times (n,) and files of a list of images."""
    rows = [row.require_cells(2, "cells (time, file)") for row in read_rows(path)]
    if not rows:
        raise DriveError(f"{path}: expected times and files, found none")
    time = [row.numbers(slice(1))[0] for row in rows]
    return np.array(time), [path.parent / row.cells[1] for row in rows]


def _tum_calibration(path: Path) -> Calibration:
    if (path / CAMERA_FILE).exists():
        return read_calibration(path / CAMERA_FILE)
    number = re.search(r"(?:freiburg|fr)([123])", path.resolve().name)
    if number is None:
        raise DriveError(
            f"{path}: expected {CAMERA_FILE}, or freiburg1, 2 or 3 in the folder's name, "
            "found neither"
        )
    (fx, fy, cx, cy), distortion = CAMERAS[int(number[1])]
    camera = Camera(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy)
    return Calibration(camera, distortion, depth_unit=DEPTH_UNIT)
