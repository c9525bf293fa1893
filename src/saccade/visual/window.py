"""Bundle adjustment over a sliding window of the last frames.

Egomotion between two frames uses each point twice. In a window a point is observed many times, and
a step without correspondences is estimated from its neighbors. The first pose is fixed.
"""

import cv2
import numpy as np

from saccade.frames import Camera, directions
from saccade.types import FloatArray, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import DEFAULT_DEPTH, MotionEstimate, with_off_plane
from saccade.visual.odometry_model import ODOMETRY_ERRORS, OdometryErrors
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import CameraPose, step_motions
from saccade.visual.self_calibration import CALIBRATION_SIGMA, CalibrationDrift, SelfCalibration
from saccade.visual.window_equations import NormalEquations, WindowPoints, WindowSteps

WINDOW_ITERATIONS = 2
"""Number of Gauss-Newton iterations after each frame, from the estimate after the last frame."""
OFF_PLANE_ACCELERATION_SIGMA = (0.5, 0.2, 0.2)
"""Standard deviations of the changes of vertical speed (m/s) and of the rates of roll and pitch
(rad/s) in a second."""
MAX_WINDOW_INVERSE_DEPTH = 10.0
"""Upper bound of the estimated inverse depths, in 1 / meters."""


class SlidingWindow:
    """Bundle adjustment that also estimates errors of odometry and calibration."""

    def __init__(self, camera: Camera, config: VisualConfig, odometry: OdometryErrors) -> None:
        self._camera, self._config, self._errors = camera, config, odometry
        speed, turn_rate = config.acceleration_sigma
        self._acceleration = np.array([speed, speed / 4, turn_rate, *OFF_PLANE_ACCELERATION_SIGMA])
        self.calibration = SelfCalibration(camera, config.window)
        self.drift = CalibrationDrift(self.calibration)
        self.restart()

    def restart(self) -> None:
        """Discards all frames but the last."""
        self._rotation, self._translation = np.eye(3)[None], np.zeros((1, 3))
        self._mount = self._camera.rotation[None].copy()  # as it was turned in each frame
        self._id: IntArray = np.zeros(0, np.int64)
        self._point = np.zeros((0, 4))  # homogeneous, in the frame of the poses
        self._observed = np.zeros((0, 1, 6))  # pixels, inverse depths, standard deviations
        self._steps = WindowSteps()
        self._before = np.zeros(6), np.zeros((6, 6))  # rates before the first step, and information

    def add(
        self,
        previous: TrackedPoints,
        current: TrackedPoints,
        motion: CameraPose,
        odometry: MotionEstimate,
        seconds: float,
        cameras: tuple[Camera, Camera],
    ) -> MotionEstimate:
        """Adds a frame, and adjusts the window.

        Points and cameras belong to the last frame and the new one. `motion` is the initial motion
        of the camera between the two frames, `odometry` the control over the same `seconds`.

        Returns:
            Control from the previous estimate of the last pose to the new pose, which includes the
            correction of the last pose; and its covariance.
        """
        self._observe(previous)
        last = self._rotation[-1], self._translation[-1]
        self._mount[-1] = cameras[0].rotation
        self._append(motion, odometry, seconds, cameras[1].rotation)
        self._observe(current)
        corrected = self.calibration.error
        covariance, by_calibration = self._adjust()
        control = self._last_step(last)[:3]
        self.drift.add(control, by_calibration, corrected)
        return control, covariance

    def _observe(self, points: TrackedPoints) -> None:
        """Records the points of the newest frame."""
        new = points[~np.isin(points.id, self._id)]
        depth = np.where(np.isfinite(new.depth), new.depth, DEFAULT_DEPTH)
        ray = directions(self._camera, new.xy.astype(np.float64))
        position = (ray - self._translation[-1] / depth[:, None]) @ self._rotation[-1]
        ids = np.concatenate([self._id, new.id])
        order = np.argsort(ids)
        blank = np.full((len(new), len(self._rotation), 6), np.nan)
        self._id = ids[order]
        self._point = np.concatenate([self._point, np.c_[position, 1 / depth]])[order]
        self._observed = np.concatenate([self._observed, blank])[order]
        pixel_sigma = np.full((len(points), 2), self._config.pixel_sigma)
        depth_sigma = points.depth_sigma / points.depth**2
        measured = np.c_[points.xy, 1 / points.depth, pixel_sigma, depth_sigma]
        self._observed[np.searchsorted(self._id, points.id), -1] = measured

    def _append(
        self, motion: CameraPose, odometry: MotionEstimate, seconds: float, mount: FloatArray
    ) -> None:
        """Appends a frame, and drops the first frame of a full window.

        The motion of the dropped step, as estimated when it was the newest, becomes the prior of
        the first step.
        """
        R, t = motion
        step = WindowSteps.zeros(
            1,
            control=odometry[0][None],
            by_errors=self._errors.jacobian(odometry[0], seconds)[None],
            information=np.linalg.inv(with_off_plane(odometry[1]))[None],
            seconds=np.array([seconds]),
        )
        steps, first = self._steps, int(len(self._rotation) == self._config.window)
        if first:
            sigma = self._acceleration * steps.seconds[:2].mean()
            information = np.linalg.inv(steps.rate_covariance[0] + np.diag(sigma**2))
            self._before = steps.rate[0], information
        self._steps = WindowSteps.concatenate([steps[first:], step])
        rotation, translation = R @ self._rotation[-1], R @ self._translation[-1] + t
        self._rotation = np.concatenate([self._rotation[first:], rotation[None]])
        self._translation = np.concatenate([self._translation[first:], translation[None]])
        self._mount = np.concatenate([self._mount[first:], mount[None]])
        seen = np.isfinite(self._observed[:, first:, 0]).any(1)
        blank = np.full((int(seen.sum()), 1, 6), np.nan)
        self._observed = np.concatenate([self._observed[seen, first:], blank], 1)
        self._id, self._point = self._id[seen], self._point[seen]

    def _adjust(self) -> tuple[FloatArray, FloatArray]:
        """Adjusts poses and points by robust Gauss-Newton.

        Returns:
            Covariance (3, 3) of the control of the last step, and derivative (3, 3) of that control
            by the calibration errors.
        """
        camera, n = self._camera, len(self._rotation)
        seen = np.isfinite(self._observed[:, :, 0])
        rows = np.flatnonzero(seen.sum(1) > 1)
        observed, sigma = np.split(self._observed[rows], 2, 2)
        corrected, reference = self.calibration.correct(observed), seen[rows].argmax(1)
        R0, t0 = self._rotation[reference], self._translation[reference]
        position, inverse_depth = self._point[rows, :3], self._point[rows, 3:]
        local = (R0 @ position[:, :, None])[:, :, 0] + inverse_depth * t0
        points = np.concatenate([local[:, :2], inverse_depth], 1) / local[:, 2:]
        visual, m = len(CALIBRATION_SIGMA) + 6 * n, ODOMETRY_ERRORS
        poses, errors = slice(len(CALIBRATION_SIGMA) + 6, visual), slice(visual, visual + m)
        free = slice(poses.start, errors.stop)  # the first pose is fixed
        window_points = WindowPoints(camera, corrected, sigma, R0, t0)
        prior, error = np.linalg.inv(self._errors.covariance + 1e-14 * np.eye(m)), np.zeros(m)
        for _ in range(WINDOW_ITERATIONS):
            equations = NormalEquations(errors.stop)
            now = self._rotation, self._translation
            gain, offset = window_points.eliminate(now, points, equations)
            motion, by_poses = step_motions(now, self._mount, camera.position)
            factors = motion, by_poses, error, self._acceleration, self._before
            self._steps.add_to(equations, *factors)
            information, gradient = equations.information, equations.gradient
            total, right = information[free, free].copy(), gradient[free].copy()
            total[-m:, -m:] += prior
            right[-m:] -= prior @ error
            change, before = np.asarray(np.linalg.solve(total, right), np.float64), error
            error = error + change[-m:]
            points += offset - gain[:, :, poses] @ change[:-m]
            points[:, 2] = points[:, 2].clip(0.0, MAX_WINDOW_INVERSE_DEPTH)
            self._move(change[:-m])
        ray = np.append(points[:, :2], np.ones((len(points), 1)), 1)
        position = ((ray - points[:, 2:] * t0)[:, None] @ R0)[:, 0]
        self._point[rows] = np.concatenate([position, points[:, 2:]], 1)
        gradient += information[:, errors] @ before  # about the present errors of odometry
        self._learn(information, gradient, poses)
        by_last = np.zeros((errors.stop, 6))
        by_last[visual - 12 : visual] = by_poses[-1].T
        by_last, by_calibration = by_last[free], information[free, : len(CALIBRATION_SIGMA)]
        solved = np.linalg.solve(total, np.concatenate([by_last, by_calibration], 1))
        covariance, seconds = by_last.T @ solved[:, :6], self._steps.seconds[-1]
        covariance = (covariance + covariance.T) / 2
        step = self._last_step((self._rotation[-2], self._translation[-2]))
        self._steps.rate[-1] = step / seconds
        self._steps.rate_covariance[-1] = covariance / seconds**2
        return covariance[:3, :3], -by_last[:, :3].T @ solved[:, 6:]

    def _learn(self, information: FloatArray, gradient: FloatArray, poses: slice) -> None:
        """Updates calibration and odometry errors, with the poses eliminated (Schur complement)."""
        fraction = 1 / self._config.window  # every observation is in `window` windows
        m = len(CALIBRATION_SIGMA)
        kept = np.concatenate([np.arange(m), np.arange(poses.stop, len(gradient))])
        rows = np.concatenate([information[:, kept], gradient[:, None]], 1)
        cross = rows[poses, :-1].T @ np.linalg.solve(information[poses, poses], rows[poses])
        reduced = fraction * (rows[kept] - cross)
        total, vector = reduced[:, :-1], reduced[:, -1]
        self.calibration.update(total[:m, :m], vector[:m])
        change = self._errors.update(total[m:, m:], vector[m:])
        self._steps.control[:] += self._steps.by_errors @ change

    def _last_step(self, before: CameraPose) -> FloatArray:
        """Motion (6,) of the robot to the newest frame, from a pose of the frame before."""
        R = np.stack([before[0], self._rotation[-1]])
        t = np.stack([before[1], self._translation[-1]])
        motions, _ = step_motions((R, t), self._mount[-2:], self._camera.position)
        return np.asarray(motions[0])

    def _move(self, change: FloatArray) -> None:
        """Changes all poses but the first by rotation vectors and translations (6 (n - 1),)."""
        for j, p in enumerate(change.reshape(-1, 6), 1):
            self._rotation[j] = cv2.Rodrigues(p[:3])[0] @ self._rotation[j]
            self._translation[j] += p[3:]
