"""The UTIAS multi-robot data sets: Leung, Halpern, Barfoot & Liu (IJRR 2011)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saccade.datasets.archive import Archive
from saccade.datasets.odometry import OdometryNoise, integrate
from saccade.datasets.text import read_columns
from saccade.errors import LogError, require
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

ROBOTS = 5
"""Subjects 1 to 5 are the robots themselves; the others are landmarks."""
LONGEST_STEP = 0.5
"""Seconds; poses are put between observations that are farther apart."""
LONGEST_RUN = 1e6
"""Seconds; a log that is longer has a broken time in it."""
STALE = 0.2
"""Seconds by which the first odometry sample may be stamped after the second: those of most
robots of set 9 are, and are left out."""
MRCLAM_ODOMETRY = OdometryNoise(distance=0.05, turn=0.1, drift=0.03)
"""As large as the odometry's errors against the cameras' truth are in set 6, over 1 to 16 s,
beside those that are the same all the time."""
MRCLAM_SENSOR = (0.08, 0.012)
"""Standard deviations of range (m) and bearing (rad)."""
WIDEST = 1.0
"""Radians from its axis beyond which no camera of these robots sees."""
UTIAS_BARCODES = (5, 14, 41, 32, 23)
"""On the robots of the published sets, by which these are known."""


@dataclass(frozen=True)
class Platform:
    """What the numbers that a robot logs say of it."""

    latency: float
    """Seconds after which a robot carries out the speeds in its log, which are commands."""
    turn: float
    """Radians that it turns for each in its log."""
    depth: float | None
    """What is logged as the range of a landmark, per metre along the axis of the camera; None
    where ranges are ranges."""
    odometry_bias: tuple[float, float, float]
    """See `LandmarkLog.odometry_bias`."""

    @classmethod
    def ideal(cls) -> "Platform":
        """A robot whose numbers say what they are called."""
        return cls(latency=0.0, turn=1.0, depth=None, odometry_bias=(0.0, 0.0, 0.0))

    @classmethod
    def utias(cls) -> "Platform":
        """The robots of the published sets.

        Measured against the truth of set 6, alike in all five robots: their range is
        proportional to the cosine of the bearing, for it comes from the height of the
        barcode in the image. With that, the errors of range shrink from 4 to 1 %. They go
        2 to 5 % farther than they say, less 0.1 m for each radian that they turn, and veer to
        the right by 0.01 to 0.06 rad a metre, which is left to the filter. The innovations of
        set 9, which has no truth, shrink by the same corrections.
        """
        return cls(latency=0.2, turn=0.93, depth=1.035, odometry_bias=(0.1, 0.1, 0.1))


_ODOMETRY = ("time", "forward velocity", "angular velocity")
_MEASUREMENT = ("time", "barcode", "range", "bearing")
_GROUNDTRUTH = ("time", "x", "y", "heading")
_LANDMARK = ("subject", "x", "y", "x sigma", "y sigma")
_BARCODE = ("subject", "barcode")


@dataclass(frozen=True)
class _Tables:
    barcode: FloatArray
    odometry: FloatArray
    measurement: FloatArray
    groundtruth: FloatArray | None
    landmark: FloatArray | None


def read_mrclam(
    path: str | Path,
    robot: int = 1,
    odometry_noise: OdometryNoise = MRCLAM_ODOMETRY,
    sensor_sigma: tuple[float, float] = MRCLAM_SENSOR,
    platform: Platform | None = None,
) -> LandmarkLog:
    """Read one robot of an MRCLAM set.

    There is a pose at every time of a measurement, and others between them so
    that no step is longer than half a second; the odometry is integrated
    between them by `integrate`. Sightings of other robots and of barcodes that
    are in no list are left out. Where the truth is known, the log begins at the
    true pose: its frame is that of the surveyed landmarks.

    Args:
        path: the published folder (Barcodes.dat, RobotN_Odometry.dat, ...), or an
            .npz with the same tables.
        robot: 1 to 5.
        odometry_noise: of the wheels.
        sensor_sigma: standard deviations of range (m) and bearing (rad).
        platform: what the numbers mean; `Platform.utias` in the published sets and
            `Platform.ideal` in others unless told otherwise.

    Returns:
        The log; `landmark` is the subject, 6 to 20.

    Raises:
        LogError: a file is missing or broken; names the file and the line.
        ConfigError: no such robot, or a deviation that is not positive.
    """
    require(1 <= robot <= ROBOTS, "robot", "a number from 1 to 5", robot)
    require(min(sensor_sigma) > 0, "sensor_sigma", "two positive numbers", sensor_sigma)
    path = Path(path)
    tables = _npz_tables(path, robot) if path.is_file() else _dat_tables(path, robot)
    time, speed, turn_rate = tables.odometry.T
    if len(time) == 0:
        raise LogError(f"{path}: expected odometry of robot {robot}, found none")

    barcodes = _whole(path, "barcodes", tables.barcode)
    subject_of = {int(barcode): int(subject) for subject, barcode in barcodes}
    if platform is None:
        published = all(subject_of.get(b) == i + 1 for i, b in enumerate(UTIAS_BARCODES))
        platform = Platform.utias() if published else Platform.ideal()
    subject = np.array([subject_of.get(int(b), -1) for b in tables.measurement[:, 1]], np.int64)
    seen = tables.measurement[subject > ROBOTS]  # (k, 4)
    whole = np.concatenate([time[[0, -1]], seen[:, 0]])
    if not np.ptp(whole) < LONGEST_RUN:
        raise LogError(
            f"{path}: expected times within {LONGEST_RUN:.0f} s of each other, "
            f"found {whole.min():g} to {whole.max():g} s"
        )
    at = _pose_times(whole.min(), whole.max(), seen[:, 0])
    control, control_covariance = integrate(
        time + platform.latency, speed, platform.turn * turn_rate, at, odometry_noise
    )
    truth = _trajectory(tables.groundtruth)
    landmarks = tables.landmark
    return LandmarkLog(
        name=f"{path.stem}, robot {robot}",
        start=np.zeros(3) if truth is None else _interpolate(truth, float(at[0])),
        time=at,
        motion="compose",
        control=control,
        control_covariance=control_covariance,
        observation_pose=np.searchsorted(at, seen[:, 0]).astype(np.int64),
        observation=_observations(seen[:, 2:], platform),
        observation_covariance=np.tile(np.diag(np.square(sensor_sigma)), (len(seen), 1, 1)),
        landmark=subject[subject > ROBOTS],
        odometry_bias=platform.odometry_bias,
        truth=truth,
        landmark_truth=None
        if landmarks is None
        else LandmarkMap(
            id=_whole(path, "landmarks", landmarks[:, :1])[:, 0],
            xy=landmarks[:, 1:3].copy(),
            covariance=landmarks[:, 3:, None] ** 2 * np.eye(2),
        ),
    )


def _observations(logged: FloatArray, platform: Platform) -> FloatArray:
    """Range and bearing (k, 2) from what is logged."""
    z = logged.copy()
    if platform.depth is not None:
        z[:, 0] /= platform.depth * np.cos(np.clip(z[:, 1], -WIDEST, WIDEST))
    return z


def _dat_tables(folder: Path, robot: int) -> _Tables:
    def table(name: str, columns: tuple[str, ...]) -> FloatArray:
        return read_columns(folder / name, columns)

    if not folder.is_dir():
        raise LogError(f"{folder}: expected a folder with Barcodes.dat or an .npz, found nothing")
    truth = f"Robot{robot}_Groundtruth.dat"
    surveyed = (folder / "Landmark_Groundtruth.dat").exists()
    return _Tables(
        barcode=table("Barcodes.dat", _BARCODE),
        odometry=read_columns(folder / f"Robot{robot}_Odometry.dat", _ODOMETRY, STALE),
        measurement=table(f"Robot{robot}_Measurement.dat", _MEASUREMENT),
        groundtruth=table(truth, _GROUNDTRUTH) if (folder / truth).exists() else None,
        landmark=table("Landmark_Groundtruth.dat", _LANDMARK) if surveyed else None,
    )


def _npz_tables(path: Path, robot: int) -> _Tables:
    archive = Archive(path)

    def table(name: str, columns: tuple[str, ...]) -> FloatArray:
        return archive.table(name, columns)

    truth = f"robot{robot}_groundtruth"
    return _Tables(
        barcode=table("barcodes", _BARCODE),
        odometry=archive.table(f"robot{robot}_odometry", _ODOMETRY, STALE),
        measurement=table(f"robot{robot}_measurement", _MEASUREMENT),
        groundtruth=table(truth, _GROUNDTRUTH) if truth in archive else None,
        landmark=table("landmarks", _LANDMARK) if "landmarks" in archive else None,
    )


def _whole(path: Path, name: str, table: FloatArray) -> IntArray:
    """Numbers of subjects and barcodes as integers; a float64 holds those under 2^53 exactly."""
    wrong = np.argwhere((table != np.floor(table)) | (np.abs(table) >= 2**53))
    if len(wrong):
        raise LogError(
            f"{path}, {name}, row {wrong[0, 0] + 1}: expected whole numbers under 2^53, "
            f"found {table[tuple(wrong[0])]:g}"
        )
    return table.astype(np.int64)


def _pose_times(first: float, last: float, seen: FloatArray) -> FloatArray:
    steps = int(np.ceil((last - first) / LONGEST_STEP))
    regular = np.linspace(first, last, steps + 1) if steps else np.array([first])
    return np.union1d(regular, seen)


def _trajectory(table: FloatArray | None) -> Trajectory | None:
    if table is None or len(table) == 0:
        return None
    return Trajectory(time=table[:, 0].copy(), pose=table[:, 1:].copy())


def _interpolate(truth: Trajectory, time: float) -> FloatArray:
    x, y = (np.interp(time, truth.time, truth.pose[:, i]) for i in range(2))
    theta = np.interp(time, truth.time, np.unwrap(truth.pose[:, 2]))
    return np.array([x, y, np.arctan2(np.sin(theta), np.cos(theta))])
