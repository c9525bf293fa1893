"""The Victoria Park log: Guivant & Nebot (2001), a car among the trees of a park in Sydney."""

from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.logs.cartesian import to_cartesian, to_range_bearing
from saccade.datasets.logs.isam import read_isam
from saccade.datasets.matlab import read_matlab
from saccade.datasets.odometry import OdometryNoise, integrate
from saccade.errors import LogError, require
from saccade.types import FloatArray, IntArray, LandmarkLog, Trajectory

Reference: TypeAlias = Literal["laser", "axle"]
"""The point of the car that a pose is of."""
WHEEL_BASE = 2.83
"""L: metres from the rear to the front axle."""
ENCODER_OFFSET = 0.76
"""H: metres from the middle of the rear axle to the left rear wheel, which is counted."""
LASER = (3.78, 0.5)
"""a, b: the laser before and to the left of the middle of the rear axle, in metres."""
VICTORIA_PARK_ODOMETRY = OdometryNoise(distance=0.06, turn=0.06, drift=0.0125)
"""Slip, beside what is the same all the time."""
VICTORIA_PARK_BIAS = (0.05, 0.02, 0.02)
"""See `LandmarkLog.odometry_bias`; a steering angle that is off by a degree turns the car by
0.006 rad a metre."""
FASTEST, LATEST = 1e6, 1e15
"""Metres a second, and milliseconds, that no car has seen."""
VICTORIA_PARK_SENSOR = (0.2, 0.015)
"""Standard deviations of range (m) and bearing (rad) of a tree: its trunk is no point."""


def read_victoria_park(
    path: str | Path,
    odometry_noise: OdometryNoise = VICTORIA_PARK_ODOMETRY,
    sensor_sigma: tuple[float, float] = VICTORIA_PARK_SENSOR,
    reference: Reference = "laser",
) -> LandmarkLog:
    """Read the Victoria Park log, raw or as GTSAM distributes it.

    The raw .mat holds speed and steering angle at 40 Hz and the trees found in
    each laser scan. There is a pose at the time of each scan; between them the
    path of the rear axle is integrated by `integrate` and moved to the
    reference point. Trees have no identity. The log begins at the origin.

    Args:
        path: the .mat, or the .txt with known identities, which brings its own noise.
        odometry_noise: of speed and steering in the .mat.
        sensor_sigma: standard deviations of range (m) and bearing (rad) in the .mat.
        reference: what the poses of the .mat are of: the "laser", beside which the GPS
            antenna stands, or the middle of the rear "axle", to which the
            observations are then moved, covariance and all.

    Returns:
        The log; of the .mat with the GPS of `aa3_gpsx.mat` beside it, if it is
        there, as truth: its headings are NaN and its frame is not that of the log.

    Raises:
        LogError: no such file, or not this log.
        ConfigError: a deviation that is not positive, or another reference point.
    """
    require(reference in get_args(Reference), "reference", "laser or axle", reference)
    require(min(sensor_sigma) > 0, "sensor_sigma", "two positive numbers", sensor_sigma)
    path = Path(path)
    if path.suffix.lower() != ".mat":
        return read_isam(path)
    held = read_matlab(path, ("time", "u", "TLsr", "zt"))
    time, at = _ascending(path, "time", held["time"]), _ascending(path, "TLsr", held["TLsr"])
    u = _array(path, "u", held["u"])
    scans = held["zt"]
    if u.shape != (2, len(time)) or len(scans) != len(at) or len(at) == 0:
        raise LogError(
            f"{path}: expected u of shape (2, {len(time)}) and {len(at)} scans in zt, "
            f"found {u.shape} and {len(scans)}"
        )
    if not (np.abs(u) < FASTEST).all():
        raise LogError(
            f"{path}: expected speeds and steering angles under {FASTEST:g} in u, found others"
        )
    speed, turn_rate = center_motion(u[0], u[1])
    control, control_covariance = integrate(time, speed, turn_rate, at, odometry_noise)
    trees = [_trees(path, number, scan) for number, scan in enumerate(scans)]
    seen = np.concatenate(trees)  # (k, 2) range and bearing from the laser
    scan_of = np.repeat(np.arange(len(at), dtype=np.int64), [len(t) for t in trees])
    observation = seen
    covariance = np.tile(np.diag(np.square(sensor_sigma)), (len(seen), 1, 1))
    if reference == "laser":
        control, control_covariance = _to_laser(control, control_covariance)
    else:
        observation, covariance = _to_axle(path, seen, covariance, scan_of)
    return LandmarkLog(
        name="Victoria Park",
        start=np.zeros(3),
        time=at,
        motion="compose",
        control=control,
        control_covariance=control_covariance,
        observation_pose=scan_of,
        observation=observation,
        observation_covariance=covariance,
        landmark=np.full(len(seen), -1, np.int64),
        odometry_bias=VICTORIA_PARK_BIAS,
        truth=_gps(path.with_name("aa3_gpsx.mat")),
    )


