"""MRCLAM: logs of five robots among landmarks with barcodes (Leung et al. 2011)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.logs.conversions import OdometryNoise, integrate, start_of
from saccade.datasets.tables import MAX_DURATION, Archive, read_table
from saccade.errors import LogError, require
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

ROBOTS = 5
"""Number of robots: subjects 1 to 5 are robots, all others are landmarks."""
MAX_STEP = 0.5
"""Maximum time between poses of the log, in seconds."""
STALE_LIMIT = 0.2
"""Maximum delay in seconds of the first odometry sample's time stamp relative to the second. Most
logs of set 9 have such a first sample, which is dropped."""
MRCLAM_ODOMETRY = OdometryNoise(distance=0.05, turn=0.1, drift=0.03)
"""Random odometry errors of set 6 over 1 to 16 s, measured against motion capture."""
MRCLAM_SENSOR = (0.08, 0.012)
"""Standard deviations of range (m) and bearing (rad)."""
MAX_CAMERA_BEARING = 1.0
"""Maximum bearing in radians; half the field of view of these robots is less."""
UTIAS_BARCODES = (5, 14, 41, 32, 23)
"""Barcodes on the robots of the published sets, used to identify these sets."""

BARCODES_FILE = "Barcodes.dat"
"""A file of every set."""
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
    """Calibration of a robot: conversion of logged numbers to physical quantities."""

    latency: float = 0.0
    """Delay in seconds between a logged velocity command and its execution."""
    turn: float = 1.0
    """Radians turned per logged radian."""
    depth: float | None = None
    """Logged range per meter of depth along the optical axis; None if the logged range is the
    distance."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """See `LandmarkLog.odometry_bias`."""
    range_errors: tuple[float, float] = (0.0, 0.0)
    """See `LandmarkLog.range_errors`."""


UTIAS = Platform(
    latency=0.2,
    turn=0.93,
    depth=1.035,
    odometry_bias=(0.1, 0.1, 0.1),
    range_errors=(0.005, 0.01),
)
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

    The log has a pose at the time of every measurement, and additional poses so that no step
    exceeds half a second; `integrate` integrates the odometry between poses. Observations of robots
    and of unlisted barcodes are dropped. If ground truth is available, the log starts at the true
    pose, in the frame of the surveyed landmarks.

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
        bearing = np.clip(observation[:, 1], -MAX_CAMERA_BEARING, MAX_CAMERA_BEARING)
        observation[:, 0] /= platform.depth * np.cos(bearing)
    return LandmarkLog(
        name=f"{path.stem}, robot {robot}",
        start=start_of(truth, float(pose_time[0]), f"{path}, robot {robot}"),
        time=pose_time,
        control=control,
        control_covariance=control_covariance,
        observation_pose=np.searchsorted(pose_time, measurements[:, 0]).astype(np.int64),
        observation=observation,
        observation_covariance=np.tile(np.diag(np.square(sensor_sigma)), (len(subject), 1, 1)),
        landmark=subject,
        odometry_bias=platform.odometry_bias,
        range_errors=platform.range_errors,
        truth=truth,
        landmark_truth=landmark_truth,
    )


def _read_tables(path: Path, robot: int) -> dict[str, FloatArray]:
    """The tables of a robot; optional tables may be missing."""
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
