"""Sliding window: the poses and points of the last frames, adjusted together.

Egomotion from one frame to the next forgets each point after two frames. Over a window every
point is observed many times, and a step without correspondences is estimated from those before
and after it. The first pose of the window is fixed.
"""

from typing import NamedTuple

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray, IntArray
from saccade.visual._window_kernels import eliminate_points
from saccade.visual.camera import Intrinsics
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import (
    DEFAULT_DEPTH,
    OFF_PLANE_SIGMA,
    CameraPose,
    Prior,
    robot_motion,
    robot_motion_jacobian,
)
from saccade.visual.self_calibration import PARAMETERS, SelfCalibration
from saccade.visual.tables import TrackedPoints

KERNEL_WIDTH = 2.0
"""Width of the robust kernel of an observation, in standard deviations."""
ITERATIONS = 4
"""Of Gauss-Newton after each frame; the poses start where the last frame left them."""
FACTOR_WIDTH = 3.0
"""Width of the robust kernel of odometry and of changes of motion, in standard deviations."""
OFF_PLANE_ACCELERATION_SIGMA = (0.5, 0.2, 0.2)
"""Standard deviations of the change of vertical speed (m/s), and of the rates of roll and pitch
(rad/s), in a second."""


class Step(NamedTuple):
    """The motion between two frames of the window."""

    odometry: FloatArray
    """(3,) control by odometry."""
    information: FloatArray
    """(6, 6) of it and of the off-plane motion, which is about zero."""
    seconds: float


