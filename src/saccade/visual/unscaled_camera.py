"""Motion of a single camera without odometry: its scale, and whether it moves at all.

The first step has an assumed length. Later ones have the length that fits the triangulated depths,
whose errors add up: the scale drifts. A step without parallax has no translation; it is measured
from the last keyframe, so that slow motions are not mistaken for a standstill.
"""

import numpy as np

from saccade.frames import Camera, Drive, directions
from saccade.slam.filter.robot_models import heading_rotation
from saccade.types import Float32Array, FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import (
    Egomotion,
    MotionEstimate,
    correspondences_of,
    estimate_motion,
)
from saccade.visual.motion_estimator import Frames, PointPair
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import cross_matrix, robot_motion
from saccade.visual.single_camera import SingleCameraMotionEstimator

MIN_POINTS = 8
"""Minimum number of points for the length of a step, or for a comparison with a keyframe."""
MAX_DEPTH_SIGMA = 0.2
"""Maximum relative standard deviation of the depths that determine a length."""
LENGTH_RATIOS = (0.2, 5.0)
"""Minimum and maximum ratio of the measured and expected length of a step."""
MIN_PARALLAX = 0.6
"""Minimum median parallax of a translation, in pixels."""
MAX_EPIPOLAR_RATIO = 0.35
"""Maximum ratio of the median distance from the epipolar lines to the median parallax of a
translation. Tracks that drift at random have .6."""
STILL_SIGMA = 0.01
"""Standard deviation of the translation of a camera that stands, in steps of the assumed speed."""
ROTATION_ITERATIONS = 4
"""Number of iterations of the robust rotation."""
CORRELATED_POINTS = 4.0
"""Number of points whose depths err as one."""
LOST_SIGMA = 0.5
"""Relative standard deviation of the length of a step that no depths determine."""


class UnscaledCameraMotionEstimator(SingleCameraMotionEstimator):
    """Motion by a single camera without odometry."""

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        super().__init__(drive, config)
        self._keyframe = TrackedPoints()
        self._turned = np.eye(3)  # rotation of the camera since the keyframe
        self._drift = ScaleDrift(drive.start)
        self._is_scaled = False  # whether depths have determined a length
        self.is_still = True
        """Whether the camera did not move in the last step."""

    @property
    def scale_drift(self) -> float:
        """Relative standard deviation of the present scale, compared with that of the start."""
        return float(np.sqrt(self._drift.variance))

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """Covariance (3, 3) of a pose (3,) by the drift of the scale."""
        return self._drift.covariance

    def predict(self, number: int) -> MotionEstimate:
        """Control that leads to a frame at the last velocity, or else at the assumed one."""
        control, covariance = super().predict(number)
        if self.velocity is not None and self._drive.scale == "held":
            expected = self.velocity * self.seconds
            length = max(float(np.hypot(*expected[:2])), float(np.hypot(*control[:2])) / 10)
            sigma = np.array([length / 2, length / 2, np.sqrt(covariance[2, 2])])
            control, covariance = expected, np.diag(np.square(sigma))
        self.corrected_odometry = control, covariance
        return self.corrected_odometry

    def scaled(self, motion: Egomotion, before: TrackedPoints, after: TrackedPoints) -> Egomotion:
        """The motion without translation if there is no parallax, or else with its length."""
        held = int(np.isin(self._keyframe.id, after.id).sum())
        is_last = not self.is_still or held < MIN_POINTS
        if is_last:
            self._keyframe, self._turned = before, np.eye(3)
        earlier, now = self.cameras
        _, i, j = np.intersect1d(self._keyframe.id, after.id, return_indices=True)
        pixels = self._keyframe.xy[i], after.xy[j]
        rotation, parallax = camera_rotation(now, *pixels)
        moved = None
        if parallax >= MIN_PARALLAX:
            moved = self._moved(pixels, motion, is_last)
        self.is_still = moved is None
        if moved is None:
            R = rotation @ self._turned.T
            self._turned = rotation
            return self._still(motion, R)
        R, t = moved
        t = t * self._length_ratio(before, after, R, t)
        control, off_plane, _ = robot_motion(now, R, t, earlier)
        return motion._replace(control=control, off_plane=off_plane, rotation=R, translation=t)

    def _moved(
        self, pixels: tuple[Float32Array, Float32Array], motion: Egomotion, is_last: bool
    ) -> tuple[FloatArray, FloatArray] | None:
        """Rotation and translation of the last step, by pixels (k, 2) in keyframe and frame.

        None if no translation explains the parallax.
        """
        now, unknown = self.cameras[1], np.full(len(pixels[0]), np.nan)
        R, t = motion.rotation @ self._turned, motion.translation
        if not is_last:
            points = correspondences_of(*pixels, unknown, unknown, unknown, unknown)
            prior = self.corrected_odometry
            found = estimate_motion(now, points, self._config.pixel_sigma, prior)
            if found is None:
                return None
            R, t = found.rotation, found.translation
        _, parallax = camera_rotation(now, *pixels)
        if epipolar_distance(now, *pixels, R, t) > MAX_EPIPOLAR_RATIO * parallax:
            return None
        return R @ self._turned.T, t

    def _still(self, motion: Egomotion, R: FloatArray) -> Egomotion:
        """The motion of a camera that turns in place."""
        earlier, now = self.cameras
        control, off_plane, _ = robot_motion(now, R, np.zeros(3), earlier)
        step = STILL_SIGMA * float(np.hypot(*self.declared_odometry[0][:2]))
        turn = self._config.pixel_sigma / now.fx / 5
        return motion._replace(
            control=control,
            off_plane=off_plane,
            covariance=np.diag(np.square([step, step, turn])),
            rotation=R,
            translation=np.zeros(3),
        )

    def _length_ratio(
        self, before: TrackedPoints, after: TrackedPoints, R: FloatArray, t: FloatArray
    ) -> float:
        """Ratio of the length that fits the depths of the last frame and that of t (3,).

        It is the median over all points of known depth, weighted by their parallax; 1 if there are
        too few.
        """
        if self._drive.scale == "assumed":
            length = float(np.linalg.norm(self.declared_odometry[0][:2]))
            return length / max(float(np.linalg.norm(t)), 1e-9)
        known = before.depth_sigma < MAX_DEPTH_SIGMA * before.depth
        _, i, j = np.intersect1d(before.id[known], after.id, return_indices=True)
        if len(i) < MIN_POINTS:
            self._drift.add_error(LOST_SIGMA if self._is_scaled else 0.0)
            return 1.0
        camera = self.cameras[1]
        points = before[known][i]
        depth = points.depth
        rotated = (directions(camera, points.xy.astype(np.float64)) * depth[:, None]) @ R.T
        rays = directions(camera, after.xy[j].astype(np.float64))
        offset, slope = np.cross(rays, rotated), np.cross(rays, t)
        squared = np.maximum(np.square(slope).sum(1), 1e-12)
        factor = -(offset * slope).sum(1) / squared
        order, weight = np.argsort(factor), np.sqrt(squared) / depth
        total = np.cumsum(weight[order])
        low, median, high = (
            float(factor[order[np.searchsorted(total, total[-1] * each)]])
            for each in (0.25, 0.5, 0.75)
        )
        if median <= 0:
            self._drift.add_error(LOST_SIGMA)
            return 1.0
        spread = (high - low) / 1.35 / median  # one standard deviation
        count = max(len(i) / CORRELATED_POINTS, 1.0)
        self._drift.add_error(min(1.25 * spread / np.sqrt(count), LOST_SIGMA))
        self._is_scaled = True
        return float(np.clip(median, *LENGTH_RATIOS))

    def combine(
        self, motion: Egomotion | None, points: PointPair, frames: Frames
    ) -> MotionEstimate:
        """Motion by the camera, with the length found by `scaled`."""
        if motion is None:
            self._keyframe = TrackedPoints()
            self._drift.add_error(LOST_SIGMA if self._is_scaled else 0.0)
        control, covariance = super().combine(motion, points, frames)
        self._drift.add(control)
        return control, covariance


