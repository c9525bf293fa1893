"""How far points are that one camera has followed over some frames."""

from dataclasses import dataclass, field

import numpy as np

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray, IntArray
from saccade.visual.camera import directions

STEP_FRACTION = 0.05
"""Standard deviation of the length of a step, as a share of it; over several steps it shrinks."""
LEAST_PARALLAX = 1e-4
"""Radians under which lines of sight count as parallel."""


@dataclass
class CameraTrajectory:
    """Where the camera was at each frame, as the motions from one to the next add up."""

    rotation: list[FloatArray] = field(default_factory=lambda: [np.eye(3)])
    """Of each frame, (3, 3) from the frame of the first."""
    translation: list[FloatArray] = field(default_factory=lambda: [np.zeros(3)])
    """Of each frame, (3,) metres."""

    def append(self, rotation: FloatArray, shift: FloatArray) -> None:
        """Go on: points X of the last frame become `rotation` X + `shift`."""
        self.translation.append(rotation @ self.translation[-1] + shift)
        self.rotation.append(rotation @ self.rotation[-1])

    def motion_since(self, frames: IntArray) -> tuple[FloatArray, FloatArray]:
        """(k, 3, 3) and (k, 3) from earlier frames (k,) to the last one."""
        R = self.rotation[-1] @ np.array([self.rotation[i].T for i in frames.tolist()])
        earlier = np.array([self.translation[i] for i in frames.tolist()])
        return R, self.translation[-1] - (R @ earlier[:, :, None])[:, :, 0]

    def triangulate(
        self,
        camera: Camera,
        frames: IntArray,
        first: Float32Array,
        now: Float32Array,
        pixel_sigma: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Depth of points from where they were seen first and where they are now.

        Args:
            camera: the calibration.
            frames: (k,) in which each was seen first.
            first: (k, 2) pixels there.
            now: (k, 2) pixels in the last frame.
            pixel_sigma: standard deviation of a pixel, each way.

        Returns:
            (k,) metres along the optical axis in the last frame, and their standard
            deviations: NaN where the lines of sight do not meet before the camera.
        """
        if len(frames) == 0:
            return np.zeros(0), np.zeros(0)
        R, t = self.motion_since(frames)
        here = directions(camera, now.astype(np.float64))
        there = (R @ directions(camera, first.astype(np.float64))[:, :, None])[:, :, 0]
        # depth here * here - depth there * there = t, by least squares
        a, b, c = ((u * v).sum(1) for u, v in ((here, here), (here, there), (there, there)))
        p, q = (here * t).sum(1), (there * t).sum(1)
        between = a * c - b * b
        sine = np.sqrt(np.maximum(between, 0.0) / (a * c))
        meet = sine > LEAST_PARALLAX
        depth = (c * p - b * q) / np.where(meet, between, 1.0)
        other = (b * p - a * q) / np.where(meet, between, 1.0)
        angle = np.sqrt(2) * pixel_sigma / camera.fx
        steps = np.maximum(len(self.translation) - 1 - frames, 1)
        share = np.hypot(angle / np.maximum(sine, LEAST_PARALLAX), STEP_FRACTION / np.sqrt(steps))
        known = meet & (depth > 0) & (other > 0)
        return np.where(known, depth, np.nan), np.where(known, depth * share, np.nan)
