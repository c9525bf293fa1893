"""Gaze in visual SLAM: asks a gazer after each frame, and turns the camera."""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, pi

import numpy as np

from saccade.frames import Camera, Gaze, GazeLimits, steps_between
from saccade.gaze import Gazer, Policy
from saccade.types import FloatArray
from saccade.visual.config import EgomotionSource
from saccade.visual.frontend import FrameFeatures
from saccade.visual.selection import sample_saliency
from saccade.visual.tables import TrackedPoints
from saccade.visual.visual_map import VisualMap

LEAVING = 0.15
"""Radians from which a turn leaves so many points behind that new ones are detected before it."""
SIDEWAYS = 15.0
"""Variance of the motion where the camera that measures it looks across, over that where it looks
along it, less 1."""
ODOMETRY: dict[EgomotionSource, tuple[float, float]] = {
    "wheels": (0.05, 0.015),
    "camera": (0.005, 0.002),
    "second-camera": (0.005, 0.002),
}
"""Standard deviations of distance and turn after a metre, by what measures the motion."""


@dataclass(frozen=True)
class Decision:
    """A gaze that was decided on, and what was known then."""

    time: float
    """Seconds."""
    present: Gaze
    """Where the camera looked."""
    chosen: Gaze
    """Where it shall look, and why."""


class GazeControl:
    """Decides after each frame where to look next.

    Args:
        policy: of the `Gazer`: a name, or a function from the gazer to a pan.
        camera: whose width is seen; as mounted, it looks ahead.
        limits: of the motion.
        turn: carries a decision out; called with the time in seconds and the gaze.
        seed: of what the policy draws.
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
        self._policy, self._camera, self._limits = policy, camera, limits
        self._turn, self._seed, self._interval = turn, seed, interval
        self._gazer: Gazer | None = None
        self._last: tuple[float, FloatArray] | None = None
        self._salience: dict[object, float] = {}
        self.decisions: list[Decision] = []

    @property
    def is_leaving(self) -> bool:
        """Whether the camera is about to leave its present view."""
        if not self.decisions:
            return False
        last = self.decisions[-1]
        return abs(last.chosen.pan - last.present.pan) > LEAVING

    def decide(
        self,
        time: float,
        features: FrameFeatures,
        visual_map: VisualMap,
        tracked: TrackedPoints,
        egomotion: EgomotionSource = "camera",
    ) -> None:
        """Tell the gazer what a frame shows; decide, and turn the camera if it is time to.

        Args:
            time: of the frame in seconds.
            features: the frame, and the points detected in it, if any.
            visual_map: the map after it.
            tracked: points tracked in it.
            egomotion: what measures the motion.
        """
        turn = features.frame.frame.turn
        pan_sigma = 0.0 if turn is None else turn.sigma
        gazer = self._gazer = self._gazer or self._make(visual_map, egomotion, pan_sigma)
        pose, present, own = visual_map.ekf.pose, features.frame.frame.gaze, tracked.landmarks
        gazer.observed(present.pan, own.landmark)
        if features.saliency is not None:
            camera = visual_map.camera
            values = sample_saliency(features.saliency, (camera.height, camera.width), own.xy)
            self._salience.update(zip(own.landmark.tolist(), values.tolist(), strict=True))
        previous = self.decisions[-1].time if self.decisions else -np.inf
        if time - previous < self._interval - 1e-6:
            return
        step = np.zeros(3)
        if self._last is not None:
            per_second = steps_between(np.stack([self._last[1], pose]))[0] / (time - self._last[0])
            step = self._interval * per_second
        self._last = time, pose
        look = gazer.next(step[None], self._salience)
        chosen = Gaze(look.pan, look.tilt, look.reason)
        self.decisions.append(Decision(time, present, chosen))
        self._turn(time, chosen)

    def _make(self, visual_map: VisualMap, egomotion: EgomotionSource, pan_sigma: float) -> Gazer:
        camera, limits = self._camera, self._limits
        return Gazer(
            visual_map.slam,
            2 * atan(camera.width / 2 / camera.fx),
            limits.max_range,
            (max(limits.pan[0], -pi), min(limits.pan[1], pi)),
            limits.rate,
            period=self._interval,
            policy=self._policy,
            seed=self._seed,
            odometry=ODOMETRY[egomotion],
            drift=drift if egomotion == "camera" else None,
            pan_sigma=pan_sigma,
        )


def drift(pan: FloatArray) -> FloatArray:
    """Factors (c,) on the covariance of the motion that a camera measures, by its pan.

    Ahead, what is confused with a turn is a step to the side, which wheels hardly make; to the
    side, it is an advance.
    """
    return np.asarray(1 + SIDEWAYS * np.sin(pan) ** 4)
