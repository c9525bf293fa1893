"""A way out and the same way back, made of a drive that only goes out.

The robot goes out on the even frames and comes back, in reverse, on the odd ones: no image is seen
twice, yet every place is, and the drive ends where it began. Odometry is the truth with errors
whose size is known.
"""

from dataclasses import dataclass, replace

import numpy as np

from saccade.errors import DriveError, require
from saccade.frames import Drive, Frame, steps_between
from saccade.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class OutAndBackConfig:
    """How many frames, and what the odometry gets wrong."""

    frames: int = 160
    """Of the drive, from the first on; fewer where it has fewer."""
    scale_percent: float = 3.0
    """By which every distance is too long."""
    white_percent: float = 5.0
    """Standard deviation of a distance, in per cent of it, new with every step."""
    gyro_bias: float = 0.5
    """Degrees per second by which every turn is too far to the left."""
    gyro_walk: float = 1.0
    """Standard deviation of the heading after a second, in degrees; it grows with the root."""

    def __post_init__(self) -> None:
        require(4 <= self.frames <= 10**6, "frames", "4 to 1e6", self.frames)
        for name in ("scale_percent", "white_percent", "gyro_bias", "gyro_walk"):
            require(0 <= getattr(self, name) < 100, name, "0 to under 100", getattr(self, name))


def out_and_back(
    drive: Drive, config: OutAndBackConfig = OutAndBackConfig(), seed: int = 0
) -> Drive:
    """Out on the even frames of a drive, back on the odd ones.

    Args:
        drive: with its truth.
        config: the number of frames and the errors of odometry.
        seed: of the white part of the errors.

    Returns:
        As many frames, with the truth at each of them. `control_covariance` and `odometry_bias`
        hold what the errors are drawn from; a bias of the gyroscope has no place among the
        latter, and is covered by as much random walk as reaches it at the end of the drive.

    Raises:
        DriveError: the drive has no truth, or fewer than four frames.
    """
    if drive.truth is None:
        raise DriveError(f"{drive.name}: palindrome: expected a drive with truth, found none")
    n = min(config.frames, len(drive))
    if n < 4:
        raise DriveError(f"{drive.name}: palindrome: expected at least 4 frames, found {n}")
    order = out_and_back_order(n)
    duration = np.abs(np.diff(drive.time[order]))  # (n - 1,)
    time = drive.time[0] + np.concatenate([[0.0], np.cumsum(duration)])
    pose = drive.truth.at(drive.time[order])
    control, covariance = _odometry(steps_between(pose), duration, config, seed)

    def load(i: int) -> Frame:
        return replace(drive.load(int(order[i])), time=float(time[i]))

    return Drive(
        name=f"{drive.name}, there and back, seed {seed}",
        camera=drive.camera,
        time=time,
        control=control,
        control_covariance=covariance,
        load=load,
        start=pose[0],
        odometry_bias=(config.scale_percent / 100, 0.0, 0.0),
        truth=Trajectory(time, pose),
    )


def out_and_back_order(n: int) -> IntArray:
    """Numbers of the even ones of n frames, then of the odd ones from the last on."""
    return np.concatenate([np.arange(0, n, 2), np.arange(1, n, 2)[::-1]])


def _odometry(
    true: FloatArray, duration: FloatArray, config: OutAndBackConfig, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Steps (m, 3) as odometry has them, and their covariance (m, 3, 3)."""
    white = np.random.default_rng(seed).standard_normal((len(true), 2))
    bias, walk = np.deg2rad([config.gyro_bias, config.gyro_walk])
    fraction = config.white_percent / 100
    measured = true.copy()
    measured[:, :2] *= 1 + config.scale_percent / 100 + fraction * white[:, :1]
    measured[:, 2] += bias * duration + walk * np.sqrt(duration) * white[:, 1]

    way = measured[:, :2]
    covariance = np.zeros((len(true), 3, 3))
    covariance[:, :2, :2] = fraction**2 * way[:, :, None] * way[:, None, :]
    covariance[:, 2, 2] = (walk**2 + bias**2 * duration.sum()) * duration
    return measured, covariance
