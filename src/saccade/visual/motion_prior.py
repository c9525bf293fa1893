"""Motion prior: the robot's next motion from odometry and its last motion."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.consistency import chi_square_gate
from saccade.types import FloatArray
from saccade.visual.egomotion import Prior

CONTRADICTION = 0.9999
"""Probability inside which two estimates of a control may differ."""


def fuse(first: Prior, second: Prior) -> Prior:
    """Two independent estimates (3,) with covariances (3, 3), fused by their information.

    Where they contradict each other, the first alone.
    """
    difference, total = first[0] - second[0], first[1] + second[1]
    weighted = np.linalg.solve(total, difference)
    if difference @ weighted > chi_square_gate(3, CONTRADICTION):
        return first
    covariance = second[1]
    return (
        second[0] + covariance @ weighted,
        covariance - covariance @ np.linalg.solve(total, covariance),
    )


@dataclass
class MotionPrior:
    """Constant-velocity prediction, fused with odometry."""

    acceleration_sigma: FloatArray
    """(3,) standard deviations of the change of speed ahead, to the left (m/s) and of the turn
    rate (rad/s) in a second."""
    _velocity: FloatArray | None = field(default=None, init=False)
    _covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), init=False)

    def predict(self, control: FloatArray, covariance: FloatArray, seconds: float) -> Prior:
        """Odometry (3,) with its covariance (3, 3), fused with the last motion.

        Where they contradict each other, odometry alone: the robot may have stopped, or been
        lifted or turned.
        """
        if self._velocity is None or seconds <= 0:
            return control, covariance
        expected = self._velocity * seconds
        noise = np.diag(np.square(self.acceleration_sigma * seconds**2))
        return fuse((control, covariance), (expected, self._covariance * seconds**2 + noise))

    def update(self, control: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Record the last motion (3,), its covariance (3, 3) and duration."""
        if seconds > 0:
            self._velocity, self._covariance = control / seconds, covariance / seconds**2
