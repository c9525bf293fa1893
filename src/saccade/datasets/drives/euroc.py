"""Drives in the layout of EuRoC's micro aerial vehicles (ASL).

    mav0/cam0/               data.csv: `timestamp [ns],filename`; data/; sensor.yaml
    mav0/cam1/               optional, the right camera
    mav0/imu0/               optional: data.csv with rad/s and m/s^2, sensor.yaml
    mav0/state_groundtruth_estimate0/data.csv
                             optional: place and quaternion (w first) of the body
    odometry.csv             optional, beside mav0; see `odometry_csv`

The robot's frame is that of a robot on which the left camera looks straight ahead; times count
from the first image. Both cameras are straightened and rectified. There is no wheel odometry:
without odometry.csv the turn is the gyroscope's, with its noise and bias, and of the way nothing
is known but how fast such a vehicle flies (see `unknown_increments`).
"""

import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from saccade.datasets.drives.camera_file import Calibration
from saccade.datasets.drives.camera_poses import Poses, rotations
from saccade.datasets.drives.image_files import ImageFiles, in_time
from saccade.datasets.drives.odometry_increments import (
    OdometryIncrements,
    SpeedNoise,
    increments_from_speeds,
    unknown_increments,
)
from saccade.datasets.drives.sidecar_files import Truth, assemble_drive, read_increments
from saccade.datasets.drives.undistortion import Lens, rectified
from saccade.datasets.text import numbers, read_lines
from saccade.errors import DriveError
from saccade.frames import AHEAD, Camera, Drive
from saccade.types import FloatArray, IntArray

GYRO = SpeedNoise(ahead=0.0, left=0.0, turn=0.002, turn_bias=0.08)
"""Ten times the noise density of the ADIS16448 on these vehicles, since it turns about all three
axes; and the bias it has when it is not taken out."""


@dataclass(frozen=True, eq=False)
class _Sensor:
    """What a sensor.yaml says."""

    body: FloatArray
    """(4, 4) pose of the sensor in the body's frame."""
    values: dict[str, FloatArray]
    """Lists of numbers by their names."""


def read_euroc_drive(path: Path) -> Drive:
    """A drive from the folder that holds mav0, or from mav0.

    Raises:
        DriveError, LogError: a file is missing, broken or does not fit the others; names it.
    """
    top = path / "mav0" if (path / "mav0").is_dir() else path
    stamps, files = _images(top / "cam0")
    zero = int(stamps.min())
    clock = _seconds(stamps, zero)
    number, remarks = in_time(clock, str(top / "cam0" / "data.csv"))
    stamp, time = stamps[number], clock[number]
    sensor = _read_sensor(top / "cam0" / "sensor.yaml")
    lens = _lens(top / "cam0" / "sensor.yaml", sensor)
    camera, right_lens, right = lens.camera, None, []
    if (top / "cam1").is_dir():
        other = _read_sensor(top / "cam1" / "sensor.yaml")
        between = np.linalg.inv(other.body) @ sensor.body
        right_lens = _lens(top / "cam1" / "sensor.yaml", other)
        camera, lens, right_lens = rectified(lens, right_lens, between[:3, :3], between[:3, 3])
        there = dict(zip(*(each for each in _images(top / "cam1")), strict=True))
        right = [there.get(each) for each in stamp.tolist()]
    # the rectified camera is the robot's straight ahead
    turned = sensor.body[:3, :3] @ lens.rotation.T
    camera = replace(camera, rotation=AHEAD.copy())
    beside = top.parent if top.name == "mav0" else top
    steps = read_increments(beside, time, number) or _by_gyroscope(top / "imu0", time, zero, turned)
    truth = _truth(top / "state_groundtruth_estimate0" / "data.csv", zero, sensor, turned, camera)
    load = ImageFiles(
        camera,
        time,
        left=[files[i] for i in number.tolist()],
        right=right,
        lens=lens,
        right_lens=right_lens,
    )
    name = beside.resolve().name
    return assemble_drive(name, Calibration(camera), time, load, steps, truth, remarks)


