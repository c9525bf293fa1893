"""Normal equations of the sliding window.

The columns are calibration errors, rotation vector and translation of each pose, and odometry
errors, in this order.
"""

from dataclasses import dataclass

import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray, IntArray, Table, column
from saccade.visual.odometry_model import ODOMETRY_ERRORS
from saccade.visual.robot_motion import CameraPose, cross_matrix
from saccade.visual.self_calibration import CALIBRATION_SIGMA, calibration_jacobian

MIN_DEPTH_RATIO = 0.05
"""Minimum ratio of the depths in a frame and in the reference frame; nearer observations are
ignored."""
DAMPING = 1.0
"""Levenberg damping of every coordinate of a point. It is far smaller than the information of an
observation, and holds points without parallax or depth."""
POINT_KERNEL_WIDTH = 2.0
"""Width of the robust kernel of an observation, in standard deviations."""
FACTOR_KERNEL_WIDTH = 3.0
"""Width of the robust kernel of odometry and motion changes, in standard deviations."""


@dataclass
class NormalEquations:
    """Normal equations of `size` parameters: information @ change = gradient."""

    size: int

    def __post_init__(self) -> None:
        self.information = np.zeros((self.size, self.size))
        self.gradient = np.zeros(self.size)

    def add_factor(
        self, J: FloatArray, columns: IntArray, residual: FloatArray, W: FloatArray
    ) -> None:
        """Adds a residual (m,) with information W (m, m), weighted by Cauchy's kernel.

        J (m, k) is the negated derivative of the residual by k of the columns.
        """
        weighted = W @ residual
        robust = 1 / (1 + residual @ weighted / FACTOR_KERNEL_WIDTH**2)
        self.gradient[columns] += robust * (weighted @ J)
        self.information[np.ix_(columns, columns)] += robust * (J.T @ W @ J)


