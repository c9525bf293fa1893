"""Estimation of the sensor's pose on the robot from pairs of observations of a landmark.

With u the origin of the sensor in its own frame, a its yaw, q its observations as points, R the
rotation and m the translation of the robot between the two observations, error-free data satisfy

    q_b - R q_a + (I - R) u - rot(-a) m = 0.

The left side is the residual of a weighted least-squares fit with Cauchy weights. Odometry may have
scale errors of distances and turns, turns proportional to the distance and distances proportional
to the turn. These errors have priors and are estimated with the mounting, so that they are not
mistaken for it.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from saccade.diagnostics.observation_pairs import Readings, gains, residuals
from saccade.plane import path_of, rotated, rotations, to_points, to_robot_frame
from saccade.types import FloatArray, IntArray

REWEIGHTINGS = 10
"""Iterations of the reweighted least squares."""
CAUCHY = 2.5
"""Scale of the Cauchy weights, in standard deviations."""
BIAS_SIGMA = 0.05
"""Prior standard deviation of undeclared odometry errors: scale factor, radians per meter and
meters per radian."""
MOUNTING_SIGMA = (100.0, 100.0, 10.0)
"""Prior standard deviations of the mounting in meters and radians: a log without turns leaves it
undetermined."""
TURN_SIGMA = 0.1
"""Prior standard deviation of the scale of turns."""
MIN_SIGMAS = 5.0
"""Minimum ratio of a reported offset to its standard deviation."""
MIN_OFFSET = 0.22
"""Minimum reported distance of the sensor from the robot's origin, in meters; odometry errors
resemble smaller distances."""
MIN_YAW = np.deg2rad(2.5)
"""Minimum reported yaw, in radians."""
MAX_YAW = np.deg2rad(60)
"""Maximum yaw to which the fit converges from zero, in radians."""


@dataclass(frozen=True, eq=False)
class Mounting:
    """Estimated pose of the sensor, relative to its pose in the log."""

    pose: tuple[float, float, float]
    """Meters ahead and to the left, radians."""
    sigma: FloatArray
    """(3,) standard deviations."""

    @classmethod
    def fit(cls, log: Readings, a: IntArray, b: IntArray, bias: tuple[float, float, float]) -> Self:
        """Fits the mounting to pairs of observations.

        Args:
            log: numbers of the log.
            a: (m,) earlier observations.
            b: (m,) later observations.
            bias: see `LandmarkLog.odometry_bias`.
        """
        turn, moved, arm, driven, turned = _motions(log, a, b)
        xy = to_points(log.observation)
        change = xy[b] - rotated(xy[a], turn)  # (m, 2)
        levers = np.eye(2) - rotations(turn)  # (m, 2, 2)
        _, sensor, odometry = residuals(log, a, b)
        _, (factor, of_odometry) = gains(log, a, b)
        W = np.linalg.inv(np.linalg.cholesky(factor**2 * sensor + of_odometry**2 * odometry))
        sigma = np.array([*np.maximum(bias, BIAS_SIGMA), TURN_SIGMA])
        prior = np.diag([*np.power(MOUNTING_SIGMA, -2.0), *sigma**-2.0])
        x = np.zeros(7)  # u, yaw, distance scale, turn per distance, distance per turn, turn scale
        for _ in range(REWEIGHTINGS):
            ahead = rotated(moved, np.full(len(a), -x[2]))
            J = np.empty((len(a), 2, 7))
            J[:, :, :2] = levers
            J[:, :, 2] = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
            J[:, :, 3] = -ahead
            J[:, :, 4] = driven[:, None] * arm
            J[:, :, 5] = turned[:, None] * ahead / (np.hypot(*ahead.T)[:, None] + 1e-12)
            J[:, :, 6] = -turn[:, None] * arm
            known = np.array([*x[:2], 0, *x[3:]])  # J is linear except in the yaw
            error = (W @ (change - ahead + J @ known)[:, :, None])[:, :, 0]
            weight = 1 / (1 + np.square(error).sum(1) / CAUCHY**2)
            A = W @ J
            weighted = (weight[:, None, None] * A).transpose(0, 2, 1)
            information = (weighted @ A).sum(0) + prior
            gradient = (weighted @ error[:, :, None]).sum(0)[:, 0] + prior @ known
            x -= np.linalg.solve(information, gradient)
            x[2] = np.clip(x[2], -MAX_YAW, MAX_YAW)
        variance = max(1.0, float((weight * np.square(error).sum(1)).sum() / (2 * weight.sum())))
        sigma = np.sqrt(variance * np.linalg.inv(information).diagonal()[:3])
        (left,) = rotated(x[None, :2], x[2:3])
        return cls((float(left[0]), float(left[1]), float(x[2])), sigma)

    @property
    def is_significant(self) -> bool:
        """Whether the sensor's offset or yaw is significant."""
        size = np.abs(self.pose)
        sure = size > MIN_SIGMAS * self.sigma
        away = sure[:2].any() and np.hypot(*size[:2]) > MIN_OFFSET
        return bool((away or (sure[2] and size[2] > MIN_YAW)) and size[2] < MAX_YAW)

    def apply(self, log: Readings) -> Readings:
        """The numbers of a log, with observations from a sensor of this mounting."""
        z, R = to_robot_frame(log.observation, log.observation_covariance, self.pose)
        return replace(log, observation=z, observation_covariance=R)

    def after(self, sensor: tuple[float, float, float]) -> tuple[float, float, float]:
        """Corrected pose in the robot frame of a sensor that the log placed at `sensor`."""
        ahead, left = rotated(np.array([sensor[:2]]), np.array(self.pose[2:]))[0].tolist()
        return self.pose[0] + ahead, self.pose[1] + left, self.pose[2] + sensor[2]


def _motions(log: Readings, a: IntArray, b: IntArray) -> tuple[FloatArray, ...]:
    """Odometry motion between pairs of observations.

    Returns:
        Turn (m,) and translation (m, 2) that map points from the earlier to the later frame;
        derivative (m, 2) of a point with respect to a turn; distance (m,) and total turn (m,).
    """
    forward = np.where(log.control[:, 0] < 0, -1.0, 1.0)
    travel = np.hypot(*log.control[:, :2].T), np.abs(log.control[:, 2])
    sums = [np.append(0.0, np.cumsum(forward * each)) for each in travel]
    knots = [*path_of(log.control).T, *sums]
    state = np.stack([np.interp(log.observed, log.time, column) for column in knots], 1)
    x, y, xy = state[a], state[b], to_points(log.observation)
    turn = x[:, 2] - y[:, 2]
    middle = (rotated(xy[a], turn) + xy[b]) / 2
    arm = np.stack([-middle[:, 1], middle[:, 0]], 1)
    moved = rotated(x[:, :2] - y[:, :2], -y[:, 2])
    return turn, moved, arm, *(y - x)[:, 3:].T
