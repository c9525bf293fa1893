"""Sliding window: the poses and points of the last frames, adjusted together.

Egomotion from one frame to the next forgets each point after two frames. Over a window every
point is observed many times, and a step without correspondences is estimated from those before
and after it. The first pose of the window is fixed.
"""

import cv2
import numpy as np
from scipy.linalg import solve_triangular

from saccade.frames import Camera
from saccade.io.checkpoint import (
    Arrays,
    attribute_arrays,
    merge,
    restore_attributes,
    select,
)
from saccade.types import FloatArray, IntArray
from saccade.visual._window_kernels import eliminate_points
from saccade.visual.camera import Intrinsics, directions
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import (
    DEFAULT_DEPTH,
    OFF_PLANE_SIGMA,
    CameraPose,
    MotionEstimate,
    Mounting,
    cross_product,
    robot_motion,
    robot_motion_jacobian,
    times,
)
from saccade.visual.odometry_model import ODOMETRY_ERRORS, OdometryErrors
from saccade.visual.self_calibration import SIGMA, CalibrationDrift, SelfCalibration
from saccade.visual.tables import TrackedPoints

KERNEL_WIDTH = 2.0
"""Width of the robust kernel of an observation, in standard deviations."""
ITERATIONS = 2
"""Of Gauss-Newton after each frame; the poses start where the last frame left them."""
FACTOR_WIDTH = 3.0
"""Width of the robust kernel of odometry and of changes of motion, in standard deviations."""
OFF_PLANE_ACCELERATION_SIGMA = (0.5, 0.2, 0.2)
"""Standard deviations of the change of vertical speed (m/s), and of the rates of roll and pitch
(rad/s), in a second."""


MAX_INVERSE_DEPTH = 10.0
"""Upper bound of the estimated inverse depths, in 1 / metres."""


