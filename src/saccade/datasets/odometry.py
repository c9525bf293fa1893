"""Timed speeds and turn rates, integrated between the times that matter."""

from dataclasses import dataclass

import numpy as np

from saccade.errors import require
from saccade.types import FloatArray


@dataclass(frozen=True)
class OdometryNoise:
    """How far odometry goes astray: variances grow with the way, not with the samples.

    A robot that stands still loses nothing, however long it stands, and
    splitting a way into pieces changes nothing.
    """

    distance: float
    """Standard deviation of the distance after one metre, in metres."""
    turn: float
    """Standard deviation of the heading after turning by one radian, in radians."""
    drift: float
    """Standard deviation of the heading after one metre straight ahead, in radians."""

    def __post_init__(self) -> None:
        for name in ("distance", "turn", "drift"):
            value = getattr(self, name)
            require(0 <= value < 1e3, name, "from 0 to under 1000", value)


def integrate(
    time: FloatArray,
    speed: FloatArray,
    turn_rate: FloatArray,
    at: FloatArray,
    noise: OdometryNoise,
) -> tuple[FloatArray, FloatArray]:
    """Relative poses between given times, from speeds that hold until the next one.

    Each piece of constant speed and turn rate is an arc. Before the first
    sample the robot stands; the last one holds to the end.

    Args:
        time: (n,) seconds, ascending.
        speed: (n,) metres per second.
        turn_rate: (n,) radians per second.
        at: (t + 1,) times of the poses, ascending.
        noise: of distance and heading.

    Returns:
        (t, 3) each pose in the frame of the last: forward, left, turn; and its
        covariance (t, 3, 3).
    """
    if len(at) < 2:
        return np.empty((0, 3)), np.empty((0, 3, 3))
    inside = time[(time > at[0]) & (time < at[-1])]
    cut = np.concatenate([at, inside])
    cut = cut[np.argsort(cut, kind="stable")]  # (p + 1,) ends of the pieces
    sample = np.searchsorted(time, cut[:-1], side="right") - 1
    duration = np.where(sample >= 0, np.diff(cut), 0.0)
    d, phi = speed[sample] * duration, turn_rate[sample] * duration  # (p,)

    theta = np.concatenate([[0.0], np.cumsum(phi)])  # (p + 1,) heading at each cut
    middle = (theta[:-1] + theta[1:]) / 2
    direction = np.stack([np.cos(middle), np.sin(middle)], 1)  # (p, 2)
    chord = (d * np.sinc(phi / (2 * np.pi)))[:, None] * direction
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(chord, 0)])  # (p + 1, 2)

    edge = np.searchsorted(cut, at)  # (t + 1,) where each interval begins
    interval = np.searchsorted(edge[:-1], np.arange(len(d)), side="right") - 1  # (p,)
    start, end = edge[:-1], edge[1:]
    control = np.empty((len(start), 3))
    control[:, :2] = _turn_back(xy[end] - xy[start], theta[start])
    control[:, 2] = theta[end] - theta[start]

    by_distance = np.zeros((len(d), 3))
    by_distance[:, :2] = _turn_back(direction, theta[start][interval])
    by_turn = np.ones((len(d), 3))  # an error in turning swings what remains of the way
    ahead = _turn_back(xy[end][interval] - xy[:-1] - chord / 2, theta[start][interval])
    by_turn[:, 0], by_turn[:, 1] = -ahead[:, 1], ahead[:, 0]
    by_distance *= noise.distance * np.sqrt(np.abs(d))[:, None]
    by_turn *= np.sqrt(noise.turn**2 * np.abs(phi) + noise.drift**2 * np.abs(d))[:, None]
    covariance = np.zeros((len(start), 3, 3))
    for share in (by_distance, by_turn):
        np.add.at(covariance, interval, share[:, :, None] * share[:, None, :])
    return control, covariance


def _turn_back(xy: FloatArray, theta: FloatArray) -> FloatArray:
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([c * xy[:, 0] + s * xy[:, 1], -s * xy[:, 0] + c * xy[:, 1]], 1)
