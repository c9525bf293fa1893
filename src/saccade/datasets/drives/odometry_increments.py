"""Odometry as steps from frame to frame, whatever the clock it was measured by."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from saccade.errors import DriveError
from saccade.types import FloatArray, IntArray, Trajectory

UNKNOWN_SPEED = 2.0
"""Metres per second; standard deviation of what a robot drives of which nobody says how far."""
UNKNOWN_TURN = 1.0
"""Radians per second; the same for its turns."""
ALONE = 10.0
"""Seconds for which odometry may have to do without anything seen."""


@dataclass(frozen=True, eq=False)
class OdometryIncrements:
    """The way of a robot in m pieces, each in the frame at its beginning."""

    control: FloatArray
    """(m, 3) metres ahead, metres to the left, radians turned."""
    covariance: FloatArray
    """(m, 3, 3)."""

    def __len__(self) -> int:
        return len(self.control)


@dataclass(frozen=True)
class SpeedNoise:
    """How far measured speeds are off: white noise, and a gyroscope's bias."""

    ahead: float
    """Metres per root second, standard deviation of the way after one second."""
    left: float
    """The same to the side."""
    turn: float
    """Radians per root second."""
    turn_bias: float = 0.0
    """Radians per second that stay the same all the time. Covered by as much white noise as
    reaches it after `ALONE`, since a drive has no place for it."""


WHEELS = SpeedNoise(ahead=0.05, left=0.02, turn=0.02, turn_bias=0.002)
"""Of wheel encoders and a gyroscope on a small robot, where nobody says."""


def increments_from_speeds(
    time: FloatArray, speed: FloatArray, turn_rate: FloatArray, at: FloatArray, noise: SpeedNoise
) -> OdometryIncrements:
    """Arcs between frames, from speeds that go straight from sample to sample.

    Args:
        time: (n,) seconds of the samples, ascending.
        speed: (n,) metres per second ahead.
        turn_rate: (n,) radians per second to the left.
        at: (m + 1,) times of the frames, ascending. Beyond the samples the ends hold.
        noise: of the speeds.
    """
    duration = np.diff(at)
    d, phi = (np.diff(_integral(time, each, at)) for each in (speed, turn_rate))
    chord = d * np.sinc(phi / (2 * np.pi))
    control = np.stack([chord * np.cos(phi / 2), chord * np.sin(phi / 2), phi], 1)
    return OdometryIncrements(control, _covariance(d, duration, noise))


def increments_from_poses(
    poses: Trajectory, at: FloatArray, name: str, noise: SpeedNoise = WHEELS
) -> OdometryIncrements:
    """Steps between frames, from poses that odometry has added up already.

    Args:
        poses: by odometry, in any frame.
        at: (m + 1,) times of the frames, ascending; the poses must reach over them.
        name: of the file, for the message.
        noise: of the odometry; the way to the side is in the poses.

    Raises:
        DriveError: the poses begin more than a step after the first frame, or end before the last.
    """
    slack = float(np.diff(at).max(initial=0.0))
    begin, end = float(poses.time[0]), float(poses.time[-1])
    if begin > at[0] + slack or end < at[-1] - slack:
        raise DriveError(
            f"{name}: expected odometry from {at[0]:.3f} to {at[-1]:.3f} s as the frames, "
            f"found {begin:.3f} to {end:.3f} s"
        )
    pose = poses.at(at)
    moved = np.diff(pose[:, :2], axis=0)
    c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
    ahead, left = c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]
    turn = np.angle(np.exp(1j * np.diff(pose[:, 2])))
    duration = np.diff(at)
    return OdometryIncrements(np.stack([ahead, left, turn], 1), _covariance(ahead, duration, noise))


def unknown_increments(at: FloatArray) -> OdometryIncrements:
    """Steps of a robot without odometry: it stands, give or take all that it may do.

    Args:
        at: (m + 1,) times of the frames.
    """
    duration = np.diff(at)
    covariance = np.zeros((len(duration), 3, 3))
    for i, sigma in enumerate((UNKNOWN_SPEED, UNKNOWN_SPEED, UNKNOWN_TURN)):
        covariance[:, i, i] = np.square(sigma * duration)
    return OdometryIncrements(np.zeros((len(duration), 3)), covariance)


def composed(steps: OdometryIncrements, chosen: IntArray, name: str) -> OdometryIncrements:
    """Steps between some of the frames, from those between all.

    Args:
        steps: (m,) from each frame to the next.
        chosen: (k + 1,) numbers of frames, ascending, from 0 to m.
        name: of the file, for the message.

    Raises:
        DriveError: a frame has a number above m, or frames change places.
    """
    if (np.diff(chosen) < 0).any():
        raise DriveError(
            f"{name}: expected frames in the order of their times, found number "
            f"{chosen[np.argmax(np.diff(chosen) < 0) + 1]} later in the files, earlier in time: "
            "its step is not known"
        )
    if chosen[-1] > len(steps):
        raise DriveError(
            f"{name}: expected a step to each of {chosen[-1] + 1} frames, found {len(steps)} steps"
        )
    control = np.zeros((len(chosen) - 1, 3))
    covariance = np.zeros((len(chosen) - 1, 3, 3))
    for k, (first, last) in enumerate(pairwise(chosen.tolist())):
        for i in range(first, last):
            control[k], covariance[k] = _after(
                control[k], covariance[k], steps.control[i], steps.covariance[i]
            )
    return OdometryIncrements(control, covariance)


def _covariance(way: FloatArray, duration: FloatArray, noise: SpeedNoise) -> FloatArray:
    """(m, 3, 3) of steps of some length (m,) and duration (m,), turned while they are driven."""
    turn = noise.turn**2 + noise.turn_bias**2 * min(ALONE, float(duration.sum()))
    covariance = np.zeros((len(duration), 3, 3))
    for i, density in enumerate((noise.ahead**2, noise.left**2, turn)):
        covariance[:, i, i] = density * duration
    covariance[:, 1, 2] = covariance[:, 2, 1] = way / 2 * covariance[:, 2, 2]
    covariance[:, 1, 1] += np.square(way) / 3 * covariance[:, 2, 2]
    return covariance


def _after(
    first: FloatArray, first_covariance: FloatArray, then: FloatArray, then_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One step and then another as a single one."""
    c, s = np.cos(first[2]), np.sin(first[2])
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    way = turned @ then
    swing = np.array([[1.0, 0.0, -way[1]], [0.0, 1.0, way[0]], [0.0, 0.0, 1.0]])
    both = swing @ first_covariance @ swing.T + turned @ then_covariance @ turned.T
    total = first + way
    total[2] = np.angle(np.exp(1j * total[2]))
    return total, both


def _integral(time: FloatArray, rate: FloatArray, at: FloatArray) -> FloatArray:
    """Of a rate from the first sample to times (k,), by the trapezoidal rule."""
    edges = np.union1d(time, at)
    values = np.interp(edges, time, rate)
    pieces = np.diff(edges) * (values[1:] + values[:-1]) / 2
    return np.asarray(np.interp(at, edges, np.concatenate([[0.0], np.cumsum(pieces)])))
