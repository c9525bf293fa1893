"""Conversions of odometry and observations with their covariances."""

import warnings
from dataclasses import MISSING, dataclass

import numpy as np

from saccade.datasets.drives.sidecar_files import START_UNKNOWN
from saccade.errors import LogError, LogWarning, Settings, setting
from saccade.plane import rotated
from saccade.types import FloatArray, LandmarkLog, Trajectory


@dataclass(frozen=True)
class OdometryNoise(Settings):
    """Random odometry errors, whose variances grow with the path length.

    A robot at rest accumulates no error, and the result is independent of the sampling rate.
    """

    distance: float = setting(MISSING, 0, 1000)
    """Standard deviation of the distance after one meter, in meters."""
    turn: float = setting(MISSING, 0, 1000)
    """Standard deviation of the heading after turning by one radian, in radians."""
    drift: float = setting(MISSING, 0, 1000)
    """Standard deviation of the heading after one meter straight ahead, in radians."""

    def variances(self, distance: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variances (n,) of distance and heading after steps (n,) in meters and radians."""
        distance, turn = np.abs(distance), np.abs(turn)
        return self.distance**2 * distance, self.turn**2 * turn + self.drift**2 * distance


ASSUMED_ODOMETRY = OdometryNoise(distance=0.05, turn=0.05, drift=0.05)
"""Assumed errors of odometry without covariance."""
ASSUMED_SENSOR = (0.05, 0.02)
"""Assumed standard deviations of observations without covariance: range, as a fraction, and bearing
in radians."""

ASSUMED = (
    f"{ASSUMED_ODOMETRY.distance:g} m and {ASSUMED_ODOMETRY.drift:g} rad after 1 m, "
    f"{ASSUMED_ODOMETRY.turn:g} rad after a turn by 1 rad",
    f"{ASSUMED_SENSOR[0]:.0%} of the range, {ASSUMED_SENSOR[1]:g} rad of the bearing",
)
"""Assumed standard deviations of controls and of observations, as text."""


def sensor_variances(distance: FloatArray, sigma: tuple[float, float]) -> FloatArray:
    """Variances (n, 2) of range and bearing at ranges (n,), given as `ASSUMED_SENSOR`."""
    return np.stack([(sigma[0] * distance) ** 2, np.full(len(distance), sigma[1] ** 2)], 1)


def integrate(
    time: FloatArray,
    speed: FloatArray,
    turn_rate: FloatArray,
    pose_time: FloatArray,
    noise: OdometryNoise,
) -> tuple[FloatArray, FloatArray]:
    """Relative poses between given times, from piecewise constant speeds.

    Each segment of constant speed and turn rate is an arc. The robot is at rest before the first
    sample; the last sample is held to the end.

    Args:
        time: (n,) seconds, ascending.
        speed: (n,) meters per second.
        turn_rate: (n,) radians per second.
        pose_time: (t + 1,) times of the poses, ascending.
        noise: of distance and heading.

    Returns:
        (t, 3) relative pose in the frame of the previous pose: forward, left, turn; and its
        covariance (t, 3, 3).
    """
    if len(pose_time) < 2:
        return np.empty((0, 3)), np.empty((0, 3, 3))
    inside = time[(time > pose_time[0]) & (time < pose_time[-1])]
    knots = np.concatenate([pose_time, inside])
    knots = knots[np.argsort(knots, kind="stable")]  # (p + 1,) ends of the segments
    sample = np.searchsorted(time, knots[:-1], side="right") - 1
    duration = np.where(sample >= 0, np.diff(knots), 0.0)
    d, phi = speed[sample] * duration, turn_rate[sample] * duration  # (p,)

    theta = np.concatenate([[0.0], np.cumsum(phi)])  # (p + 1,) heading at each knot
    middle = (theta[:-1] + theta[1:]) / 2
    direction = np.stack([np.cos(middle), np.sin(middle)], 1)  # (p, 2)
    chord = (d * np.sinc(phi / (2 * np.pi)))[:, None] * direction
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(chord, 0)])  # (p + 1, 2)

    edge = np.searchsorted(knots, pose_time)  # (t + 1,) start index of each interval
    interval = np.searchsorted(edge[:-1], np.arange(len(d)), side="right") - 1  # (p,)
    start, end = edge[:-1], edge[1:]
    control = np.empty((len(start), 3))
    control[:, :2] = rotated(xy[end] - xy[start], -theta[start])
    control[:, 2] = theta[end] - theta[start]

    distance_error = np.zeros((len(d), 3))
    distance_error[:, :2] = rotated(direction, -theta[start][interval])
    turn_error = np.ones((len(d), 3))  # a heading error rotates the rest of the path
    arm = rotated(xy[end][interval] - xy[:-1] - chord / 2, -theta[start][interval])
    turn_error[:, 0], turn_error[:, 1] = -arm[:, 1], arm[:, 0]
    distance_error *= noise.distance * np.sqrt(np.abs(d))[:, None]
    turn_error *= np.sqrt(noise.turn**2 * np.abs(phi) + noise.drift**2 * np.abs(d))[:, None]
    covariance = np.zeros((len(start), 3, 3))
    for error in (distance_error, turn_error):
        np.add.at(covariance, interval, error[:, :, None] * error[:, None, :])
    return control, covariance


def start_of(truth: Trajectory | None, time: float, name: str) -> FloatArray:
    """The true pose (3,) at a time in seconds, or the origin with a `LogWarning`."""
    pose = np.zeros(3) if truth is None else truth.at(np.array([time]))[0]
    if not np.isfinite(pose).all():
        warnings.warn(f"{name}: {START_UNKNOWN}", LogWarning, stacklevel=4)
    return np.nan_to_num(pose)


def require_numbered(log: LandmarkLog, form: str) -> None:
    """Raises `LogError` unless every observation has an integer label, as `form` requires."""
    unknown = int((log.landmark < 0).sum())
    if unknown or log.text_names:
        found = f"none for {unknown} observations" if unknown else repr(log.text_names[0])
        raise LogError(
            f"{log.name}: {form} needs a number as the label of every observation, found {found}; "
            "write it as CSV"
        )