class SlidingWindow:
    """Bundle adjustment over the last frames.

    Args:
        camera: the calibration.
        config: length of the window and standard deviations.
    """

    def __init__(self, camera: Camera, config: VisualConfig) -> None:
        self._camera, self._config = camera, config
        speed, turn_rate = config.acceleration_sigma
        self._acceleration = np.array([speed, speed / 4, turn_rate, *OFF_PLANE_ACCELERATION_SIGMA])
        self._rotation, self._translation = np.eye(3)[None], np.zeros((1, 3))
        self._id: IntArray = np.zeros(0, np.int64)
        self._point = np.zeros((0, 4))  # homogeneous, in the frame of the poses
        self._observed, self._sigma = np.zeros((0, 1, 3)), np.zeros((0, 1, 3))
        self._steps: list[Step] = []
        self.calibration = SelfCalibration(camera)

    def add(
        self,
        previous: TrackedPoints,
        current: TrackedPoints,
        motion: CameraPose,
        odometry: Prior,
        seconds: float,
    ) -> Prior:
        """Add a frame, and adjust the window.

        Args:
            previous: the points of the last frame, including those detected there.
            current: those of them that were tracked into this frame.
            motion: initial motion between the two.
            odometry: control and covariance of odometry.
            seconds: between the two.

        Returns:
            The control from the last estimate of the last pose to the first of this one, so that
            it includes what this frame corrects of the past; and the covariance of the step.
        """
        self._observe(previous)
        last = self._rotation[-1], self._translation[-1]
        self._append(motion, odometry, seconds)
        self._observe(current)
        information = self._adjust()
        R, t = self._relative(last, (self._rotation[-1], self._translation[-1]))
        control, _ = robot_motion(self._camera, R, t)
        return control, self._step_covariance(information)

    def _observe(self, points: TrackedPoints) -> None:
        """Record the points of the newest frame."""
        known = np.searchsorted(self._id, points.id)
        new = known == len(self._id)
        new[~new] = self._id[known[~new]] != points.id[~new]
        self._add_points(points[new])
        rows = np.searchsorted(self._id, points.id)
        config, camera = self._config, self._camera
        self._observed[rows, -1, :2] = points.xy
        self._observed[rows, -1, 2] = 1 / points.depth
        self._sigma[rows, -1, :2] = config.pixel_sigma
        self._sigma[rows, -1, 2] = points.depth_sigma / points.depth**2

    def _add_points(self, points: TrackedPoints) -> None:
        n, camera = len(self._rotation), self._camera
        inverse = np.where(np.isfinite(points.depth), 1 / points.depth, 1 / DEFAULT_DEPTH)
        ray = np.stack(
            [
                (points.xy[:, 0] - camera.cx) / camera.fx,
                (points.xy[:, 1] - camera.cy) / camera.fy,
                np.ones(len(points)),
            ],
            1,
        )
        world = (ray - inverse[:, None] * self._translation[-1]) @ self._rotation[-1]
        ids = np.concatenate([self._id, points.id])
        order = np.argsort(ids, kind="stable")
        blank = np.full((len(points), n, 3), np.nan)
        self._id = ids[order]
        self._point = np.concatenate([self._point, np.c_[world, inverse]])[order]
        self._observed = np.concatenate([self._observed, blank])[order]
        self._sigma = np.concatenate([self._sigma, blank])[order]

    def _append(self, motion: CameraPose, odometry: Prior, seconds: float) -> None:
        """Append a frame, and drop the first one of a full window."""
        R, t = motion
        total = np.diag(np.square([0.0, 0.0, 0.0, *OFF_PLANE_SIGMA]))
        total[:3, :3] = odometry[1] + 1e-10 * np.eye(3)
        self._steps.append(Step(odometry[0], np.linalg.inv(total), seconds))
        self._translation = np.concatenate(
            [self._translation, (R @ self._translation[-1] + t)[None]]
        )
        self._rotation = np.concatenate([self._rotation, (R @ self._rotation[-1])[None]])
        blank = np.full((len(self._id), 1, 3), np.nan)
        first = int(len(self._rotation) > self._config.window)
        self._observed = np.concatenate([self._observed, blank], 1)[:, first:]
        self._sigma = np.concatenate([self._sigma, blank], 1)[:, first:]
        self._rotation, self._translation = self._rotation[first:], self._translation[first:]
        self._steps = self._steps[first:]
        kept = np.isfinite(self._observed[:, :, 0]).any(1)
        self._id, self._point = self._id[kept], self._point[kept]
        self._observed, self._sigma = self._observed[kept], self._sigma[kept]

    def _adjust(self) -> FloatArray:
        """Robust Gauss-Newton; returns the (6 n - 6, 6 n - 6) information of all but the first."""
        n = len(self._rotation)
        seen = np.isfinite(self._observed[:, :, 0])
        rows = np.flatnonzero(seen.sum(1) > 1)
        observed, sigma = self._observed[rows], self._sigma[rows]
        reference = seen[rows].argmax(1)
        R0, t0 = self._rotation.copy(), self._translation.copy()
        world = self._point[rows]
        local = (R0[reference] @ world[:, :3, None])[:, :, 0] + world[:, 3:] * t0[reference]
        points = np.c_[local[:, :2], world[:, 3]] / local[:, 2:]
        size = 6 * n + PARAMETERS
        gain, offset = np.empty((len(rows), 3, size)), np.empty((len(rows), 3))
        squared = np.empty((len(rows), n))
        bf = self._camera.fx * self._camera.baseline
        disparity_scale = 1 / bf if bf > 0 else 0.0
        corrected = self.calibration.correct(observed)
        poses = slice(6, 6 * n)
        for _ in range(ITERATIONS):
            information, gradient = np.zeros((size, size)), np.zeros(size)
            eliminate_points(
                *(corrected, sigma, reference, Intrinsics.of(self._camera)),
                *((self._rotation, self._translation), (R0, t0), disparity_scale, KERNEL_WIDTH),
                *(points, information, gradient, gain, offset, squared),
            )
            self._add_factors(information, gradient)
            change = np.zeros(size)
            change[poses] = np.linalg.solve(information[poses, poses], gradient[poses])
            points += offset - gain @ change
            points[:, 2] = points[:, 2].clip(0.0, 10.0)
            for j in range(1, n):
                p = change[6 * j : 6 * j + 6]
                self._rotation[j] = cv2.Rodrigues(p[:3])[0] @ self._rotation[j]
                self._translation[j] += p[3:]
        cross = information[6 * n :, poses]
        solved = np.linalg.solve(information[poses, poses], cross.T)
        total = information[6 * n :, 6 * n :] - cross @ solved
        self.calibration.update(total / self._config.window, (gradient[6 * n :] - gradient[poses] @ solved) / self._config.window)
        ray = np.c_[points[:, :2], np.ones(len(rows))]
        world = ((ray - points[:, 2:] * t0[reference])[:, None] @ R0[reference])[:, 0]
        self._point[rows] = np.c_[world, points[:, 2]]
        return information[poses, poses]

    def _add_factors(self, information: FloatArray, gradient: FloatArray) -> None:
        """Add odometry, and that motion changes little from step to step."""
        last: tuple[FloatArray, FloatArray, float] | None = None
        for j, step in enumerate(self._steps):
            value, J = self._step(j)
            residual = np.append(step.odometry, np.zeros(3)) - value
            blocks = slice(6 * j, 6 * j + 12)
            add_factor(information, gradient, blocks, J, residual, step.information)
            rate, rate_jacobian = value / step.seconds, J / step.seconds
            if last is not None:
                seconds = (last[2] + step.seconds) / 2
                W = np.diag(1 / np.square(self._acceleration * seconds))
                change = np.zeros((6, 18))
                change[:, 6:] += rate_jacobian
                change[:, :12] -= last[1]
                blocks = slice(6 * j - 6, 6 * j + 12)
                add_factor(information, gradient, blocks, change, last[0] - rate, W)
            last = rate, rate_jacobian, step.seconds

    def _step(self, j: int) -> tuple[FloatArray, FloatArray]:
        """Motion (6,) from frame j to the next, and its Jacobian (6, 12) by their poses."""
        first = self._rotation[j], self._translation[j]
        R, t = self._relative(first, (self._rotation[j + 1], self._translation[j + 1]))
        x, y, z = R @ first[1]
        second = np.eye(6)
        second[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        by_pose = robot_motion_jacobian(self._camera, R, t) @ second
        by_first = np.concatenate([by_pose[:, :3] @ R, by_pose[:, 3:] @ R], 1)
        value = np.concatenate(robot_motion(self._camera, R, t))
        return value, np.concatenate([-by_first, by_pose], 1)

    def _relative(self, first: CameraPose, second: CameraPose) -> CameraPose:
        R = second[0] @ first[0].T
        return R, second[1] - R @ first[1]

    def _step_covariance(self, information: FloatArray) -> FloatArray:
        """(3, 3) of the control of the last step."""
        n = len(self._steps)
        _, J = self._step(n - 1)
        covariance = np.zeros((12, 12))
        inverse = np.linalg.inv(information)
        if n == 1:
            covariance[6:, 6:] = inverse
        else:
            covariance = inverse[-12:, -12:]
        return np.asarray(J[:3] @ covariance @ J[:3].T)


def add_factor(
    information: FloatArray,
    gradient: FloatArray,
    blocks: slice,
    J: FloatArray,
    residual: FloatArray,
    W: FloatArray,
) -> None:
    """Add a residual with information W to the normal equations (Cauchy's kernel)."""
    weighted = W @ residual
    robust = 1 / (1 + float(residual @ weighted) / FACTOR_WIDTH**2)
    information[blocks, blocks] += robust * J.T @ W @ J
    gradient[blocks] += robust * J.T @ weighted