def read_stamped(path: Path, columns: int) -> tuple[IntArray, FloatArray]:
    """Nanoseconds (n,) and numbers (n, columns) of an ASL data.csv; more columns are left out.

    Raises:
        LogError, DriveError: the file is missing, or a line is broken; names it.
    """
    stamps, rows = [], []
    for line, cells in _cells(path):
        if len(cells) < columns + 1:
            raise DriveError(f"{path}, line {line}: expected {columns + 1} cells, found {cells}")
        stamps.append(_stamp(path, line, cells[0]))
        rows.append(numbers(path, line, cells[1 : columns + 1]))
    return np.array(stamps, np.int64), np.array(rows, np.float64).reshape(-1, columns)


def _seconds(stamps: IntArray, zero: int) -> FloatArray:
    """Of nanoseconds (n,) since others; whole numbers keep every digit until then."""
    return np.asarray((stamps - zero) * 1e-9, np.float64)


def _images(folder: Path) -> tuple[IntArray, list[Path]]:
    path = folder / "data.csv"
    rows = [(_stamp(path, line, cells[0]), cells[-1]) for line, cells in _cells(path)]
    if not rows:
        raise DriveError(f"{path}: expected times and files, found none")
    return np.array([stamp for stamp, _ in rows]), [folder / "data" / name for _, name in rows]


def _cells(path: Path) -> list[tuple[int, list[str]]]:
    return [
        (number, [cell.strip() for cell in cells])
        for number, cells in enumerate(csv.reader(read_lines(path)), 1)
        if cells and not cells[0].startswith("#")
    ]


def _stamp(path: Path, line: int, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 20):
        raise DriveError(f"{path}, line {line}: expected nanoseconds, found {text!r}")
    return int(text)


def _read_sensor(path: Path) -> _Sensor:
    """The lists of numbers of a sensor.yaml."""
    text = "\n".join(line.split("#")[0] for line in read_lines(path))
    values = {}
    for name, inside in re.findall(r"(\w+):\s*\[([^\]]*)\]", text):
        values[name] = np.array(
            numbers(path, text.count("\n") + 1, inside.replace(",", " ").split())
        )
    body = values.get("data", np.eye(4))
    if body.size != 16:
        raise DriveError(f"{path}: expected T_BS of 16 numbers, found {body.size}")
    return _Sensor(body.reshape(4, 4), values)


def _lens(path: Path, sensor: _Sensor) -> Lens:
    sizes = {"resolution": 2, "intrinsics": 4, "distortion_coefficients": 4}
    for name, size in sizes.items():
        found = sensor.values.get(name, np.zeros(0)).size
        if found != size:
            raise DriveError(f"{path}: expected {size} numbers as {name}, found {found}")
    (width, height), (fx, fy, cx, cy), bent = (sensor.values[name].tolist() for name in sizes)
    camera = Camera(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return Lens(matrix, tuple(bent), camera, np.eye(3))


def _by_gyroscope(
    folder: Path, time: FloatArray, zero: int, turned: FloatArray
) -> OdometryIncrements:
    """Turns by the gyroscope, ways unknown; nothing known at all where there is none."""
    steps = unknown_increments(time)
    if not (folder / "data.csv").exists():
        return steps
    stamps, rates = read_stamped(folder / "data.csv", 3)
    if len(stamps) < 2:
        return steps
    sensor = _read_sensor(folder / "sensor.yaml") if (folder / "sensor.yaml").exists() else None
    body = np.eye(3) if sensor is None else sensor.body[:3, :3]
    robot = rates @ body.T @ turned @ AHEAD.T  # (k, 3) rad/s about ahead, left and up
    clock = _seconds(stamps, zero)
    order = np.argsort(clock, kind="stable")
    by_gyro = increments_from_speeds(
        clock[order], np.zeros(len(clock)), robot[order, 2], time, GYRO
    )
    control, covariance = steps.control.copy(), steps.covariance.copy()
    control[:, 2], covariance[:, 2, 2] = by_gyro.control[:, 2], by_gyro.covariance[:, 2, 2]
    return OdometryIncrements(control, covariance)


def _truth(path: Path, zero: int, sensor: _Sensor, turned: FloatArray, camera: Camera) -> Truth:
    if not path.exists():
        return Truth()
    stamps, states = read_stamped(path, 7)
    if len(stamps) == 0:
        return Truth()
    body = rotations(states[:, [4, 5, 6, 3]], str(path))  # (n, 3, 3), w is the first of the file
    place = states[:, :3] + body @ sensor.body[:3, 3]
    poses = Poses(_seconds(stamps, zero), body @ turned, place)
    return Truth.of_camera(poses, camera, begin=0.0)