def center_motion(speed: FloatArray, steering: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed and turn rate of the rear axle's middle, from the left wheel's and the steering.

    Args:
        speed: (n,) of the left rear wheel in m/s.
        steering: (n,) angle of the front wheels in radians, positive to the left.

    Returns:
        Speed in m/s and turn rate in rad/s, (n,) each.
    """
    center = speed / (1 - np.tan(steering) * ENCODER_OFFSET / WHEEL_BASE)
    return center, center * np.tan(steering) / WHEEL_BASE


def _array(path: Path, name: str, values: object) -> FloatArray:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise LogError(f"{path}: expected numbers in {name}, found something else") from error


def _ascending(path: Path, name: str, values: object) -> FloatArray:
    time = _array(path, name, values).ravel()
    if not (np.abs(time) < LATEST).all() or (np.diff(time) < 0).any():
        raise LogError(f"{path}: expected {name} to be finite and ascending, found that it is not")
    return time


def _trees(path: Path, number: int, scan: object) -> FloatArray:
    found = _array(path, f"scan {number}", scan)
    if found.size == 0:
        return np.empty((0, 2))
    if found.ndim != 2 or len(found) != 3 or not np.isfinite(found).all():
        raise LogError(
            f"{path}, scan {number}: expected finite rows of range, bearing and diameter, "
            f"found shape {found.shape}"
        )
    return np.stack([found[0], found[1] - np.pi / 2], 1)  # the scan begins at the right


def _to_laser(control: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relative poses of the laser, from those of the rear axle."""
    c, s = np.cos(control[:, 2]), np.sin(control[:, 2])
    arm = np.stack([c * LASER[0] - s * LASER[1], s * LASER[0] + c * LASER[1]], 1)  # (t, 2)
    moved = control.copy()
    moved[:, :2] += arm - LASER
    A = np.tile(np.eye(3), (len(control), 1, 1))
    A[:, 0, 2], A[:, 1, 2] = -arm[:, 1], arm[:, 0]
    return moved, A @ covariance @ A.transpose(0, 2, 1)


def _to_axle(
    path: Path, seen: FloatArray, covariance: FloatArray, scan_of: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing from the rear axle, from those of the laser."""
    xy, spread = to_cartesian(seen, covariance)
    return to_range_bearing(xy + LASER, spread, [f"{path}, scan {number}" for number in scan_of])


def _gps(path: Path) -> Trajectory | None:
    if not path.exists():
        return None
    held = read_matlab(path, ("timeGps", "La_m", "Lo_m"))
    time = _ascending(path, "timeGps", held["timeGps"]) / 1000
    x, y = (_array(path, name, held[name]).ravel() for name in ("Lo_m", "La_m"))
    if len(x) != len(time) or len(y) != len(time) or not np.isfinite(x + y).all():
        raise LogError(f"{path}: expected one finite place for each of the {len(time)} times")
    return Trajectory(time, np.stack([x, y, np.full(len(time), np.nan)], 1))
