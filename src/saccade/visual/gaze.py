"""Gaze control: where a camera that turns looks next.

A policy is a pure function of what the robot believes, of salient places, of the gazes it can
choose from, and of their limits. Directions are in the robot's frame: pan to the left of ahead,
tilt up, in radians.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from saccade.frames import Gaze as Gaze
from saccade.frames import GazeLimits as GazeLimits
from saccade.slam.models import compose
from saccade.types import BoolArray, FloatArray
from saccade.visual.config import EgomotionSource


@dataclass(frozen=True, eq=False)
class Candidates:
    """n gazes to choose from, and the view of each."""

    pan: FloatArray
    """(n,) radians to the left of ahead."""
    tilt: FloatArray
    """(n,) radians up."""
    field_of_view: tuple[float, float]
    """Width and height of the view in radians."""

    def __len__(self) -> int:
        return len(self.pan)


@dataclass(frozen=True, eq=False)
class Belief:
    """What the robot believes, as far as a gaze depends on it: m landmarks in the map's frame."""

    time: float
    """Seconds."""
    pose: FloatArray
    """(3,) x, y in meters, heading in radians."""
    covariance: FloatArray
    """(3, 3) of the pose."""
    velocity: FloatArray
    """(3,) meters ahead and to the left and radians per second, expected over the horizon."""
    gaze: Gaze
    """The present one."""
    points: int
    """Number of points tracked in the present view, landmarks or not."""
    landmarks: FloatArray
    """(m, 2) positions in meters."""
    landmark_covariance: FloatArray
    """(m, 2, 2)."""
    height: FloatArray
    """(m,) meters above the camera."""
    redetection: FloatArray
    """(m,) probability that a landmark in view corrects the pose: it is re-detected, or still
    tracked since it was; 0 for one tracked ever since it was new, which corrects nothing."""
    tracked: BoolArray
    """(m,) whether each is in view and tracked."""
    joint_innovation: FloatArray
    """(2m, 2m) covariance of the predicted ranges and bearings of all, without sensor noise."""
    innovation_given_pose: FloatArray
    """(2m, 2m) the same if the pose were known."""
    viewpoint: FloatArray
    """(m, 2) position of the robot from which each was first observed."""
    egomotion: EgomotionSource = "camera"
    """What measures the motion."""

    def after(self, seconds: float) -> FloatArray:
        """(3,) pose after a time, at the expected velocity."""
        return compose(self.pose, self.velocity * seconds)[0]


@dataclass(frozen=True, eq=False)
class SalientPlaces:
    """p places of the map that attention found, or where it expects something."""

    xy: FloatArray
    """(p, 2) positions in the map's frame, in meters."""
    saliency: FloatArray
    """(p,) in [0, 1]."""
    unattended: FloatArray
    """(p,) seconds since each was last looked at; infinite for never."""
    viewpoint: FloatArray
    """(p, 2) position of the robot from which each was first seen."""

    @classmethod
    def none(cls) -> "SalientPlaces":
        """No places."""
        return cls(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 2)))


Policy: TypeAlias = Callable[[Belief, SalientPlaces, Candidates, GazeLimits], Gaze]
"""`look_where(belief, places, candidates, limits)`: the gaze to turn to."""


def fixed(
    belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
) -> Gaze:
    """Ahead, always."""
    return Gaze(0.0, 0.0, "fixed")


def random_policy(seed: int, dwell: float = 1.0) -> Policy:
    """A policy that draws a candidate every `dwell` seconds."""

    def random(
        belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
    ) -> Gaze:
        rng = np.random.default_rng((seed, int(belief.time / dwell)))
        i = int(rng.integers(len(candidates)))
        return Gaze(float(candidates.pan[i]), float(candidates.tilt[i]), "random")

    return random


def sweep(
    belief: Belief, places: SalientPlaces, candidates: Candidates, limits: GazeLimits
) -> Gaze:
    """To and fro over all candidates, at `SWEEP_RATE`."""
    low, high = float(candidates.pan.min()), float(candidates.pan.max())
    span = max(high - low, 1e-9)
    phase = (SWEEP_RATE * belief.time - low) % (2 * span)
    return Gaze(low + (phase if phase < span else 2 * span - phase), 0.0, "sweep")


SWEEP_RATE = 0.5
"""Radians per second of a sweep, slow enough that points are tracked."""
