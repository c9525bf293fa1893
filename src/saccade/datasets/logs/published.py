"""Published logs: MRCLAM and Victoria Park."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from saccade.datasets.logs.conversions import (
    OdometryNoise,
    integrate,
    require_numbered,
    start_of,
)
from saccade.datasets.matlab import read_matlab
from saccade.datasets.tables import Archive, read_table
from saccade.errors import LogError, require
from saccade.io.files import atomic_write, reading, results_in
from saccade.plane import rotated, to_relative_poses
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

ROBOTS = 5
"""Subjects 1 to 5 are the robots themselves; the others are landmarks."""
MAX_STEP = 0.5
"""Largest time in seconds between poses of the log."""
MAX_DURATION = 1e6
"""Seconds; a longer log contains a corrupt time stamp."""
STALE_LIMIT = 0.2
"""Seconds by which the first odometry sample may be stamped after the second: it is in the logs of
most robots of set 9, and is dropped."""
MRCLAM_ODOMETRY = OdometryNoise(distance=0.05, turn=0.1, drift=0.03)
"""Odometry errors of set 6 over 1 to 16 s against the motion capture, without the systematic
ones."""
MRCLAM_SENSOR = (0.08, 0.012)
"""Standard deviations of range (m) and bearing (rad)."""
MAX_BEARING = 1.0
"""Radians from the optical axis; half the field of view of these robots is less."""
UTIAS_BARCODES = (5, 14, 41, 32, 23)
"""Barcodes on the robots of the published sets, by which these sets are recognized."""

_TABLES = {
    "barcodes": ("Barcodes", ("subject", "barcode")),
    "robot{}_odometry": ("Robot{}_Odometry", ("time", "forward velocity", "angular velocity")),
    "robot{}_measurement": ("Robot{}_Measurement", ("time", "barcode", "range", "bearing")),
    "robot{}_groundtruth": ("Robot{}_Groundtruth", ("time", "x", "y", "heading")),
    "landmarks": ("Landmark_Groundtruth", ("subject", "x", "y", "x sigma", "y sigma")),
}
"""Name of each .dat file and columns, by the name in an .npz."""
_OPTIONAL = ("robot{}_groundtruth", "landmarks")


@dataclass(frozen=True)
class Platform:
    """Calibration of a robot: how its logged numbers relate to physical quantities."""

    latency: float = 0.0
    """Seconds from a logged velocity, which is a command, to its execution."""
    turn: float = 1.0
    """Radians turned per logged radian."""
    depth: float | None = None
    """Logged range per meter of depth along the optical axis; None where the logged range is the
    distance."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """See `LandmarkLog.odometry_bias`."""


UTIAS = Platform(latency=0.2, turn=0.93, depth=1.035, odometry_bias=(0.1, 0.1, 0.1))
"""The robots of the published sets.

