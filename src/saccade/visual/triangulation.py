"""Triangulation of points that a single camera tracked over several frames."""

from dataclasses import dataclass, field

import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray
from saccade.visual.camera import directions
from saccade.visual.tables import TrackedPoints

STEP_SIGMA = 0.05
"""Standard deviation of the length of a step, as a fraction of it."""
MIN_PARALLAX = 1e-4
"""Radians under which two rays count as parallel."""


@dataclass
class CameraTrajectory:
    """Pose of the camera at each frame: its motions, accumulated."""

    rotation: list[FloatArray] = field(default_factory=lambda: [np.eye(3)])
    """(3, 3) for each frame, from the first camera frame to that one."""
    translation: list[FloatArray] = field(default_factory=lambda: [np.zeros(3)])
    """(3,) for each frame, in metres."""

    def append(self, rotation: FloatArray, translation: FloatArray) -> None:
        """Add a frame: points X of the last camera frame become `rotation` X + `translation`."""
        self.translation.append(rotation @ self.translation[-1] + translation)
        self.rotation.append(rotation @ self.rotation[-1])

    def triangulate(
        self, camera: Camera, points: TrackedPoints, pixel_sigma: float
    ) -> tuple[FloatArray, FloatArray]:
        """Depths of k points by the rays of their first and their present pixels.

        Args:
            camera: the calibration.
            points: k points.
            pixel_sigma: standard deviation of a pixel, in each axis.

        Returns:
            (k,) metres along the optical axis in the last frame, and their standard deviations;
            NaN where the rays do not intersect in front of the camera.
        """
        if len(points) == 0:
            return np.zeros(0), np.zeros(0)
        frames = points.first_frame.tolist()
        R = self.rotation[-1] @ np.array([self.rotation[i].T for i in frames])  # (k, 3, 3)
        earlier = np.array([self.translation[i] for i in frames])
        t = self.translation[-1] - (R @ earlier[:, :, None])[:, :, 0]
        present = directions(camera, points.xy.astype(np.float64))
        first = (R @ directions(camera, points.first_xy.astype(np.float64))[:, :, None])[:, :, 0]
        # present depth * present - first depth * first = t, by least squares
        a, b, c = (
            (u * v).sum(1) for u, v in ((present, present), (present, first), (first, first))
        )
        p, q = (present * t).sum(1), (first * t).sum(1)
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
