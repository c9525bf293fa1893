"""What odometry says of each step, and its systematic errors, estimated on the drive."""

import numpy as np

from saccade.frames import Drive
from saccade.types import FloatArray
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.ground_scale import DISTANCE_NOISE
from saccade.visual.motion_prior import CONSTANT_DISTANCE, MotionPrior

ODOMETRY_ERRORS = 5
"""Scale of odometry, scale of the camera, turn rate, and two of side-slip."""
SLIP_ANGLE, SLIP_PER_ACCELERATION = 0.01, 0.006
"""Standard deviations of the side-slip before the first frame, in radians, on a straight road and
per m/s^2 of lateral acceleration. By the true poses of KITTI's drives 00 to 09 angles are .003 to
.015, and .003 to .008 per m/s^2."""
MIN_SCALE_SIGMA = 0.02
"""Least standard deviation of odometry's scale where the camera measures distances."""
MIN_TURN_BIAS_SIGMA = 0.02
"""Least standard deviation of odometry's turn rate bias at the start, in rad/s."""
MAX_OUTAGE, SLIP_SECONDS = 5.0, 1.0
"""Seconds without camera for which the covariance of odometry allows for errors of the turn rate;
and over which what remains of the side-slip is constant."""


MAX_NIS = 9.0
"""Normalized innovation squared per dimension (3 sigma) beyond which a measurement is ignored."""


class OdometryErrors:
    """Systematic errors of odometry (information filter).

    Scale and turn rate are constant. Odometry knows of no side-slip: its angle is a constant plus
    one in proportion to the lateral acceleration. The scale error of the camera is estimated with
    that of odometry, since only their sum is observed.

    Args:
        scale_sigma: standard deviation of the fraction by which true distances exceed odometry's.
        camera_sigma: of the fraction by which distances by the camera are too long.
        turn_sigma: of the turn rate, in rad/s.
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
        steps = CONSTANT_DISTANCE / length, MAX_OUTAGE / seconds, SLIP_SECONDS / seconds
        parts = slice(0, 1), slice(2, 3), slice(3, 5)
        total = np.zeros((3, 3))
        for n, i in list(zip(steps, parts, strict=True))[0 if has_scale else 1 :]:
            total += max(n, 1.0) * J[:, i] @ P[i, i] @ J[:, i].T
        return total

    def update_by(self, J: FloatArray, innovation: FloatArray, R: FloatArray) -> None:
        """Update by k measurements: their Jacobian (k, 5), innovations (k,), covariance (k, k).

        Outliers are ignored: the robot may have been lifted, or its wheels may slip.
        """
        S = R + J @ self.covariance @ J.T
        if innovation @ np.linalg.solve(S, innovation) < MAX_NIS * len(innovation):
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
    """(2,) derivative of the side-slip of a control in metres by its two errors."""
    length = float(np.hypot(*control[:2]))
    acceleration = length * float(control[2]) / max(seconds, 1e-3) ** 2
    return np.array([length, length * acceleration])


class OdometryModel:
    """The steps of a drive by odometry, without the errors that were learnt of it.

    Args:
        drive: its odometry, with standard deviations of the errors.
        has_depth: whether the frames measure depth.
        camera_sigma: standard deviation of the fraction by which distances by the camera are wrong.
        acceleration_sigma: standard deviations of the change of speed (m/s) and turn rate (rad/s)
            in a second.
    """

    def __init__(
        self,
        drive: Drive,
        has_depth: bool,
        camera_sigma: float,
        acceleration_sigma: tuple[float, float],
    ) -> None:
        self._drive, self._has_depth = drive, has_depth
        scale_sigma, turn_per_metre, _ = drive.odometry_bias
        if has_depth:
            scale_sigma = float(np.hypot(scale_sigma, MIN_SCALE_SIGMA))
        seconds = float(drive.time[-1] - drive.time[0])
        distance = float(np.hypot(*drive.control[:, :2].T).sum())
        mean_speed = distance / seconds if seconds > 0 else 0.0
        turn_sigma = float(np.hypot(MIN_TURN_BIAS_SIGMA, turn_per_metre * mean_speed))
        self.errors = OdometryErrors(scale_sigma, camera_sigma, turn_sigma)
        speed_sigma, turn_rate_sigma = acceleration_sigma
        self.motion_prior = MotionPrior(np.array([speed_sigma, speed_sigma / 4, turn_rate_sigma]))
        self.turn_sigma = 0.0
        """Standard deviation of the measured turn of the camera on the robot, in radians."""
        self._step: MotionEstimate = np.zeros(3), np.zeros((3, 3))
        self._step_seconds = 0.0

    def predict(self, number: int) -> MotionEstimate:
        """The control expected to lead to a frame after the first.

        It gives the steps of a single camera their length, so there the last steps are not fused
        in: their errors would accumulate, and an accelerating robot would be lagged behind.
        """
        seconds = self._seconds(number)
        control = self.errors.corrected(self._drive.control[number - 1], seconds)
        self._step_seconds = seconds
        covariance = self._drive.control_covariance[number - 1]
        if self.turn_sigma:  # of both frames: the camera's turn is compared with odometry's
            covariance = covariance + np.diag([0.0, 0.0, 2 * self.turn_sigma**2])
        self._step = control, covariance
        return self.motion_prior.predict(*self._step, seconds) if self._has_depth else self._step

    @property
    def declared(self) -> MotionEstimate:
        """The last step by odometry without its errors, and its declared covariance."""
        return self._step

    @property
    def last(self) -> MotionEstimate:
        """The last step by odometry; its covariance includes the systematic errors that remain."""
        return self.with_systematic_errors(self._step)

    def with_systematic_errors(self, step: MotionEstimate) -> MotionEstimate:
        """The last step, estimated by odometry, with the covariance of its systematic errors."""
        errors = self.errors.step_covariance(step[0], self._step_seconds, self._has_depth)
        return step[0], step[1] + errors

    def learn(self, measured: MotionEstimate) -> None:
        """Update the errors by a motion that does not include the last step of odometry.

        The motion of a single camera includes the length of odometry: its turn alone is used.
        """
        control, covariance = self._step
        rows = slice(None) if self._has_depth else slice(2, 3)
        J = self.errors.jacobian(control, self._step_seconds)[rows]
        innovation, R = (measured[0] - control)[rows], (measured[1] + covariance)[rows, rows]
        self.errors.update_by(J, innovation, R)

    def update_motion_prior(self, number: int, step: FloatArray, observations: int) -> None:
        """Update the motion prior by the step (3,) to a frame, after all updates."""
        if number == 0 or not self._has_depth:
            return
        covariance = self._drive.control_covariance[number - 1] / (1 + observations) ** 2
        self.motion_prior.update(step, covariance, self._seconds(number))

    def _seconds(self, number: int) -> float:
        return float(self._drive.time[number] - self._drive.time[number - 1])