Estimated from the ground truth of set 6, with equal results for all five robots: the logged range
is proportional to the cosine of the bearing, since it is derived from the height of the barcode in
the image. The correction reduces range errors from 4 to 1 %. The robots drive 2 to 5 % farther than
logged, less 0.1 m for each radian of turn, and veer to the right by 0.01 to 0.06 rad per meter; the
filter estimates these. The same corrections reduce the innovations of set 9, which has no ground
truth.
"""


def read_mrclam(
    path: str | Path,
    robot: int = 1,
    odometry_noise: OdometryNoise = MRCLAM_ODOMETRY,
    sensor_sigma: tuple[float, float] = MRCLAM_SENSOR,
    platform: Platform | None = None,
) -> LandmarkLog:
    """Read one robot of an MRCLAM set.

    There is a pose at every time of a measurement, and others between them so that no step is
    longer than half a second; the odometry is integrated between them by `integrate`. Observations
    of other robots and of unlisted barcodes are dropped. Where the ground truth is known, the log
    starts at the true pose, in the frame of the surveyed landmarks.

    Args:
        path: the published folder (Barcodes.dat, RobotN_Odometry.dat, ...), or an .npz with the
            same tables.
        robot: 1 to 5.
        odometry_noise: see `load`.
        sensor_sigma: see `load`.
        platform: calibration; None for `UTIAS` in the published sets, `Platform()` in others.

    Returns:
        The log; landmarks are the subjects 6 to 20.
    """
    require(1 <= robot <= ROBOTS, "robot", f"a number from 1 to {ROBOTS}", robot)
    path = Path(path)
    tables = _read_tables(path, robot)
    time, speed, turn_rate = tables["robot{}_odometry"].T
    if len(time) == 0:
        raise LogError(f"{path}: expected odometry of robot {robot}, found none")

    barcodes = _integers(path, "barcodes", tables["barcodes"])
    subject_of = {int(barcode): int(subject) for subject, barcode in barcodes}
    if platform is None:
        published = all(subject_of.get(b) == i + 1 for i, b in enumerate(UTIAS_BARCODES))
        platform = UTIAS if published else Platform()
    measurements = tables["robot{}_measurement"]  # (k, 4)
    subject = np.array([subject_of.get(int(b), -1) for b in measurements[:, 1]], np.int64)
    measurements, subject = measurements[subject > ROBOTS], subject[subject > ROBOTS]
    times = np.concatenate([time[[0, -1]], measurements[:, 0]])
    if not np.ptp(times) < MAX_DURATION:
        raise LogError(
            f"{path}: expected times within {MAX_DURATION:.0f} s of each other, "
            f"found {times.min():g} to {times.max():g} s"
        )
    steps = int(np.ceil(np.ptp(times) / MAX_STEP))
    pose_time = np.union1d(np.linspace(times.min(), times.max(), steps + 1), measurements[:, 0])
    control, control_covariance = integrate(
        time + platform.latency, speed, platform.turn * turn_rate, pose_time, odometry_noise
    )
    poses, survey = tables.get("robot{}_groundtruth", np.empty((0, 4))), tables.get("landmarks")
    truth = Trajectory(time=poses[:, 0].copy(), pose=poses[:, 1:].copy()) if len(poses) else None
    landmark_truth = None
    if survey is not None:
        landmark_truth = LandmarkMap(
            id=_integers(path, "landmarks", survey[:, :1])[:, 0],
            xy=survey[:, 1:3].copy(),
            covariance=survey[:, 3:, None] ** 2 * np.eye(2),
        )
    observation = measurements[:, 2:].copy()
    if platform.depth is not None:
        bearing = np.clip(observation[:, 1], -MAX_BEARING, MAX_BEARING)
        observation[:, 0] /= platform.depth * np.cos(bearing)
    return LandmarkLog(
        name=f"{path.stem}, robot {robot}",
        start=start_of(truth, float(pose_time[0]), f"{path}, robot {robot}"),
        time=pose_time,
        motion="compose",
        control=control,
        control_covariance=control_covariance,
        observation_pose=np.searchsorted(pose_time, measurements[:, 0]).astype(np.int64),
        observation=observation,
        observation_covariance=np.tile(np.diag(np.square(sensor_sigma)), (len(subject), 1, 1)),
        landmark=subject,
        odometry_bias=platform.odometry_bias,
        truth=truth,
        landmark_truth=landmark_truth,
    )


def _read_tables(path: Path, robot: int) -> dict[str, FloatArray]:
    """The tables of a robot; optional ones may be missing."""
    archive = Archive(path) if path.is_file() else None
    tables = {}
    for name, (file, columns) in _TABLES.items():
        dat, key = path / f"{file.format(robot)}.dat", name.format(robot)
        exists = dat.exists() if archive is None else key in archive
        if not exists and name in _OPTIONAL:
            continue
        limit = STALE_LIMIT if name == "robot{}_odometry" else 0.0
        tables[name] = (
            archive.table(key, columns, limit) if archive else read_table(dat, columns, limit)
        )
    return tables


def _integers(path: Path, name: str, table: FloatArray) -> IntArray:
    """Subject and barcode numbers as integers; float64 is exact for those under 2^53."""
    invalid = np.argwhere((table != np.floor(table)) | (np.abs(table) >= 2**53))
    if len(invalid):
        raise LogError(
            f"{path}, {name}, row {invalid[0, 0] + 1}: expected whole numbers under 2^53, "
            f"found {table[tuple(invalid[0])]:g}"
        )
    return table.astype(np.int64)


def write_mrclam(folder: str | Path, log: LandmarkLog) -> None:
    """Write the files of robot 1.

    The format stores velocities: a step becomes a turn, a straight line and another turn, each in a
    third of its time. It stores no noise, and the start pose only as part
    of the ground truth. Landmark numbers up to 5, which are the robots', are shifted to start at 6.

    Args:
        folder: of the files; created if it is missing.
        log: with a clock and the number of every landmark.
    """
    require_numbered(log, "mrclam")
    surveyed = np.empty(0, np.int64) if log.landmark_truth is None else log.landmark_truth.id
    landmarks = np.union1d(log.landmark, surveyed)
    shift = max(0, ROBOTS + 1 - int(landmarks.min(initial=ROBOTS + 1)))
    subjects = np.concatenate([np.arange(1, ROBOTS + 1), landmarks + shift])
    times = log.time[log.observation_pose]
    measurements = np.column_stack([times, log.landmark + shift, log.observation])
    tables = {
        "barcodes": ("subject barcode", np.stack([subjects, subjects], 1)),
        "robot{}_odometry": ("time [s] speed [m/s] turn rate [rad/s]", _velocities(log)),
        "robot{}_measurement": ("time [s] barcode range [m] bearing [rad]", measurements),
    }
    if log.truth is not None:
        truth = np.column_stack([log.truth.time, log.truth.pose])
        tables["robot{}_groundtruth"] = ("time [s] x [m] y [m] heading [rad]", truth)
    if log.landmark_truth is not None:
        covariance = log.landmark_truth.covariance
        sigma = np.zeros((len(surveyed), 2))
        if covariance is not None:
            sigma = np.sqrt(covariance.diagonal(axis1=1, axis2=2))
        tables["landmarks"] = (
            "subject x [m] y [m] x sigma [m] y sigma [m]",
            np.column_stack([surveyed + shift, log.landmark_truth.xy, sigma]),
        )
    with results_in(Path(folder)):
        for name, (header, table) in tables.items():
            file = f"{_TABLES[name][0].format(1)}.dat"
            lines = [f"# {header}", *("\t".join(map(_number, row)) for row in table.tolist())]
            with atomic_write(Path(folder) / file) as temporary:
                temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _velocities(log: LandmarkLog) -> FloatArray:
    """Samples (n, 3) of time, speed and turn rate that reproduce each step of the log."""
    control, _ = to_relative_poses(log)
    rows: list[tuple[float, float, float]] = []
    for step, (forward, left, turn) in enumerate(control.tolist()):
        begin, end = log.time[step : step + 2].tolist()
        if begin == end and (forward or left or turn):
            raise LogError(
                f"{log.name}, control {step}: expected a motion that takes time, found one from "
                f"{begin:g} s to {end:g} s; the format stores velocities"
            )
        if begin == end:
            continue
        third = (end - begin) / 3
        direction, length = float(np.arctan2(left, forward)), float(np.hypot(left, forward))
        if abs(direction) > np.pi / 2:
            direction, length = direction - np.copysign(np.pi, direction), -length
        rows += [
            (begin, 0.0, direction / third),
            (begin + third, length / third, 0.0),
            (begin + 2 * third, 0.0, (turn - direction) / third),
        ]
    return np.array([*rows, (float(log.time[-1]), 0.0, 0.0)])


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) and abs(value) < 1e9 else repr(value)


WHEEL_BASE = 2.83
"""L: distance from the rear to the front axle in meters."""
ENCODER_OFFSET = 0.76
"""H: distance from the middle of the rear axle to the left rear wheel, which has the encoder."""
LASER = (3.78, 0.5)
"""a, b: position of the laser, meters ahead of and to the left of the middle of the rear axle."""
VICTORIA_PARK_ODOMETRY = OdometryNoise(distance=0.06, turn=0.06, drift=0.0125)
"""Wheel slip, without the systematic errors."""
VICTORIA_PARK_BIAS = (0.05, 0.02, 0.02)
"""See `LandmarkLog.odometry_bias`; a steering offset of one degree turns the car by 0.006 rad per
meter."""
LARGEST_VALUE = 1e15
"""Bound of valid values, in meters, meters per second, radians and milliseconds."""
VICTORIA_PARK_SENSOR = (0.2, 0.015)
"""Standard deviations of range (m) and bearing (rad) of a tree, whose trunk is not a point."""


def read_victoria_park(
    path: str | Path,
    odometry_noise: OdometryNoise = VICTORIA_PARK_ODOMETRY,
    sensor_sigma: tuple[float, float] = VICTORIA_PARK_SENSOR,
) -> LandmarkLog:
    """Read the raw Victoria Park log (GTSAM distributes it as a pose graph).

    The .mat has speed and steering angle at 40 Hz and the trees detected in each laser scan.
    There is a pose at the time of each scan; between scans the motion of the rear axle is
    integrated by `integrate` and transformed to the laser, beside the GPS antenna. Trees have no
    identity. The log starts at the origin.

    Args:
        path: the .mat.
        odometry_noise: see `load`.
        sensor_sigma: see `load`.

    Returns:
        The log, with the GPS of `aa3_gpsx.mat` beside it, if it exists, as ground
        truth: its headings are NaN and its frame is not that of the log.
    """
    path = Path(path)
    variables = read_matlab(path, ("time", "u", "TLsr", "zt"))
    time, scan_time = (_times(path, name, variables) for name in ("time", "TLsr"))
    scans = variables["zt"]
    u = _numbers(path, "u", variables["u"], (2, len(time)))
    if not len(scans) == len(scan_time) > 0:
        raise LogError(f"{path}: expected {len(scan_time)} scans in zt, found {len(scans)}")
    speed, turn_rate = center_motion(u[0], u[1])
    control, control_covariance = integrate(time, speed, turn_rate, scan_time, odometry_noise)
    trees = [
        _numbers(path, f"scan {i} of zt", scan, (3, np.size(scan) // 3))
        for i, scan in enumerate(scans)
    ]
    distance, bearing, _ = np.concatenate(trees, 1)  # (k,) each, from the laser, and the diameter
    observation = np.stack([distance, bearing - np.pi / 2], 1)  # the scan starts at the right
    scan_of = np.repeat(np.arange(len(scan_time)), [trees_of.shape[1] for trees_of in trees])
    covariance = np.tile(np.diag(np.square(sensor_sigma)), (len(observation), 1, 1))
    control, control_covariance = _to_laser(control, control_covariance)
    return LandmarkLog(
        name="Victoria Park",
        start=np.zeros(3),
        time=scan_time,
        motion="compose",
        control=control,
        control_covariance=control_covariance,
        observation_pose=scan_of,
        observation=observation,
        observation_covariance=covariance,
        landmark=np.full(len(observation), -1, np.int64),
        odometry_bias=VICTORIA_PARK_BIAS,
        truth=_gps(path.with_name("aa3_gpsx.mat")),
    )


def center_motion(speed: FloatArray, steering: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed (m/s) and turn rate (rad/s) of the middle of the rear axle, (n,) each.

    From the speed (n,) of the left rear wheel in m/s and the steering angle (n,) in radians.
    """
    center = speed / (1 - np.tan(steering) * ENCODER_OFFSET / WHEEL_BASE)
    return center, center * np.tan(steering) / WHEEL_BASE


