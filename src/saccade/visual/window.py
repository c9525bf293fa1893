"""Sliding window: the poses and points of the last frames, adjusted together.

Egomotion from one frame to the next forgets each point after two frames. Over a window every
point is observed many times, and a step without correspondences is estimated from those before
and after it. The first pose of the window is fixed.
"""

import cv2
import numpy as np
from scipy.linalg import solve_triangular

from saccade.frames import Camera
from saccade.slam.checkpoint import (
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
    robot_motion,
    robot_motion_jacobian,
)
from saccade.visual.self_calibration import SIGMA, SelfCalibration
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
    """

    def __init__(self, camera: Camera, config: VisualConfig) -> None:
        self._camera, self._config = camera, config
        speed, turn_rate = config.acceleration_sigma
        self._acceleration = np.array([speed, speed / 4, turn_rate, *OFF_PLANE_ACCELERATION_SIGMA])
        self.calibration = SelfCalibration(camera, config.window)
        self.restart()

    def restart(self) -> None:
        """Forget all frames but the last: after a gap, no earlier motion tells of the next one."""
        self._rotation, self._translation = np.eye(3)[None], np.zeros((1, 3))
        self._mount = self._camera.rotation[None].copy()  # as it was turned in each frame
        self._id: IntArray = np.zeros(0, np.int64)
        self._point = np.zeros((0, 4))  # homogeneous, in the frame of the poses
        self._observed, self._sigma = np.zeros((0, 1, 3)), np.zeros((0, 1, 3))
        self._odometry, self._seconds = np.zeros((0, 3)), np.zeros(0)
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
        information = self._adjust()
        R, t = relative_pose(last, (self._rotation[-1], self._translation[-1]))
        control, _ = robot_motion(self._mounting(-1), R, t, self._mounting(-2))
        return control, self._step_covariance(information)

    def to_arrays(self) -> Arrays:
        """The state as named arrays, for a checkpoint."""
        return attribute_arrays(self) | merge({"calibration": attribute_arrays(self.calibration)})

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        restore_attributes(self, arrays)
        restore_attributes(self.calibration, select(arrays, "calibration"))

    def _observe(self, points: TrackedPoints) -> None:
        """Record the points of the newest frame."""
        points = points[np.argsort(points.id)]
        self._add_points(points[~np.isin(points.id, self._id)])
        rows = np.searchsorted(self._id, points.id)
        self._observed[rows, -1, :2] = points.xy
        self._observed[rows, -1, 2] = 1 / points.depth
        self._sigma[rows, -1, :2] = self._config.pixel_sigma * points.pixel_size[:, None]
        self._sigma[rows, -1, 2] = points.depth_sigma / points.depth**2

    def _add_points(self, points: TrackedPoints) -> None:
        """Add points of the newest frame that are not in the window."""
        depth = np.where(np.isfinite(points.depth), points.depth, DEFAULT_DEPTH)
        ray = directions(self._camera, points.xy.astype(np.float64))
        place = (ray - self._translation[-1] / depth[:, None]) @ self._rotation[-1]
        ids = np.concatenate([self._id, points.id])
        order = np.argsort(ids)
        blank = np.full((len(points), len(self._rotation), 3), np.nan)
        self._id = ids[order]
        self._point = np.concatenate([self._point, np.c_[place, 1 / depth]])[order]
        self._observed = np.concatenate([self._observed, blank])[order]
        self._sigma = np.concatenate([self._sigma, blank])[order]

    def _mounting(self, j: int) -> Mounting:
        """The camera on the robot in frame j."""
        return Mounting(self._mount[j], self._camera.position)

    def _append(
        self, motion: CameraPose, odometry: MotionEstimate, seconds: float, mount: FloatArray
    ) -> None:
        """Append a frame, and drop the first one of a full window."""
        R, t = motion
        covariance = np.diag(np.square([0.0, 0.0, 0.0, *OFF_PLANE_SIGMA]))
        covariance[:3, :3] = odometry[1] + 1e-10 * np.eye(3)
        information = np.linalg.inv(covariance)
        first = int(len(self._rotation) == self._config.window)
        rotation, translation = R @ self._rotation[-1], R @ self._translation[-1] + t
        self._rotation = np.concatenate([self._rotation[first:], rotation[None]])
        self._translation = np.concatenate([self._translation[first:], translation[None]])
        self._mount = np.concatenate([self._mount[first:], mount[None]])
        self._odometry = np.concatenate([self._odometry[first:], odometry[0][None]])
        self._information = np.concatenate([self._information[first:], information[None]])
        self._seconds = np.append(self._seconds[first:], seconds)
        seen = np.isfinite(self._observed[:, first:, 0]).any(1)
        blank = np.full((int(seen.sum()), 1, 3), np.nan)
        self._observed = np.concatenate([self._observed[seen, first:], blank], 1)
        self._sigma = np.concatenate([self._sigma[seen, first:], blank], 1)
        self._id, self._point = self._id[seen], self._point[seen]

    def _adjust(self) -> FloatArray:
        """Robust Gauss-Newton; returns the (6 n - 6, 6 n - 6) information of all but the first."""
        camera, n = self._camera, len(self._rotation)
        seen = np.isfinite(self._observed[:, :, 0])
        rows = np.flatnonzero(seen.sum(1) > 1)
        observed, sigma = self._observed[rows], self._sigma[rows]
        corrected, reference = self.calibration.correct(observed), seen[rows].argmax(1)
        R0, t0 = self._rotation.copy(), self._translation.copy()
        place, inverse_depth = self._point[rows, :3], self._point[rows, 3:]
        local = (R0[reference] @ place[:, :, None])[:, :, 0] + inverse_depth * t0[reference]
        points = np.c_[local[:, :2], inverse_depth] / local[:, 2:]
        size = 6 * n + len(SIGMA)
        gain, offset = np.empty((len(rows), 3, size)), np.empty((len(rows), 3))
        squared = np.empty((len(rows), n))
        disparity_scale = 1 / (camera.fx * camera.baseline) if camera.baseline > 0 else 0.0
        free, errors = slice(6, 6 * n), slice(6 * n, size)
        for _ in range(ITERATIONS):
            information, gradient = np.zeros((size, size)), np.zeros(size)
            eliminate_points(
                *(corrected, sigma, reference, Intrinsics.of(camera)),
                *((self._rotation, self._translation), (R0, t0), disparity_scale, KERNEL_WIDTH),
                *(points, information, gradient, gain, offset, squared),
            )
            self._add_factors(information, gradient)
            change = np.zeros(size)
            change[free] = np.linalg.solve(information[free, free], gradient[free])
            points += offset - gain @ change
            points[:, 2] = points[:, 2].clip(0.0, MAX_INVERSE_DEPTH)
            self._move(change)
        ray = np.c_[points[:, :2], np.ones(len(rows))]
        place = ((ray - points[:, 2:] * t0[reference])[:, None] @ R0[reference])[:, 0]
        self._point[rows] = np.c_[place, points[:, 2]]
        cross = np.linalg.solve(information[free, free], information[free, errors])  # Schur
        total = information[errors, errors] - information[errors, free] @ cross
        share = 1 / self._config.window  # an observation is in so many windows
        self.calibration.update(share * total, share * (gradient[errors] - gradient[free] @ cross))
        return information[free, free]

    def _move(self, change: FloatArray) -> None:
        """Change the poses by rotation vectors and translations."""
        for j in range(1, len(self._rotation)):
            p = change[6 * j : 6 * j + 6]
            self._rotation[j] = cv2.Rodrigues(p[:3])[0] @ self._rotation[j]
            self._translation[j] += p[3:]

    def _add_factors(self, information: FloatArray, gradient: FloatArray) -> None:
        """Add odometry, and that motion changes little from step to step."""
        rates: list[tuple[FloatArray, FloatArray]] = []
        for j, seconds in enumerate(self._seconds):
            value, J = self._step(j)
            residual = np.append(self._odometry[j], np.zeros(3)) - value
            blocks = slice(6 * j, 6 * j + 12)
            add_factor(information, gradient, blocks, J, residual, self._information[j])
            rates.append((value / seconds, J / seconds))
            if j > 0:
                change = np.zeros((6, 18))
                change[:, 6:] += rates[j][1]
                change[:, :12] -= rates[j - 1][1]
                sigma = self._acceleration * (seconds + self._seconds[j - 1]) / 2
                blocks = slice(6 * j - 6, 6 * j + 12)
                residual = rates[j - 1][0] - rates[j][0]
                add_factor(information, gradient, blocks, change, residual, np.diag(1 / sigma**2))

    def _step(self, j: int) -> tuple[FloatArray, FloatArray]:
        """Motion (6,) from frame j to the next, and its Jacobian (6, 12) by their poses."""
        first = self._rotation[j], self._translation[j]
        R, t = relative_pose(first, (self._rotation[j + 1], self._translation[j + 1]))
        x, y, z = R @ first[1]
        second = np.eye(6)
        second[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        mounts = self._mounting(j + 1), self._mounting(j)
        by_second = robot_motion_jacobian(mounts[0], R, t, mounts[1]) @ second
        by_first = -np.concatenate([by_second[:, :3] @ R, by_second[:, 3:] @ R], 1)
        value = np.concatenate(robot_motion(mounts[0], R, t, mounts[1]))
        return value, np.concatenate([by_first, by_second], 1)

    def _step_covariance(self, information: FloatArray) -> FloatArray:
        """(3, 3) of the control of the last step."""
        J = self._step(len(self._seconds) - 1)[1][:3, -min(len(information), 12) :]
        right = np.zeros((len(information), 3))
        right[-J.shape[1] :] = J.T
        root = solve_triangular(np.linalg.cholesky(information), right, lower=True)
        return np.asarray(root.T @ root)


def relative_pose(first: CameraPose, second: CameraPose) -> CameraPose:
    """The motion from one pose to another."""
    R = second[0] @ first[0].T
    return R, second[1] - R @ first[1]


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