class ScaleDrift:
    """Error of the scale, which drifts, and the covariance of the pose by it.

    The scale of each step has the relative error of the step before and a new, independent one.
    """

    def __init__(self, start: FloatArray) -> None:
        self._heading = float(start[2])
        self.variance = 0.0
        """Relative variance of the present scale."""
        self._cross = np.zeros(3)  # covariance of pose and scale
        self.covariance = np.zeros((3, 3))
        """(3, 3) covariance of the pose."""

    def add_error(self, sigma: float) -> None:
        """Adds a relative error of the scale."""
        self.variance += sigma**2

    def add(self, control: FloatArray) -> None:
        """Adds a step by its control (3,)."""
        d = heading_rotation(self._heading) @ np.append(control[:2], 0.0)
        self._heading += float(control[2])
        by_scale = np.outer(d, self._cross)
        self.covariance = self.covariance + by_scale + by_scale.T + self.variance * np.outer(d, d)
        self._cross = self._cross + self.variance * d


def camera_rotation(
    camera: Camera, previous: Float32Array, current: Float32Array
) -> tuple[FloatArray, float]:
    """Robust rotation (3, 3) between pixels (k, 2), and the median parallax in pixels that remains.

    Source: Wahba's problem by singular values (Markley, 1988), with Cauchy weights.
    """
    a, b = (directions(camera, each.astype(np.float64)) for each in (previous, current))
    a, b = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (a, b))
    weight, R, angle = np.ones(len(a)), np.eye(3), np.zeros(len(a))
    for _ in range(ROTATION_ITERATIONS):
        U, _, Vt = np.linalg.svd((b * weight[:, None]).T @ a)
        R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
        angle = np.linalg.norm(np.cross(b, a @ R.T), axis=1)
        weight = 1 / (1 + np.square(angle / max(float(np.median(angle)), 1e-9)))
    return R, float(np.median(angle)) * camera.fx


def epipolar_distance(
    camera: Camera, previous: Float32Array, current: Float32Array, R: FloatArray, t: FloatArray
) -> float:
    """Median distance in pixels of pixels (k, 2) from their epipolar lines after a motion."""
    a, b = (directions(camera, each.astype(np.float64)) for each in (previous, current))
    line = (a @ R.T) @ cross_matrix(t).T
    return float(np.median(np.abs((line * b).sum(1)) / np.hypot(*line[:, :2].T).clip(1e-12))) * (
        camera.fx
    )
