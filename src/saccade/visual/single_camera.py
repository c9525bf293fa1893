"""The motion of a single camera, which measures no lengths, and the depths that follow from it.

The length of a step is that of odometry, whose scale is corrected by the height of the camera above
the ground; without odometry it fits the depths that were triangulated before.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from saccade.frames import Camera, Drive
from saccade.types import FloatArray
from saccade.visual.camera import directions
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.ground_scale import DISTANCE_NOISE, GroundTracker
from saccade.visual.motion_estimator import Frames, MotionEstimator, PointPair
from saccade.visual.robot_motion import camera_motion, robot_motion
from saccade.visual.tables import TrackedPoints

STEP_SIGMA = 0.05
"""Standard deviation of the length of a motion step, as a fraction of it."""
MIN_PARALLAX = 1e-4
"""Angle between two rays in radians under which they are taken for parallel."""
MIN_POINTS = 8
"""Triangulated points from which a length is measured."""
MAX_DEPTH_SIGMA = 0.2
"""Standard deviation of the depths used, as a fraction of them."""
LIMITS = (0.2, 5.0)
"""Least and greatest length of a step over the expected one."""


class SingleCameraMotionEstimator(MotionEstimator):
    """The motion by a single camera, with the lengths of odometry."""

    measures_range = False

    def __init__(self, drive: Drive, config: VisualConfig) -> None:
        super().__init__(drive, config)
        self._trajectory = CameraTrajectory()
        self._ground = GroundTracker(drive.camera)

    def constant_errors(self, pose: FloatArray) -> FloatArray:
        """(3, 3) covariance of a pose (3,) by the scale of the whole trajectory."""
        by_scale = self.scale_sigma * np.append(pose[:2] - self._drive.start[:2], 0.0)
        return np.outer(by_scale, by_scale)

    def refine(self, motion: Egomotion, before: TrackedPoints, after: TrackedPoints) -> Egomotion:
        """Without odometry, the motion with the length that fits the depths of the last frame.

        Every point gives a length of the translation from its depth and its two pixels; the
        weighted median counts, by the parallax of a step. Unchanged where too few have a depth.
        """
        known = before.depth_sigma < MAX_DEPTH_SIGMA * before.depth
        _, i, j = np.intersect1d(before.id[known], after.id, return_indices=True)
        if self._drive.scale != "held" or len(i) < MIN_POINTS:
            return motion
        earlier, camera = self.cameras
        points, depth = before[known].xy[i].astype(np.float64), before[known].depth[i]
        rotated = (directions(camera, points) * depth[:, None]) @ motion.rotation.T
        rays = directions(camera, after.xy[j].astype(np.float64))
        offset, slope = np.cross(rays, rotated), np.cross(rays, motion.translation)
        squared = np.maximum(np.square(slope).sum(1), 1e-12)
        factor = -(offset * slope).sum(1) / squared
        order, weight = np.argsort(factor), np.sqrt(squared) / depth
        share = np.cumsum(weight[order])
        median = float(factor[order[np.searchsorted(share, share[-1] / 2)]])
        if median <= 0:
            return motion
        translation = motion.translation * np.clip(median, *LIMITS)
        control, off_plane, _ = robot_motion(camera, motion.rotation, translation, earlier)
        return motion._replace(control=control, off_plane=off_plane, translation=translation)

    def join(self, motion: Egomotion | None, points: PointPair, frames: Frames) -> MotionEstimate:
        """The motion by the camera, with a length from odometry and the ground."""
        if motion is None:
            earlier, now = self.cameras
            self._trajectory.append(*camera_motion(now, self._step[0], earlier))
            return self.measured(None)
        previous, current = (None if each.frame.turn else each.left for each in frames)
        if previous is not None and current is not None:
            distance = self._ground.distance(previous, current, motion)
            if distance is not None:
                motion = self._with_distance(motion, distance)
        self._trajectory.append(motion.rotation, motion.translation)
        self.planarity.update(motion.off_plane, self.seconds)
        control = self.measured(motion)
        self._learn_turn(control)
        return control

    def with_depth(self, points: TrackedPoints) -> TrackedPoints:
        """The tracked points (k,) with depths triangulated from their first and last pixels."""
        camera, pixel_sigma = self.cameras[1], self._config.pixel_sigma
        depth, sigma = self._trajectory.triangulate(camera, points, pixel_sigma)
        return replace(points, depth=depth, depth_sigma=sigma)

    def _with_distance(self, motion: Egomotion, distance: float) -> Egomotion:
        """Update the scale by a distance over the ground in meters; returns the longer motion."""
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

    def _learn_turn(self, measured: MotionEstimate) -> None:
        """Update the errors of odometry by the turn of a motion, whose length is odometry's."""
        control, covariance = self._step
        J = self.errors.jacobian(control, self.seconds)[2:]
        innovation, R = (measured[0] - control)[2:], (measured[1] + covariance)[2:, 2:]
        self.errors.update_by(J, innovation, R)


@dataclass
class CameraTrajectory:
    """Poses of the camera at each frame, accumulated from its motions."""

    rotation: list[FloatArray] = field(default_factory=lambda: [np.eye(3)])
    """(3, 3) for each frame: points X of the first camera frame become rotation X + translation."""
    translation: list[FloatArray] = field(default_factory=lambda: [np.zeros(3)])
    """(3,) for each frame, in meters."""

    def append(self, rotation: FloatArray, translation: FloatArray) -> None:
        """Add a frame by the motion from the last one, a `CameraPose`."""
        self.translation.append(rotation @ self.translation[-1] + translation)
        self.rotation.append(rotation @ self.rotation[-1])

    def triangulate(
        self, camera: Camera, points: TrackedPoints, pixel_sigma: float
    ) -> tuple[FloatArray, FloatArray]:
        """Least-squares depths of k points from the rays of their first and current pixels.

        (k,) meters along the optical axis in the last frame, and their standard deviations; NaN
        where the rays do not intersect in front of the camera.
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
        intersect = sine > MIN_PARALLAX
        depth = (c * p - b * q) / np.where(intersect, determinant, 1.0)
        first_depth = (b * p - a * q) / np.where(intersect, determinant, 1.0)
        angle_sigma = np.sqrt(2) * pixel_sigma / camera.fx
        steps = np.maximum(len(self.translation) - 1 - points.first_frame, 1)
        relative_sigma = np.hypot(
            angle_sigma / np.maximum(sine, MIN_PARALLAX), STEP_SIGMA / np.sqrt(steps)
        )
        known = intersect & (depth > 0) & (first_depth > 0)
        return np.where(known, depth, np.nan), np.where(known, depth * relative_sigma, np.nan)
