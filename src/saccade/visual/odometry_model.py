"""Systematic errors of odometry, estimated during the drive."""

import numpy as np

from saccade.types import FloatArray
from saccade.visual.ground_scale import DISTANCE_NOISE
from saccade.visual.motion_errors import CONSTANT_DISTANCE

ODOMETRY_ERRORS = 3
"""Number of errors: scale of odometry, scale of the camera, turn rate."""
MAX_OUTAGE = 5.0
"""Duration without camera that the covariance of the turn rate covers, in seconds."""
MAX_DISTANCE_NIS = 9.0
"""Maximum normalized innovation squared of a measured distance (3 sigma)."""


class OdometryErrors:
    """Systematic errors of odometry (information filter).

    The errors of scale and turn rate are constant. The scale error of the camera is estimated
    together with the scale error of odometry, as only their sum is observed.

    Args:
        scale_sigma: relative standard deviation of the distances by odometry.
        camera_sigma: relative standard deviation of the distances by the camera.
        turn_sigma: standard deviation of the turn rate, in rad/s.
    """

    def __init__(self, scale_sigma: float, camera_sigma: float, turn_sigma: float) -> None:
        self.error = np.zeros(ODOMETRY_ERRORS)
        self.covariance = np.diag(np.square([scale_sigma, camera_sigma, turn_sigma]))

    @property
    def factor(self) -> float:
        """Ratio of the true distance and the distance by odometry."""
        return 1.0 + float(self.error[0])

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of `factor`."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def camera_factor(self) -> float:
        """Ratio of the distance by the camera and the true distance."""
        return 1.0 + float(self.error[1])

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """Corrects a control (3,) of odometry; half of the turn rotates the translation."""
        turn = -float(self.error[2]) * seconds
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        x, y = self.factor * control[:2]
        return np.array([c * x - s * y, s * x + c * y, control[2] + turn])

    def jacobian(self, control: FloatArray, seconds: float) -> FloatArray:
        """Derivatives (3, 3) by the errors of a corrected control (3,), as a camera measures."""
        x, y, _ = control
        J = np.zeros((3, ODOMETRY_ERRORS))
        J[:2, :2] = np.array([[x], [y]])
        J[:, 2] = seconds * np.array([y / 2, -x / 2, -1.0])
        return J

    def step_covariance(
        self, control: FloatArray, seconds: float, has_scale: bool = True
    ) -> FloatArray:
        """Covariance (3, 3) of a corrected control (3,) by the remaining errors.

        The errors of successive steps count as independent. They are enlarged so that they
        accumulate to constant errors over `CONSTANT_DISTANCE` and `MAX_OUTAGE`.
        """
        J, sigma = self.jacobian(control, seconds), np.sqrt(self.covariance.diagonal())
        length = max(float(np.hypot(*control[:2])), 1e-9)
        by_scale, by_turn = J[:, 0] * sigma[0], J[:, 2] * sigma[2]
        steps = max(CONSTANT_DISTANCE / length, 1.0) if has_scale else 0.0
        total = steps * np.outer(by_scale, by_scale)
        total += max(MAX_OUTAGE / max(seconds, 1e-3), 1.0) * np.outer(by_turn, by_turn)
        return np.asarray(total)

    def update_scale(self, ratio: float) -> None:
        """Updates the errors by the ratio of the distances by camera and by corrected odometry.

        An outlier is ignored.
        """
        J, innovation = np.array([1.0, 1.0, 0.0]), ratio - 1.0 - float(self.error[1])
        variance = DISTANCE_NOISE**2
        if innovation**2 < MAX_DISTANCE_NIS * (J @ self.covariance @ J + variance):
            self.update(np.outer(J, J) / variance, J * innovation / variance)

    def update(self, information: FloatArray, gradient: FloatArray) -> FloatArray:
        """Adds normal equations (3, 3), (3,) about the estimate; returns its change (3,)."""
        P = self.covariance
        self.covariance = np.linalg.solve(np.eye(ODOMETRY_ERRORS) + P @ information, P)
        self.covariance = (self.covariance + self.covariance.T) / 2
        change = self.covariance @ gradient
        self.error = self.error + change
        return change
