"""The Victoria Park log: Guivant & Nebot (2001), a car among the trees of a park in Sydney."""

from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.logs.conversions import (
    OdometryNoise,
    integrate,
    to_cartesian,
    to_range_bearing,
)
from saccade.datasets.logs.pose_graph import read_pose_graph
from saccade.datasets.matlab import read_matlab
from saccade.errors import LogError, require
from saccade.types import FloatArray, LandmarkLog, Trajectory

Reference: TypeAlias = Literal["laser", "axle"]
"""Reference point of the vehicle's pose."""
WHEEL_BASE, ENCODER_OFFSET = 2.83, 0.76
"""L, H: metres from the rear to the front axle, and from the middle of the rear axle to the left
rear wheel, which has the encoder."""
LASER = (3.78, 0.5)
"""a, b: position of the laser, metres ahead of and to the left of the middle of the rear axle."""
VICTORIA_PARK_ODOMETRY = OdometryNoise(distance=0.06, turn=0.06, drift=0.0125)
"""Wheel slip, without the systematic errors."""
VICTORIA_PARK_BIAS = (0.05, 0.02, 0.02)
"""See `LandmarkLog.odometry_bias`; a steering offset of one degree turns the car by 0.006 rad per
metre."""
MAX_SPEED, MAX_TIME = 1e6, 1e15
"""Bounds of valid values, in metres per second and milliseconds."""
VICTORIA_PARK_SENSOR = (0.2, 0.015)
"""Standard deviations of range (m) and bearing (rad) of a tree, whose trunk is not a point."""


def read_victoria_park(
    path: str | Path,
    odometry_noise: OdometryNoise = VICTORIA_PARK_ODOMETRY,
    sensor_sigma: tuple[float, float] = VICTORIA_PARK_SENSOR,
    reference: Reference = "laser",
) -> LandmarkLog:
    """Read the Victoria Park log, raw or as GTSAM distributes it.

    The raw .mat has speed and steering angle at 40 Hz and the trees detected in each laser scan.
    There is a pose at the time of each scan; between scans the motion of the rear axle is
    integrated by `integrate` and transformed to the reference point. Trees have no identity. The
    log starts at the origin.

    Args:
        path: the .mat, or the .txt with known identities, which includes its own noise.
        odometry_noise: see `load`; of the .mat.
        sensor_sigma: see `load`; of the .mat.
        reference: see `load`; for the "axle" observations and covariances are transformed.

    Returns:
        The log; of the .mat with the GPS of `aa3_gpsx.mat` beside it, if it exists, as ground
        truth: its headings are NaN and its frame is not that of the log.

    Raises:
        LogError: no such file, or not this log.
        ConfigError: a standard deviation that is not positive, or an unknown reference point.
    """
    require(reference in get_args(Reference), "reference", "laser or axle", reference)
    require(min(sensor_sigma) > 0, "sensor_sigma", "two positive numbers", sensor_sigma)
    path = Path(path)
    if path.suffix.lower() != ".mat":
        return read_pose_graph(path)
    variables = read_matlab(path, ("time", "u", "TLsr", "zt"))
    time = _ascending(path, "time", variables["time"])
    scan_time = _ascending(path, "TLsr", variables["TLsr"])
    u = _array(path, "u", variables["u"])
    scans = variables["zt"]
    if u.shape != (2, len(time)) or len(scans) != len(scan_time) or len(scan_time) == 0:
        raise LogError(
            f"{path}: expected u of shape (2, {len(time)}) and {len(scan_time)} scans in zt, "
            f"found {u.shape} and {len(scans)}"
        )
    if not (np.abs(u) < MAX_SPEED).all():
        raise LogError(
            f"{path}: expected speeds and steering angles under {MAX_SPEED:g} in u, found others"
        )
    speed, turn_rate = center_motion(u[0], u[1])
    control, control_covariance = integrate(time, speed, turn_rate, scan_time, odometry_noise)
    trees = [_trees(path, number, scan) for number, scan in enumerate(scans)]
    observation = np.concatenate(trees)  # (k, 2) range and bearing from the laser
    scan_of = np.repeat(np.arange(len(scan_time), dtype=np.int64), [len(t) for t in trees])
    covariance = np.tile(np.diag(np.square(sensor_sigma)), (len(observation), 1, 1))
    if reference == "laser":
        control, control_covariance = _to_laser(control, control_covariance)
    else:
        xy, covariance = to_cartesian(observation, covariance)
        observation, covariance = to_range_bearing(
            xy + LASER, covariance, lambda k: f"{path}, scan {scan_of[k]}"
        )
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


def _array(path: Path, name: str, values: object) -> FloatArray:
    """Values of a variable as float64."""
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise LogError(f"{path}: expected numbers in {name}, found something else") from error


def _ascending(path: Path, name: str, values: object) -> FloatArray:
    """Times (n,) of a variable, finite and ascending."""
    time = _array(path, name, values).ravel()
    if not (np.abs(time) < MAX_TIME).all() or (np.diff(time) < 0).any():
        raise LogError(f"{path}: expected {name} to be finite and ascending, found that it is not")
    return time


def _trees(path: Path, number: int, scan: object) -> FloatArray:
    """Range and bearing (n, 2) of the trees in a scan."""
    trees = _array(path, f"scan {number}", scan)
    if trees.size == 0:
        return np.empty((0, 2))
    if trees.ndim != 2 or len(trees) != 3 or not np.isfinite(trees).all():
        raise LogError(
            f"{path}, scan {number}: expected finite rows of range, bearing and diameter, "
            f"found shape {trees.shape}"
        )
    return np.stack([trees[0], trees[1] - np.pi / 2], 1)  # the scan starts at the right


def _to_laser(control: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Relative poses of the laser, from those of the rear axle."""
    c, s = np.cos(control[:, 2]), np.sin(control[:, 2])
    arm = np.stack([c * LASER[0] - s * LASER[1], s * LASER[0] + c * LASER[1]], 1)  # (t, 2)
    laser = control.copy()
    laser[:, :2] += arm - LASER
    A = np.tile(np.eye(3), (len(control), 1, 1))
    A[:, 0, 2], A[:, 1, 2] = -arm[:, 1], arm[:, 0]
    return laser, A @ covariance @ A.transpose(0, 2, 1)


def _gps(path: Path) -> Trajectory | None:
    if not path.exists():
        return None
    variables = read_matlab(path, ("timeGps", "La_m", "Lo_m"))
    time = _ascending(path, "timeGps", variables["timeGps"]) / 1000
    x, y = (_array(path, name, variables[name]).ravel() for name in ("Lo_m", "La_m"))
    if len(x) != len(time) or len(y) != len(time) or not np.isfinite(x + y).all():
        raise LogError(f"{path}: expected one finite position for each of the {len(time)} times")
    return Trajectory(time, np.stack([x, y, np.full(len(time), np.nan)], 1))
