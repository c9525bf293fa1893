"""Systematic errors of odometry, estimated during the drive."""

import numpy as np

from saccade.slam.consistency import normalized_squared
from saccade.types import FloatArray
from saccade.visual.ground_scale import DISTANCE_NOISE
from saccade.visual.motion_errors import CONSTANT_DISTANCE

ODOMETRY_ERRORS = 5
"""Number of errors: scale of odometry, scale of the camera, turn rate, two of side-slip."""
SLIP_ANGLE = 0.01
"""Prior standard deviation of the side-slip angle on a straight road, in radians. The true poses of
KITTI 00 to 09 have .003 to .015."""
SLIP_PER_ACCELERATION = 0.006
"""Prior standard deviation of the side-slip angle per lateral acceleration, in radians per m/s^2.
The same drives have .003 to .008."""
MAX_OUTAGE = 5.0
"""Duration without camera that the covariance of the turn rate covers, in seconds."""
SLIP_SECONDS = 1.0
"""Constancy of the remaining side-slip, in seconds."""
MAX_NIS = 9.0
"""Maximum normalized innovation squared per dimension of a measurement (3 sigma)."""


class OdometryErrors:
    """Systematic errors of odometry (information filter).

    The errors of scale and turn rate are constant. The side-slip angle, which odometry does not
    measure, is a constant plus a part proportional to the lateral acceleration. The scale error of
    the camera is estimated together with the scale error of odometry, as only their sum is
    observed.

    Args:
        scale_sigma: relative standard deviation of the distances by odometry.
        camera_sigma: relative standard deviation of the distances by the camera.
        turn_sigma: standard deviation of the turn rate, in rad/s.
    """

    def __init__(self, scale_sigma: float, camera_sigma: float, turn_sigma: float) -> None:
        sigma = (scale_sigma, camera_sigma, turn_sigma, SLIP_ANGLE, SLIP_PER_ACCELERATION)
        self.error = np.zeros(ODOMETRY_ERRORS)
        self.covariance = np.diag(np.square(sigma))

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
        moved = np.array([c * x - s * y, s * x + c * y, control[2] + turn])
        moved[1] += slip_lever(moved, seconds) @ self.error[3:]
        return moved

    def jacobian(self, control: FloatArray, seconds: float) -> FloatArray:
        """Derivatives (3, 5) by the errors of a corrected control (3,), as a camera measures."""
        x, y, _ = control
        J = np.zeros((3, ODOMETRY_ERRORS))
        J[:2, :2] = np.array([[x], [y]])
        J[:, 2] = seconds * np.array([y / 2, -x / 2, -1.0])
        J[1, 3:] = slip_lever(control, seconds)
        return J

    def step_covariance(
        self, control: FloatArray, seconds: float, has_scale: bool = True
    ) -> FloatArray:
        """Covariance (3, 3) of a corrected control (3,) by the remaining errors.

        The errors of successive steps count as independent. They are enlarged so that they
        accumulate to constant errors over `CONSTANT_DISTANCE`, `MAX_OUTAGE` and `SLIP_SECONDS`.
        """
        J, P = self.jacobian(control, seconds), self.covariance
        length = max(float(np.hypot(*control[:2])), 1e-9)
        seconds = max(seconds, 1e-3)
        steps = has_scale * CONSTANT_DISTANCE / length, MAX_OUTAGE / seconds, SLIP_SECONDS / seconds
        total = np.zeros((3, 3))
        for n, i in zip(steps, (slice(0, 1), slice(2, 3), slice(3, 5)), strict=True):
            total += max(n, float(n > 0)) * J[:, i] @ P[i, i] @ J[:, i].T
        return total

    def update_by(self, J: FloatArray, innovation: FloatArray, R: FloatArray) -> None:
        """Updates the errors by k measurements; outliers are ignored.

        J (k, 5) is the Jacobian, `innovation` (k,) the innovations, R (k, k) their covariance.
        """
        S = R + J @ self.covariance @ J.T
        if normalized_squared(innovation, S) < MAX_NIS * len(innovation):
            weighted = np.linalg.solve(R, J).T
            self.update(weighted @ J, weighted @ innovation)

    def update_scale(self, ratio: float) -> None:
        """Updates the errors by the ratio of the distances by camera and by corrected odometry."""
        J = np.array([[1.0, 1.0, 0.0, 0.0, 0.0]])
        innovation = np.array([ratio - 1.0 - self.error[1]])
        self.update_by(J, innovation, np.array([[DISTANCE_NOISE**2]]))

    def update(self, information: FloatArray, gradient: FloatArray) -> FloatArray:
        """Adds normal equations (5, 5), (5,) about the estimate; returns its change (5,)."""
        P = self.covariance
        self.covariance = np.linalg.solve(np.eye(ODOMETRY_ERRORS) + P @ information, P)
        self.covariance = (self.covariance + self.covariance.T) / 2
        change = self.covariance @ gradient
        self.error = self.error + change
        return change


def slip_lever(control: FloatArray, seconds: float) -> FloatArray:
    """Derivative (2,) of the lateral motion of a control (3,) by the two side-slip errors."""
    length = float(np.hypot(*control[:2]))
    acceleration = length * float(control[2]) / max(seconds, 1e-3) ** 2
    return np.array([length, length * acceleration])