class SlidingWindow:
    """Bundle adjustment over the last frames.

    Args:
        camera: the calibration.
        config: length of the window and standard deviations.
        odometry: its errors, which the window estimates.
    """

    def __init__(self, camera: Camera, config: VisualConfig, odometry: OdometryErrors) -> None:
        self._camera, self._config, self._errors = camera, config, odometry
        speed, turn_rate = config.acceleration_sigma
        self._acceleration = np.array([speed, speed / 4, turn_rate, *OFF_PLANE_ACCELERATION_SIGMA])
        self.calibration = SelfCalibration(camera, config.window)
        self.drift = CalibrationDrift(self.calibration)
        self.restart()

    def restart(self) -> None:
        """Forget all frames but the last: after a gap, no earlier motion tells of the next one."""
        self._rotation, self._translation = np.eye(3)[None], np.zeros((1, 3))
        self._mount = self._camera.rotation[None].copy()  # as it was turned in each frame
        self._id: IntArray = np.zeros(0, np.int64)
        self._point = np.zeros((0, 4))  # homogeneous, in the frame of the poses
        self._observed, self._sigma = np.zeros((0, 1, 3)), np.zeros((0, 1, 3))
        self._odometry, self._seconds = np.zeros((0, 3)), np.zeros(0)
        self._by_errors = np.zeros((0, 3, ODOMETRY_ERRORS))
        self._rate, self._rate_covariance = np.zeros((0, 6)), np.zeros((0, 6, 6))
        self._first_rate, self._first_information = np.zeros(6), np.zeros((6, 6))
        self._information = np.zeros((0, 6, 6))

    def add(
        self,
        previous: TrackedPoints,
        current: TrackedPoints,
        motion: CameraPose,
        odometry: MotionEstimate,
        seconds: float,
        cameras: tuple[Camera, Camera],
    ) -> MotionEstimate:
        """Add a frame, and adjust the window.

        Args:
            previous: the points of the last frame, including those detected there.
            current: those of them that were tracked into this frame.
            motion: initial motion between the two.
            odometry: control and covariance of odometry.
            seconds: between the two.
            cameras: as they were turned in the two.

        Returns:
            The control from the last estimate of the last pose to the first of this one, so that
            it includes what this frame corrects of the past; and the covariance of the step.
        """
        self._observe(previous)
        last = self._rotation[-1], self._translation[-1]
        self._mount[-1] = cameras[0].rotation
        self._append(motion, odometry, seconds, cameras[1].rotation)
        self._observe(current)
        corrected = self.calibration.error
        covariance, by_calibration = self._adjust()
        R, t = relative_pose(last, (self._rotation[-1], self._translation[-1]))
        control, _ = robot_motion(self._mounting(-1), R, t, self._mounting(-2))
        self.drift.add(control, by_calibration, corrected)
        return control, covariance

    def to_arrays(self) -> Arrays:
        """The state as named arrays, for a checkpoint."""
        return attribute_arrays(self) | merge(
            {
                "calibration": attribute_arrays(self.calibration),
                "drift": attribute_arrays(self.drift),
            }
        )

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        restore_attributes(self, arrays)
        restore_attributes(self.calibration, select(arrays, "calibration"))
        restore_attributes(self.drift, select(arrays, "drift"))

    def _observe(self, points: TrackedPoints) -> None:
        """Record the points of the newest frame."""
        new = ~np.isin(points.id, self._id)
        self._add_points(points.id[new], points.xy[new].astype(np.float64), points.depth[new])
        rows = np.searchsorted(self._id, points.id)
        self._observed[rows, -1, :2] = points.xy
        self._observed[rows, -1, 2] = 1 / points.depth
        self._sigma[rows, -1, :2] = self._config.pixel_sigma
        self._sigma[rows, -1, 2] = points.depth_sigma / points.depth**2

    def _add_points(self, new: IntArray, xy: FloatArray, depth: FloatArray) -> None:
        """Add points of the newest frame: ids (k,), pixels (k, 2), depths (k,) or NaN."""
        depth = np.where(np.isfinite(depth), depth, DEFAULT_DEPTH)
        ray = directions(self._camera, xy)
        place = (ray - self._translation[-1] / depth[:, None]) @ self._rotation[-1]
        ids = np.concatenate([self._id, new])
        order = np.argsort(ids)
        blank = np.full((len(new), len(self._rotation), 3), np.nan)
        self._id = ids[order]
        self._point = np.concatenate([self._point, np.c_[place, 1 / depth]])[order]
        self._observed = np.concatenate([self._observed, blank])[order]
        self._sigma = np.concatenate([self._sigma, blank])[order]

    def _mounting(self, j: int | slice) -> Mounting:
        """The camera on the robot in frame j, or in some frames."""
        return Mounting(self._mount[j], self._camera.position)

    def _append(
        self, motion: CameraPose, odometry: MotionEstimate, seconds: float, mount: FloatArray
    ) -> None:
        """Append a frame, and drop the first one of a full window.

        The motion of the step that is dropped, as it was estimated when it was the newest, remains
        as that before the first step.
        """
        R, t = motion
        covariance = np.diag(np.square([0.0, 0.0, 0.0, *OFF_PLANE_SIGMA]))
        covariance[:3, :3] = odometry[1] + 1e-10 * np.eye(3)
        information = np.linalg.inv(covariance)
        first = int(len(self._rotation) == self._config.window)
        if first:
            sigma = self._acceleration * self._seconds[:2].mean()
            self._first_rate = self._rate[0]
            self._first_information = np.linalg.inv(self._rate_covariance[0] + np.diag(sigma**2))
        self._rate, self._rate_covariance = self._rate[first:], self._rate_covariance[first:]
        rotation, translation = R @ self._rotation[-1], R @ self._translation[-1] + t
        self._rotation = np.concatenate([self._rotation[first:], rotation[None]])
        self._translation = np.concatenate([self._translation[first:], translation[None]])
        self._mount = np.concatenate([self._mount[first:], mount[None]])
        self._odometry = np.concatenate([self._odometry[first:], odometry[0][None]])
        self._information = np.concatenate([self._information[first:], information[None]])
        self._seconds = np.append(self._seconds[first:], seconds)
        by_errors = self._errors.jacobian(odometry[0], seconds)[None]
        self._by_errors = np.concatenate([self._by_errors[first:], by_errors])
        seen = np.isfinite(self._observed[:, first:, 0]).any(1)
        blank = np.full((int(seen.sum()), 1, 3), np.nan)
        self._observed = np.concatenate([self._observed[seen, first:], blank], 1)
        self._sigma = np.concatenate([self._sigma[seen, first:], blank], 1)
        self._id, self._point = self._id[seen], self._point[seen]

    def _adjust(self) -> tuple[FloatArray, FloatArray]:
        """Robust Gauss-Newton.

        Returns:
            The (3, 3) covariance of the control of the last step, and its (3, 3) derivative by the
            errors of the calibration.
        """
        camera, n = self._camera, len(self._rotation)
        seen = np.isfinite(self._observed[:, :, 0])
        rows = np.flatnonzero(seen.sum(1) > 1)
        observed, sigma = self._observed[rows], self._sigma[rows]
        corrected, reference = self.calibration.correct(observed), seen[rows].argmax(1)
        R0, t0 = self._rotation.copy(), self._translation.copy()
        place, inverse_depth = self._point[rows, :3], self._point[rows, 3:]
        local = (R0[reference] @ place[:, :, None])[:, :, 0] + inverse_depth * t0[reference]
        points = np.c_[local[:, :2], inverse_depth] / local[:, 2:]
        visual, m = 6 * n + len(SIGMA), ODOMETRY_ERRORS
        gain, offset = np.empty((len(rows), 3, visual)), np.empty((len(rows), 3))
        squared = np.empty((len(rows), n))
        disparity_scale = 1 / (camera.fx * camera.baseline) if camera.baseline > 0 else 0.0
        poses, calibration = slice(6, 6 * n), slice(6 * n, visual)
        free = np.r_[6 : 6 * n, visual : visual + m]
        prior, error = np.linalg.inv(self._errors.covariance + 1e-14 * np.eye(m)), np.zeros(m)
        for _ in range(ITERATIONS):
            information, gradient = np.zeros((visual + m,) * 2), np.zeros(visual + m)
            points_information, points_gradient = np.zeros((visual, visual)), np.zeros(visual)
            eliminate_points(
                *(corrected, sigma, reference, Intrinsics.of(camera)),
                *((self._rotation, self._translation), (R0, t0), disparity_scale, KERNEL_WIDTH),
                *(points, points_information, points_gradient, gain, offset, squared),
            )
            information[:visual, :visual] += points_information
            gradient[:visual] += points_gradient
            step = self._add_factors(information, gradient, error)
            total = information[np.ix_(free, free)]
            total[-m:, -m:] += prior
            right = gradient[free]
            right[-m:] -= prior @ error
            solution = np.linalg.solve(total, right)
            change, before = np.zeros(visual), error
            change[poses], error = solution[:-m], error + solution[-m:]
            points += offset - gain @ change
            points[:, 2] = points[:, 2].clip(0.0, MAX_INVERSE_DEPTH)
            self._move(change)
        ray = np.c_[points[:, :2], np.ones(len(rows))]
        place = ((ray - points[:, 2:] * t0[reference])[:, None] @ R0[reference])[:, 0]
        self._point[rows] = np.c_[place, points[:, 2]]
        gradient += information[:, visual:] @ before  # about the present errors of odometry
        self._learn(information, gradient, poses, calibration)
        right = np.concatenate([step[:, poses], np.zeros((6, m))], 1).T
        root = solve_triangular(np.linalg.cholesky(total), right, lower=True)
        covariance, seconds = root.T @ root, self._seconds[-1]
        last, newest = zip(self._rotation[-2:], self._translation[-2:], strict=True)
        R, t = relative_pose(last, newest)
        value = np.concatenate(robot_motion(self._mounting(-1), R, t, self._mounting(-2)))
        self._rate = np.concatenate([self._rate, value[None] / seconds])
        by_time = covariance[None] / seconds**2
        self._rate_covariance = np.concatenate([self._rate_covariance, by_time])
        by_calibration = -np.linalg.solve(total, information[free][:, calibration])
        return np.asarray(covariance[:3, :3]), right.T[:3] @ by_calibration

    def _learn(
        self, information: FloatArray, gradient: FloatArray, poses: slice, calibration: slice
    ) -> None:
        """Update the errors of calibration and odometry, with the poses eliminated (Schur)."""
        share = 1 / self._config.window  # an observation is in so many windows
        cross = np.linalg.solve(information[poses, poses], information[poses])
        total = share * (information - information[:, poses] @ cross)
        vector = share * (gradient - gradient[poses] @ cross)
        self.calibration.update(total[calibration, calibration], vector[calibration])
        errors = slice(calibration.stop, None)
        change = self._errors.update(total[errors, errors], vector[errors])
        self._odometry = self._odometry + self._by_errors @ change

    def _move(self, change: FloatArray) -> None:
        """Change the poses by rotation vectors and translations."""
        for j in range(1, len(self._rotation)):
            p = change[6 * j : 6 * j + 6]
            self._rotation[j] = cv2.Rodrigues(p[:3])[0] @ self._rotation[j]
            self._translation[j] += p[3:]

    def _add_factors(
        self, information: FloatArray, gradient: FloatArray, error: FloatArray
    ) -> FloatArray:
        """Add odometry, and that motion changes little from step to step.

        Returns:
            (6, 6 n) derivative of the motion of the last step by the poses.
        """
        value, J = self._steps()
        n, size, seconds = len(value), len(gradient), self._seconds
        odometry = self._odometry + self._by_errors @ error
        by_all = np.zeros((n, 6, size))
        by_all[:, :, : J.shape[2]] = J
        rate, by_poses = value / seconds[:, None], by_all / seconds[:, None, None]
        by_all[:, :3, -ODOMETRY_ERRORS:] = -self._by_errors
        residual = -value
        residual[:, :3] += odometry
        add_factors(information, gradient, by_all, residual, self._information)
        before, rate_before = self._first_information[None], self._first_rate
        add_factors(information, gradient, by_poses[:1], (rate_before - rate[0])[None], before)
        if n > 1:
            sigma = self._acceleration * (seconds[1:] + seconds[:-1])[:, None] / 2
            W = np.eye(6) / np.square(sigma)[:, None]
            change = by_poses[1:] - by_poses[:-1]
            add_factors(information, gradient, change, rate[:-1] - rate[1:], W)
        return np.asarray(J[-1])

    def _steps(self) -> tuple[FloatArray, FloatArray]:
        """Motions (n - 1, 6) from frame to frame, and their Jacobians (n - 1, 6, 6 n) by poses."""
        n = len(self._rotation)
        t = self._translation[:-1]
        R, moved = relative_pose(
            (self._rotation[:-1], t), (self._rotation[1:], self._translation[1:])
        )
        after, before = self._mounting(slice(1, None)), self._mounting(slice(-1))
        value = np.concatenate(robot_motion(after, R, moved, before), -1)
        second = np.zeros((n - 1, 6, 6)) + np.eye(6)
        second[:, 3:, :3] = -cross_product(times(R, t))
        by_second = robot_motion_jacobian(after, R, moved, before) @ second
        J = np.zeros((n - 1, 6, n, 6))
        row = np.arange(n - 1)
        J[row, :, row, :3], J[row, :, row, 3:] = -by_second[..., :3] @ R, -by_second[..., 3:] @ R
        J[row, :, row + 1] = by_second
        return value, J.reshape(n - 1, 6, 6 * n)


def relative_pose(first: CameraPose, second: CameraPose) -> CameraPose:
    """The motions from some poses to others."""
    R = second[0] @ np.swapaxes(first[0], -1, -2)
    return R, second[1] - times(R, first[1])


def add_factors(
    information: FloatArray,
    gradient: FloatArray,
    J: FloatArray,
    residual: FloatArray,
    W: FloatArray,
) -> None:
    """Add residuals (k, 6) with informations (k, 6, 6) to normal equations (Cauchy's kernel)."""
    weighted = times(W, residual)
    robust = 1 / (1 + (residual * weighted).sum(1) / FACTOR_WIDTH**2)
    flat = J.reshape(-1, len(gradient))
    information += flat.T @ (robust[:, None, None] * (W @ J)).reshape(flat.shape)
    gradient += flat.T @ (robust[:, None] * weighted).ravel()
