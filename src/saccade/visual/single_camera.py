"""Motion of a single camera, and depths triangulated over this motion.

A single camera measures no lengths. Steps have the length of odometry, with its scale corrected by
the height of the camera above the ground; see `unscaled_camera` for a camera without odometry.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from saccade.frames import Camera, Drive, directions
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.ground_scale import DISTANCE_NOISE, GroundTracker
from saccade.visual.motion_estimator import Frames, MotionEstimator, PointPair
from saccade.visual.points import TrackedPoints
from saccade.visual.robot_motion import camera_motion

STEP_SIGMA = 0.05
"""Relative standard deviation of the length of a step."""
MIN_RAY_ANGLE = 1e-4
"""Minimum angle between two rays that are triangulated, in radians."""


class SingleCameraMotionEstimator(MotionEstimator):
    """Motion by a single camera, with the lengths of odometry."""

    measures_range = False

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        super().__init__(drive, config)
        self._trajectory = CameraTrajectory()
        self._ground = GroundTracker(drive.camera)

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """Covariance (3, 3) of a pose (3,) by the scale of the whole trajectory."""
        by_scale = self.scale_sigma * np.append(pose[:2] - self._drive.start[:2], 0.0)
        return np.outer(by_scale, by_scale)

    def combine(
        self, motion: Egomotion | None, points: PointPair, frames: Frames
    ) -> MotionEstimate:
        """Motion by the camera, with a length from odometry and the ground."""
        if motion is None:
            earlier, now = self.cameras
            self._trajectory.append(*camera_motion(now, self.corrected_odometry[0], earlier))
            return self.measured(None)
        previous, current = (None if each.frame.turn else each.left for each in frames)
        if previous is not None and current is not None:
            distance = self._ground.distance(previous, current, motion)
            if distance is not None:
                motion = self._with_distance(motion, distance)
        self._trajectory.append(motion.rotation, motion.translation)
        self.planarity.update(motion.off_plane, self.seconds)
        return self.measured(motion)

    def with_depth(self, points: TrackedPoints) -> TrackedPoints:
        """The tracked points (k,) with depths triangulated from their first and current pixels."""
        camera, pixel_sigma = self.cameras[1], self._config.pixel_sigma
        depth, sigma = self._trajectory.triangulate(camera, points, pixel_sigma)
        return replace(points, depth=depth, depth_sigma=sigma)

    def _with_distance(self, motion: Egomotion, distance: float) -> Egomotion:
        """Updates the scale by a distance over the ground in meters; returns the scaled motion."""
        factor = self.errors.factor
        ratio = distance / float(np.linalg.norm(motion.translation))
        self.errors.update_scale(ratio)
        change = self.errors.factor / factor
        length = float(np.hypot(*motion.control[:2]))
        direction = np.append(motion.control[:2] / length, 0.0)
        cross_covariance = motion.covariance @ direction
        variance = float(direction @ cross_covariance) + (DISTANCE_NOISE * length) ** 2
        innovation = (ratio / self.errors.camera_factor - change) * length
        control = motion.control + cross_covariance * innovation / variance
        covariance = motion.covariance - np.outer(cross_covariance, cross_covariance) / variance
        return motion._replace(
            control=control,
            translation=motion.translation * (float(np.hypot(*control[:2])) / length),
            covariance=(covariance + covariance.T) / 2,
        )


@dataclass
class CameraTrajectory:
    """Poses of the camera in all frames, accumulated from its motions."""

    rotation: list[FloatArray] = field(default_factory=lambda: [np.eye(3)])
    """(3, 3) for each frame: the rotation from the first camera frame."""
    translation: list[FloatArray] = field(default_factory=lambda: [np.zeros(3)])
    """(3,) for each frame: the first camera center, in meters."""

    def append(self, rotation: FloatArray, translation: FloatArray) -> None:
        """Adds a frame by its `CameraPose` relative to the last frame."""
        self.translation.append(rotation @ self.translation[-1] + translation)
        self.rotation.append(rotation @ self.rotation[-1])

    def triangulate(
        self, camera: Camera, points: TrackedPoints, pixel_sigma: float
    ) -> tuple[FloatArray, FloatArray]:
        """Least-squares depths of k points from the rays of their first and current pixels.

        Returns depths (k,) along the optical axis in the last frame and their standard deviations
        (k,), in meters; NaN where the rays do not intersect in front of the camera.
        """
        if len(points) == 0:
            return np.zeros(0), np.zeros(0)
        frames = points.first_frame.tolist()
        R = self.rotation[-1] @ np.array([self.rotation[i].T for i in frames])  # (k, 3, 3)
        earlier = np.array([self.translation[i] for i in frames])
        t = self.translation[-1] - (R @ earlier[:, :, None])[:, :, 0]
        current = directions(camera, points.xy.astype(np.float64))
        first = (R @ directions(camera, points.first_xy.astype(np.float64))[:, :, None])[:, :, 0]
        # depth * current - first_depth * first = t
        pairs = (current, current), (current, first), (first, first), (current, t), (first, t)
        a, b, c, p, q = ((u * v).sum(1) for u, v in pairs)
        determinant = a * c - b * b
        sine = np.sqrt(np.maximum(determinant, 0.0) / (a * c))
        intersect = sine > MIN_RAY_ANGLE
        depth = (c * p - b * q) / np.where(intersect, determinant, 1.0)
        first_depth = (b * p - a * q) / np.where(intersect, determinant, 1.0)
        angle_sigma = np.sqrt(2) * pixel_sigma / camera.fx
        steps = np.maximum(len(self.translation) - 1 - points.first_frame, 1)
        relative_sigma = np.hypot(
            angle_sigma / np.maximum(sine, MIN_RAY_ANGLE), STEP_SIGMA / np.sqrt(steps)
        )
        known = intersect & (depth > 0) & (first_depth > 0)
        return np.where(known, depth, np.nan), np.where(known, depth * relative_sigma, np.nan)
