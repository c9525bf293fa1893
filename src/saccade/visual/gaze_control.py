"""Gaze in visual SLAM: asks a gazer after each frame, and turns the camera."""

from collections.abc import Callable
from math import atan, pi, radians

import numpy as np

from saccade.frames import Camera, Gaze, GazeLimits
from saccade.gaze import Gazer, Policy, policy_of
from saccade.plane import steps_between
from saccade.types import FloatArray, IntArray
from saccade.visual.config import EgomotionSource
from saccade.visual.frontend import FrameFeatures
from saccade.visual.points import Landmarks, TrackedPoints
from saccade.visual.selection import sample_saliency
from saccade.visual.visual_map import VisualMap

LEAVING = 0.15
"""Least turn in radians before which new points are detected, as it leaves many behind."""
MAX_ASIDE = radians(30)
"""Largest pan of a camera that measures the motion, in radians; beyond, its motion drifts more."""
WHEEL_SIGMA = 0.05, 0.015
"""Standard deviations of distance and turn after a meter by wheels, in meters and radians."""
CAMERA_SIGMA = 0.005, 0.002
"""Standard deviations of distance and turn after a meter by a camera."""


class GazeControl:
    """Decides after each frame where to look next.

    Args:
        policy: policy of the `Gazer`: its name, or a function itself or as module:function.
        camera: camera as mounted, looking ahead.
        limits: limits of the pan.
        turn: function that carries a decision out, of the time in seconds and the gaze.
        seed: seed of the draws of the policy.
        interval: seconds between decisions.
    """

    def __init__(
        self,
        policy: str | Policy,
        camera: Camera,
        limits: GazeLimits,
        turn: Callable[[float, Gaze], object],
        seed: int = 0,
        interval: float = 0.2,
    ) -> None:
        policy_of(policy)  # refuses an unknown one before the first frame
        self._policy, self._camera, self._limits = policy, camera, limits
        self._turn, self._seed, self._interval = turn, seed, interval
        self._gazer: Gazer | None = None
        self._missed = np.zeros((2, 0), np.int64)  # ids of landmarks, and how often each was missed
        self._last: tuple[float, FloatArray] | None = None
        self.decisions: list[Gaze] = []
        self.is_leaving = False
        """Whether the camera is about to leave its present view."""

    def decide(
        self,
        time: float,
        features: FrameFeatures,
        visual_map: VisualMap,
        tracked: TrackedPoints,
        egomotion: EgomotionSource = "camera",
    ) -> None:
        """Record a frame in the gazer; decide and turn the camera if a decision is due."""
        turn = features.frame.frame.turn
        pan_sigma = 0.0 if turn is None else turn.sigma
        gazer = self._gazer = self._gazer or self._make(visual_map, egomotion, pan_sigma)
        pose, own, pan = visual_map.ekf.pose, tracked.landmarks, features.frame.frame.gaze.pan
        gazer.record(pan=pan, labels=own.landmark, missed=self._newly_missed(visual_map.landmarks))
        if features.saliency is not None:
            camera = visual_map.camera
            values = sample_saliency(features.saliency, (camera.height, camera.width), own.xy)
            gazer.salience.update(zip(own.landmark.tolist(), values.tolist(), strict=True))
        step = np.zeros(3)
        if self._last is not None:
            previous, before = self._last
            if time - previous < self._interval - 1e-6:
                return
            per_second = steps_between(np.stack([before, pose]))[0] / (time - previous)
            step = self._interval * per_second
        self._last = time, pose
        look = gazer.next(step[None])
        self.decisions.append(Gaze(look.pan, look.tilt, look.reason))
        self.is_leaving = abs(look.pan - pan) > LEAVING
        self._turn(time, self.decisions[-1])

    def _newly_missed(self, landmarks: Landmarks) -> IntArray:
        """(m,) ids of the landmarks that were missed since the last call."""
        (ids, counts), now = self._missed, landmarks.missed
        before = np.zeros(len(landmarks), np.int64)
        _, kept, old = np.intersect1d(landmarks.id, ids, return_indices=True)
        before[kept] = counts[old]
        self._missed = np.stack([landmarks.id, now])
        return landmarks.id[now > before]

    def _make(self, visual_map: VisualMap, egomotion: EgomotionSource, pan_sigma: float) -> Gazer:
        camera, limits = self._camera, self._limits
        aside = MAX_ASIDE if egomotion == "camera" and self._policy == "active" else pi
        return Gazer(
            visual_map.slam,
            2 * atan(camera.width / 2 / camera.fx),
            min(limits.max_range, visual_map.max_range),
            (max(limits.pan[0], -aside), min(limits.pan[1], aside)),
            limits.rate,
            period=self._interval,
            policy=self._policy,
            seed=self._seed,
            odometry=WHEEL_SIGMA if egomotion == "wheels" else CAMERA_SIGMA,
            pan_sigma=pan_sigma,
            sensor=visual_map.sensor_sigma,
        )