@dataclass(frozen=True, eq=False)
class WindowPoints:
    """k points observed in n frames.

    A point (x, y, h) has the ray (x, y, 1) and the inverse depth h in its reference frame, in which
    it was first observed. The pose of the reference frame is held during the iterations, so that a
    residual depends on one pose.
    """

    camera: Camera
    observed: FloatArray
    """(k, n, 3) pixels and inverse depths in 1 / meters; NaN where not measured."""
    sigma: FloatArray
    """(k, n, 3) standard deviations of `observed`."""
    rotation: FloatArray
    """(k, 3, 3) rotations of the poses of the reference frames."""
    translation: FloatArray
    """(k, 3) translations of these poses, in meters."""

    def eliminate(
        self, poses: CameraPose, points: FloatArray, equations: NormalEquations
    ) -> tuple[FloatArray, FloatArray]:
        """Adds the points (k, 3) to the equations of the poses (Schur complement).

        Returns:
            `gain` (k, 3, 3 + 6 n) and `offset` (k, 3): a change p of calibration errors and poses
            changes the points by `offset` - `gain` p.
        """
        residual, robust, J, D = self._linearize(poses, points)
        k, n, m = len(points), len(poses[0]), len(CALIBRATION_SIGMA)
        weighted = robust[:, :, None, None] * D
        cross = np.swapaxes(J, 2, 3) @ weighted
        cross = np.concatenate([cross[:, :, 6:].sum(1), cross[:, :, :6].reshape(k, 6 * n, 3)], 1)
        weighted, D = weighted.reshape(k, 3 * n, 3), D.reshape(k, 3 * n, 3)
        inverse = np.linalg.inv(np.swapaxes(D, 1, 2) @ weighted + DAMPING * np.eye(3))
        gain = inverse @ np.swapaxes(cross, 1, 2)
        right = (residual.reshape(k, 1, 3 * n) @ weighted)[:, 0]
        offset = (inverse @ right[:, :, None])[:, :, 0]
        for j in range(n):
            J_j = J[:, j].reshape(-1, 6 + m)
            weighted = np.repeat(robust[:, j], 3)[:, None] * J_j
            columns = np.append(m + 6 * j + np.arange(6), np.arange(m))
            equations.information[np.ix_(columns, columns)] += weighted.T @ J_j
            equations.gradient[columns] += residual[:, j].ravel() @ weighted
        size = m + 6 * n
        by_points = np.swapaxes(cross, 1, 2).reshape(-1, size)
        equations.information[:size, :size] -= by_points.T @ gain.reshape(-1, size)
        equations.gradient[:size] -= offset.ravel() @ by_points
        return gain, offset

    def _linearize(
        self, poses: CameraPose, points: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Normalized residuals of points, and their negated derivatives.

        Returns:
            (k, n, 3) residuals, (k, n) robust weights, (k, n, 3, 9) derivatives by pose and
            calibration errors, and (k, n, 3, 3) by the point; 0 where nothing was observed.
        """
        camera, sigma = self.camera, self.sigma
        focal, (R, t), h = np.array([camera.fx, camera.fy]), poses, points[:, None, 2:]
        A = R @ np.swapaxes(self.rotation, 1, 2)[:, None]
        b = t - (A @ self.translation[:, None, :, None])[..., 0]
        ray = np.append(points[:, :2], np.ones((len(points), 1)), 1)
        q = (A @ ray[:, None, :, None])[..., 0] + h * b
        seen = np.isfinite(self.observed[:, :, 0]) & (q[:, :, 2] > MIN_DEPTH_RATIO)
        seen = np.stack([seen, seen, seen & np.isfinite(self.observed[:, :, 2])], 2)
        z = np.where(seen[:, :, :1], q[:, :, 2:], 1.0)
        u, v, w = np.moveaxis(np.concatenate([q[:, :, :2], h + 0 * z], 2) / z, 2, 0)
        predicted = np.stack([camera.fx * u + camera.cx, camera.fy * v + camera.cy, w], 2)
        residual = np.where(seen, (self.observed - predicted) / sigma, 0.0)
        scale = np.where(seen, np.append(focal, 1.0) / sigma, 0.0)
        by_point = np.zeros((*q.shape, 3))
        by_point[..., [0, 1], [0, 1]] = scale[:, :, :2] / z
        by_point[..., 2] = -np.stack([u, v, w], 2) * scale / z
        # at the predicted pixel, since the observed one has noise
        by_errors = (
            calibration_jacobian(camera, predicted) * np.where(seen, -1 / sigma, 0)[..., None]
        )
        by_rotation = -by_point @ cross_matrix(q - h * t)
        J = np.concatenate([by_rotation, h[..., None] * by_point, by_errors], 3)
        D = by_point @ np.concatenate([A[..., :2], b[..., None]], 3)
        D[..., 2, 2] += scale[:, :, 2] / z[..., 0]
        robust = 1 / (1 + np.square(residual).sum(2) / POINT_KERNEL_WIDTH**2) ** 2
        return residual, robust, J, D  # Geman & McClure (1987)


@dataclass(frozen=True, eq=False)
class WindowSteps(Table):
    """Steps between the n frames of a window."""

    control: FloatArray = column(3)
    """(n - 1, 3) controls by odometry."""
    by_errors: FloatArray = column(3, ODOMETRY_ERRORS)
    """(n - 1, 3, m) derivatives of the controls by the odometry errors."""
    information: FloatArray = column(6, 6)
    """(n - 1, 6, 6) information of control and off-plane motion by odometry."""
    seconds: FloatArray = column()
    """(n - 1,) durations in seconds."""
    rate: FloatArray = column(6)
    """(n - 1, 6) motion per second, as estimated when each step was the newest."""
    rate_covariance: FloatArray = column(6, 6)
    """(n - 1, 6, 6) covariances of the rates."""

    def add_to(
        self,
        equations: NormalEquations,
        motion: FloatArray,
        J: FloatArray,
        error: FloatArray,
        acceleration: FloatArray,
        before: tuple[FloatArray, FloatArray],
    ) -> None:
        """Adds the factors of odometry, and of nearly constant velocity.

        `motion` (n - 1, 6) and J are the result of `step_motions`, `error` (m,) are the odometry
        errors, `acceleration` (6,) the standard deviations of the change of rates in a second, and
        `before` the rates (6,) before the first step with their information (6, 6).
        """
        n, m = len(motion), len(CALIBRATION_SIGMA)
        residual = -motion
        residual[:, :3] += self.control + self.by_errors @ error
        errors = np.arange(m + 6 * (n + 1), equations.size)
        for k in range(n):
            columns = np.append(m + 6 * k + np.arange(12), errors)
            by_errors = np.append(-self.by_errors[k], np.zeros((3, len(errors))), 0)
            by_all = np.append(J[k], by_errors, 1)
            equations.add_factor(by_all, columns, residual[k], self.information[k])
        rate, by_rate = motion / self.seconds[:, None], J / self.seconds[:, None, None]
        equations.add_factor(by_rate[0], m + np.arange(12), before[0] - rate[0], before[1])
        for k in range(1, n):
            sigma = acceleration * (self.seconds[k] + self.seconds[k - 1]) / 2
            change = np.zeros((6, 18))
            change[:, 6:] = by_rate[k]
            change[:, :12] -= by_rate[k - 1]
            columns = m + 6 * (k - 1) + np.arange(18)
            equations.add_factor(change, columns, rate[k - 1] - rate[k], np.diag(1 / sigma**2))