def _numbers(path: Path, name: str, values: object, shape: tuple[int, ...]) -> FloatArray:
    """Finite numbers of a variable; an empty array has any shape."""
    with reading(path, LogError, f"numbers in {name}", TypeError, ValueError):
        array = np.asarray(values, np.float64)
    array = array.reshape(shape) if array.size == prod(shape) == 0 else array
    if array.shape != shape or not (np.abs(array) < LARGEST_VALUE).all():
        raise LogError(
            f"{path}: expected finite numbers of shape {shape} in {name}, found {array.shape} with "
            f"{int((~(np.abs(array) < LARGEST_VALUE)).sum())} others"
        )
    return array


def _times(path: Path, name: str, variables: Mapping[str, Any]) -> FloatArray:
    """Ascending times (n,) of a variable."""
    time = np.ravel(_numbers(path, name, variables[name], np.shape(variables[name])))
    if (np.diff(time) < 0).any():
        raise LogError(f"{path}: expected {name} to be ascending, found that it is not")
    return time


def _to_laser(control: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relative poses of the laser, from those of the rear axle."""
    arm = rotated(np.tile(LASER, (len(control), 1)), control[:, 2])  # (t, 2)
    laser = control.copy()
    laser[:, :2] += arm - LASER
    A = np.tile(np.eye(3), (len(control), 1, 1))
    A[:, 0, 2], A[:, 1, 2] = -arm[:, 1], arm[:, 0]
    return laser, A @ covariance @ A.transpose(0, 2, 1)


def _gps(path: Path) -> Trajectory | None:
    if not path.exists():
        return None
    variables = read_matlab(path, ("timeGps", "La_m", "Lo_m"))
    time = _times(path, "timeGps", variables) / 1000
    x, y = (np.ravel(variables[name]) for name in ("Lo_m", "La_m"))
    x, y = (_numbers(path, "La_m and Lo_m", each, time.shape) for each in (x, y))
    return Trajectory(time, np.stack([x, y, np.full(len(time), np.nan)], 1))
