"""Odometry of a camera drive as CSV; the header selects one of three kinds.

    increments  ahead_m, left_m, turn_rad and their covariance: cov_ahead_ahead, cov_ahead_left,
                cov_ahead_turn, cov_left_left, cov_left_turn, cov_turn_turn; row i is the motion
                from frame i to frame i + 1, in the robot's frame at i
    speeds      time_s, ahead_mps, turn_radps; sampled independently of the frames, on their clock
    OXTS        frame, t, vf, vl, vu, wf, wl, wu; from KITTI's inertial unit

Lines that begin with `#` are comments.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.datasets.drives.frames import FrameTimes
from saccade.datasets.tables import (
    covariance_names,
    from_upper_triangle,
    one_of,
    read_csv,
    require_ascending,
    symmetric_columns,
    write_table,
)
from saccade.errors import DriveError
from saccade.plane import steps_between
from saccade.types import FloatArray, IntArray, Trajectory

_MOTION = ("ahead", "left", "turn")
INCREMENT_COLUMNS = ("ahead_m", "left_m", "turn_rad", *covariance_names(_MOTION))
SPEED_COLUMNS = ("time_s", "ahead_mps", "turn_radps")
OXTS_COLUMNS = ("frame", "t", "vf", "vl", "vu", "wf", "wl", "wu")

UNKNOWN_SPEED = 2.0
"""Standard deviation of the speed of a robot without odometry, in meters per second."""
UNKNOWN_TURN = 1.0
"""Standard deviation of the turn rate of a robot without odometry, in radians per second."""
BIAS_HORIZON = 10.0
"""Seconds without landmark updates after which white noise must cover a gyroscope bias."""


class OdometryIncrements(NamedTuple):
    """Motion of a robot in m increments, each in the robot frame at its start."""

    control: FloatArray
    """(m, 3) meters ahead, meters to the left, radians turned."""
    covariance: FloatArray
    """(m, 3, 3)."""
    is_measured: bool = True
    """False for a robot without odometry."""


@dataclass(frozen=True)
class SpeedNoise:
    """Errors of measured speeds: white noise, and a gyroscope bias."""

    ahead: float
    """Noise of the forward speed in meters per root second: the standard deviation after one
    second."""
    left: float
    """Noise of the lateral speed in meters per root second."""
    turn: float
    """Noise of the turn rate in radians per root second."""
    turn_bias: float = 0.0
    """Constant bias in radians per second. A drive does not store it; it is approximated by white
    noise with the same standard deviation after `BIAS_HORIZON`."""


WHEELS = SpeedNoise(ahead=0.05, left=0.02, turn=0.02, turn_bias=0.002)
"""Default for wheel encoders and a gyroscope on a small robot."""
OXTS = SpeedNoise(ahead=0.17, left=0.05, turn=0.018, turn_bias=0.005)
"""Noise measured on KITTI 07 against ground truth: 0.52 m/s and 0.05 rad/s, white at 10 Hz."""


def increments_from_speeds(
    time: FloatArray,
    speed: FloatArray,
    turn_rate: FloatArray,
    frame_time: FloatArray,
    noise: SpeedNoise,
) -> OdometryIncrements:
    """Increments between frames, as arcs, from linearly interpolated speeds.

    Args:
        time: (n,) times of the samples in seconds, ascending; the end samples are extrapolated.
        speed: (n,) meters per second ahead.
        turn_rate: (n,) radians per second to the left.
        frame_time: (m + 1,) times of the frames, ascending.
        noise: noise of the speeds.
    """
    duration = np.diff(frame_time)
    d, phi = (np.diff(_integral(time, rate, frame_time)) for rate in (speed, turn_rate))
    chord = d * np.sinc(phi / (2 * np.pi))
    control = np.stack([chord * np.cos(phi / 2), chord * np.sin(phi / 2), phi], 1)
    return OdometryIncrements(control, _covariance(d, duration, noise))


def increments_from_poses(
    poses: Trajectory, frame_time: FloatArray, name: str
) -> OdometryIncrements:
    """Increments between frames at times (m + 1,), from wheel-odometry poses."""
    _require_coverage(poses.time, frame_time, float(np.diff(frame_time).max(initial=0.0)), name)
    control = steps_between(poses.interpolate(frame_time))
    return OdometryIncrements(control, _covariance(control[:, 0], np.diff(frame_time), WHEELS))


def unknown_increments(frame_time: FloatArray) -> OdometryIncrements:
    """Increments between frames at times (m + 1,) of a robot without odometry.

    The increments are zero, with the covariance of unknown motion.
    """
    duration = np.diff(frame_time)
    sigma = np.outer(duration, (UNKNOWN_SPEED, UNKNOWN_SPEED, UNKNOWN_TURN))
    covariance = np.square(sigma)[:, :, None] * np.eye(3)
    return OdometryIncrements(np.zeros(sigma.shape), covariance, is_measured=False)


def compose_increments(
    increments: OdometryIncrements, frames: IntArray, name: str
) -> OdometryIncrements:
    """Increments between selected frames, with covariances to first order.

    Args:
        increments: increments from each of m + 1 frames to the next.
        frames: (k + 1,) ascending frame numbers, from 0 to m.
        name: name of the file, for error messages.
    """
    if (np.diff(frames) < 0).any():
        raise DriveError(
            f"{name}: expected frames in the order of their times, found frame "
            f"{frames[np.argmax(np.diff(frames) < 0) + 1]} out of order; its increment is unknown"
        )
    if frames[-1] > len(increments.control):
        raise DriveError(
            f"{name}: expected {frames[-1]} increments between {frames[-1] + 1} frames, found "
            f"{len(increments.control)}"
        )
    control = np.zeros((len(frames) - 1, 3))
    covariance = np.zeros((len(frames) - 1, 3, 3))
    for k, (first, last) in enumerate(pairwise(frames.tolist())):
        for i in range(first, last):
            c, s = np.cos(control[k, 2]), np.sin(control[k, 2])
            Fu = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            u = Fu @ increments.control[i]
            Fx = np.array([[1.0, 0.0, -u[1]], [0.0, 1.0, u[0]], [0.0, 0.0, 1.0]])
            control[k] += u
            control[k, 2] = np.angle(np.exp(1j * control[k, 2]))
            covariance[k] = Fx @ covariance[k] @ Fx.T + Fu @ increments.covariance[i] @ Fu.T
    return OdometryIncrements(control, covariance)


def _covariance(distance: FloatArray, duration: FloatArray, noise: SpeedNoise) -> FloatArray:
    """(m, 3, 3) covariances of increments with distances (m,), durations (m,) and a steady turn."""
    turn = noise.turn**2 + noise.turn_bias**2 * min(BIAS_HORIZON, float(duration.sum()))
    covariance = np.zeros((len(duration), 3, 3))
    for i, density in enumerate((noise.ahead**2, noise.left**2, turn)):
        covariance[:, i, i] = density * duration
    covariance[:, 1, 2] = covariance[:, 2, 1] = distance / 2 * covariance[:, 2, 2]
    covariance[:, 1, 1] += np.square(distance) / 3 * covariance[:, 2, 2]
    return covariance


def _require_coverage(time: FloatArray, frame_time: FloatArray, slack: float, name: str) -> None:
    """Raise `DriveError` unless odometry at times (n,) covers the frames up to `slack` seconds."""
    if time[0] > frame_time[0] + slack or time[-1] < frame_time[-1] - slack:
        raise DriveError(
            f"{name}: expected odometry over the time of the frames, {frame_time[0]:.3f} to "
            f"{frame_time[-1]:.3f} s, found {time[0]:.3f} to {time[-1]:.3f} s"
        )


def _integral(time: FloatArray, rate: FloatArray, at: FloatArray) -> FloatArray:
    """Integral of a rate from the first sample to times (k,), by the trapezoidal rule."""
    knots = np.union1d(time, at)
    values = np.interp(knots, time, rate)
    pieces = np.diff(knots) * (values[1:] + values[:-1]) / 2
    return np.asarray(np.interp(at, knots, np.concatenate([[0.0], np.cumsum(pieces)])))


def read_odometry(folder: Path, frames: FrameTimes) -> OdometryIncrements | None:
    """Odometry between the frames, from odometry.csv or odometry_oxts.csv; None without both."""
    files = [folder / name for name in ("odometry.csv", "odometry_oxts.csv")]
    path = next((file for file in files if file.exists()), None)
    if path is None:
        return None
    table = read_csv(path, one_of(INCREMENT_COLUMNS, SPEED_COLUMNS, OXTS_COLUMNS))
    values = table.numbers(*table.names)
    if table.names == list(INCREMENT_COLUMNS):
        increments = OdometryIncrements(values[:, :3], from_upper_triangle(values[:, 3:]))
        return compose_increments(increments, frames.index, str(path))
    is_oxts = table.names == list(OXTS_COLUMNS)
    columns, noise = ([1, 2, 7], OXTS) if is_oxts else ([0, 1, 2], WHEELS)
    if len(values) < 2:
        raise DriveError(f"{path}: expected at least two rows of speeds, found {len(values)}")
    values = require_ascending(values[:, columns], lambda i: table.rows[i].name)
    time, speed, turn_rate = values.T
    _require_coverage(time, frames.time, float(np.median(np.diff(time))), str(path))
    return increments_from_speeds(time, speed, turn_rate, frames.time, noise)


def write_increments(path: Path, increments: OdometryIncrements) -> None:
    """Write increments as CSV, with every digit."""
    columns = dict(zip(INCREMENT_COLUMNS[:3], increments.control.T, strict=True))
    write_table(path, columns | symmetric_columns(_MOTION, increments.covariance))
