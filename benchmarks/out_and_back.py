"""Loop closure on a drive without loops: out on its even frames, back on the odd ones.

No image occurs twice, yet every place is revisited, and the drive ends where it began. Odometry is
the truth with errors of known size. Used by benchmarks/drive.py, selection.py and lost_drives.py.
"""

from dataclasses import dataclass, replace

import numpy as np

from saccade.frames import Drive, Frame
from saccade.plane import steps_between
from saccade.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class OutAndBackConfig:
    """Number of frames, and errors of the odometry."""

    frames: int = 160
    """Number of frames, from the first on; fewer where the drive has fewer."""
    scale_percent: float = 3.0
    """Scale error of the distances, in per cent: they are too long."""
    white_percent: float = 5.0
    """Standard deviation of the white noise of a distance, in per cent of it."""
    gyro_bias: float = 0.5
    """Bias of the turn rate to the left, in degrees per second."""
    gyro_walk: float = 1.0
    """Random walk of the heading, in degrees per root second."""


def out_and_back(
    drive: Drive, config: OutAndBackConfig = OutAndBackConfig(), seed: int = 0
) -> Drive:
    """A drive out on the even frames of another, and back on its odd ones.

    Args:
        drive: a drive with truth.
        config: number of frames and errors of the odometry.
        seed: seed of the noise.

    Returns:
        The drive with truth. `control_covariance` and `odometry_bias` are those of the errors;
        the gyroscope's bias, which is no part of the latter, is covered by a random walk that
        reaches it at the end of the drive.
    """
    n = min(config.frames, len(drive))
    order = out_and_back_order(n)
    duration = np.abs(np.diff(drive.time[order]))  # (n - 1,)
    time = drive.time[0] + np.concatenate([[0.0], np.cumsum(duration)])
    pose = drive.truth.at(drive.time[order])
    control, covariance = _odometry(steps_between(pose), duration, config, seed)

    def load(i: int) -> Frame:
        return replace(drive.load(int(order[i])), time=float(time[i]))

    return Drive(
        name=f"{drive.name}, out and back, seed {seed}",
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
    """The even numbers below n, then the odd ones in descending order."""
    return np.concatenate([np.arange(0, n, 2), np.arange(1, n, 2)[::-1]])


def _odometry(
    true: FloatArray, duration: FloatArray, config: OutAndBackConfig, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Odometry steps (m, 3) with errors, and their covariance (m, 3, 3)."""
    white = np.random.default_rng(seed).standard_normal((len(true), 2))
    bias, walk = np.deg2rad([config.gyro_bias, config.gyro_walk])
    fraction = config.white_percent / 100
    measured = true.copy()
    measured[:, :2] *= 1 + config.scale_percent / 100 + fraction * white[:, :1]
    measured[:, 2] += bias * duration + walk * np.sqrt(duration) * white[:, 1]

    step = measured[:, :2]
    covariance = np.zeros((len(true), 3, 3))
    covariance[:, :2, :2] = fraction**2 * step[:, :, None] * step[:, None, :]
    covariance[:, 2, 2] = (walk**2 + bias**2 * duration.sum()) * duration
    return measured, covariance
