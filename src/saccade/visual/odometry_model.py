"""Systematic errors of odometry, estimated on the drive."""

import numpy as np

from saccade.slam.consistency import normalized_squared
from saccade.types import FloatArray
from saccade.visual.ground_scale import DISTANCE_NOISE
from saccade.visual.motion_errors import CONSTANT_DISTANCE

ODOMETRY_ERRORS = 5
"""Scale of odometry, scale of the camera, turn rate, and two of side-slip."""
SLIP_ANGLE = 0.01
"""Standard deviation of the side-slip on a straight road before the first frame, in radians. By the
true poses of KITTI's drives 00 to 09 it is .003 to .015."""
SLIP_PER_ACCELERATION = 0.006
"""Standard deviation of the side-slip per m/s^2 of lateral acceleration before the first frame, in
radians; .003 to .008 in the same drives."""
MAX_OUTAGE = 5.0
"""Seconds without camera for which the covariance allows for errors of odometry's turn rate."""
SLIP_SECONDS = 1.0
"""Seconds over which what remains of the side-slip is constant."""
MAX_NIS = 9.0
"""Normalized innovation squared per dimension (3 sigma) beyond which a measurement is ignored."""


class OdometryErrors:
    """Systematic errors of odometry (information filter).

    Scale and turn rate are constant. Odometry knows of no side-slip: its angle is a constant plus
    one in proportion to the lateral acceleration. The scale error of the camera is estimated with
    that of odometry, since only their sum is observed.

    The standard deviations are of the fractions by which true distances exceed odometry's and those
    by the camera are too long, and of the turn rate in rad/s.
    """

    def __init__(self, scale_sigma: float, camera_sigma: float, turn_sigma: float) -> None:
        sigma = (scale_sigma, camera_sigma, turn_sigma, SLIP_ANGLE, SLIP_PER_ACCELERATION)
        self.error = np.zeros(ODOMETRY_ERRORS)
        self.covariance = np.diag(np.square(sigma))

    @property
    def factor(self) -> float:
        """True distance over that of odometry."""
        return 1.0 + float(self.error[0])

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the factor."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def camera_factor(self) -> float:
        """Distance by the camera over the true one."""
        return 1.0 + float(self.error[1])

    def corrected(self, control: FloatArray, seconds: float) -> FloatArray:
        """A control (3,) of odometry without its errors; half of a turn rotates the translation."""
        turn = -float(self.error[2]) * seconds
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        x, y = self.factor * control[:2]
        moved = np.array([c * x - s * y, s * x + c * y, control[2] + turn])
        moved[1] += slip_lever(moved, seconds) @ self.error[3:]
        return moved

    def jacobian(self, control: FloatArray, seconds: float) -> FloatArray:
        """(3, 5) derivatives by the errors of a corrected control (3,), as a camera measures it."""
        x, y, _ = control
        J = np.zeros((3, ODOMETRY_ERRORS))
        J[:2, :2] = np.array([[x], [y]])
        J[:, 2] = seconds * np.array([y / 2, -x / 2, -1.0])
        J[1, 3:] = slip_lever(control, seconds)
        return J

    def step_covariance(
        self, control: FloatArray, seconds: float, has_scale: bool = True
    ) -> FloatArray:
        """(3, 3) covariance of a corrected control (3,) by the errors that remain.

        Taken as independent from step to step, they accumulate to those of constant errors over
        `CONSTANT_DISTANCE`, `MAX_OUTAGE` and `SLIP_SECONDS`.
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
        """Update by k measurements: their Jacobian (k, 5), innovations (k,), covariance (k, k).

        Outliers are ignored: the robot may have been lifted, or its wheels may slip.
        """
        S = R + J @ self.covariance @ J.T
        if normalized_squared(innovation, S) < MAX_NIS * len(innovation):
            weighted = np.linalg.solve(R, J).T
            self.update(weighted @ J, weighted @ innovation)

    def update_scale(self, ratio: float) -> None:
        """Update by the ratio of the camera's distance to that of odometry times `factor`."""
        J = np.array([[1.0, 1.0, 0.0, 0.0, 0.0]])
        innovation = np.array([ratio - 1.0 - self.error[1]])
        self.update_by(J, innovation, np.array([[DISTANCE_NOISE**2]]))

    def update(self, information: FloatArray, gradient: FloatArray) -> FloatArray:
        """Add normal equations (5, 5), (5,) about the present estimate; returns its change (5,)."""
        P = self.covariance
        self.covariance = np.linalg.solve(np.eye(ODOMETRY_ERRORS) + P @ information, P)
        self.covariance = (self.covariance + self.covariance.T) / 2
        change = self.covariance @ gradient
        self.error = self.error + change
        return change


def slip_lever(control: FloatArray, seconds: float) -> FloatArray:
    """(2,) derivative of the side-slip of a control in meters by its two errors."""
    length = float(np.hypot(*control[:2]))
    acceleration = length * float(control[2]) / max(seconds, 1e-3) ** 2
    return np.array([length, length * acceleration])
