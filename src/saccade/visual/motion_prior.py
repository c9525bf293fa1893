"""How the robot will move next: odometry joined with what came before."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.consistency import chi_square_gate
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Motion

CORNER = np.pi / 2
"""Radians through which an error of the turn stays the same."""
STRETCH = 10.0
"""Metres along which an error of the way does."""
MAX_WAIT = 5.0
"""Seconds for which what odometry gets wrong all the time may have to do without the camera."""


def fuse(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Two independent estimates (3,) with covariances (3, 3) as one.

    Where they contradict each other the first counts alone.
    """
    apart, total = first[0] - second[0], first[1] + second[1]
    weighed = np.linalg.solve(total, apart)
    if apart @ weighed > chi_square_gate(3, 0.9999):
        return first
    spread = second[1]
    return second[0] + spread @ weighed, spread - spread @ np.linalg.solve(total, spread)


@dataclass
class MotionPrior:
    """The next motion, from odometry and from how the robot moved before."""

    acceleration: FloatArray
    """(3,) standard deviations of the change of speed ahead, to the left (m/s) and of the turn
    rate (rad/s) in a second."""
    _speed: FloatArray | None = field(default=None, init=False)
    _spread: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)

    def predict(
        self, control: FloatArray, covariance: FloatArray, seconds: float
    ) -> tuple[FloatArray, FloatArray]:
        """Odometry joined with what the last motion lets expect.

        Args:
            control: (3,) by odometry.
            covariance: (3, 3).
            seconds: since the last frame.

        Returns:
            (3,) and its covariance (3, 3). Where the two contradict each other odometry counts
            alone: the robot may have been stopped, lifted, or turned round.
        """
        if self._speed is None or seconds <= 0:
            return control, covariance
        expected = self._speed * seconds
        spread = self._spread * seconds**2 + np.diag(np.square(self.acceleration * seconds**2))
        return fuse((control, covariance), (expected, spread))

    def update(self, control: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Hear how the robot did move, (3,), and how sure that is (3, 3)."""
        if seconds > 0:
            self._speed, self._spread = control / seconds, covariance / seconds**2


def correlated_covariance(
    motion: Motion, seconds: float, config: VisualConfig, tilt: float
) -> FloatArray:
    """(3, 3) of a motion, as if its errors were new with every frame.

    They are not: the same points are looked at in successive frames. Errors that are forgotten
    at a rate 1 / T, seen every dt, add up as independent ones do whose variance is
    (1 + r) / (1 - r) times as large, r = exp(-dt / T). What a calibration gets wrong stays the
    same throughout a corner or a stretch of the way: steps that add up to it have together a
    variance of its share squared. So does a robot that leans by `tilt` radians: on the ground
    its way and its turns are shorter by 1 - cos(tilt).
    """
    forgotten = np.exp(-seconds / config.persistence)
    factor = np.sqrt((1 + forgotten) / (1 - min(forgotten, 1 - 1e-6)))
    wide = np.diag([1.0, 1.0, factor]) if motion.with_prior else factor * np.eye(3)
    way, turn = config.relative_motion_sigma
    way, turn = np.hypot((0.0 if motion.with_prior else way, turn), 1 - np.cos(tilt))
    ahead = motion.control[:2]
    found = wide @ motion.covariance @ wide
    length = max(float(np.hypot(*ahead)), 1e-9)
    found[:2, :2] += way**2 * STRETCH / length * np.outer(ahead, ahead)
    found[2, 2] += turn**2 * CORNER * abs(motion.control[2])
    return found


def systematic_covariance(
    control: FloatArray, seconds: float, share: float, drift: "TurnRateBias"
) -> FloatArray:
    """(3, 3) of what odometry gets wrong all the time, as far as the camera has not told yet.

    Args:
        control: (3,) by odometry.
        seconds: that it took.
        share: standard deviation of the share of the way.
        drift: of the turn.

    Returns:
        Of a step by itself, as if it were new with each; over `STRETCH` and `MAX_WAIT` the steps
        have together what they have wrong in truth.
    """
    ahead = control[:2]
    length = max(float(np.hypot(*ahead)), 1e-9)
    along, aside = np.append(ahead, 0.0), np.array([-ahead[1] / 2, ahead[0] / 2, 1.0])
    return np.asarray(
        share**2 * max(STRETCH / length, 1.0) * np.outer(along, along)
        + drift.variance * seconds * max(MAX_WAIT, seconds) * np.outer(aside, aside)
    )


@dataclass
class TurnRateBias:
    """By how much odometry turns too far to the left in each second, by what the camera sees."""

    rate: float = 0.0
    """Radians per second."""
    variance: float = 0.02**2
    """Of the rate."""

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """A control (3,) by odometry without it; half of a turn happens before half of the way."""
        turn = self.rate * seconds
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        ahead, left, turned = control
        return np.array([c * ahead + s * left, c * left - s * ahead, turned - turn])

    def update(self, turned: float, seconds: float, variance: float) -> None:
        """Take in radians by which odometry has turned further than the camera, and their variance.

        What cannot be drift is left out: the robot may have been lifted, or its wheels slip.
        """
        total = variance + self.variance * seconds**2
        missed = turned - self.rate * seconds
        if 0 < missed**2 < 9 * total:
            gain = self.variance * seconds / total
            self.rate += gain * missed
            self.variance -= gain * seconds * self.variance
