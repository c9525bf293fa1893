"""Gaze control in visual SLAM: gathers the belief, asks a policy, and turns the camera."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from saccade.frames import Camera, steps_between
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.models import wrap
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import from_pixels
from saccade.visual.config import EgomotionSource
from saccade.visual.frontend import FrameFeatures
from saccade.visual.gaze import Belief, Candidates, Gaze, GazeLimits, Policy, SalientPlaces
from saccade.visual.selection import sample_saliency
from saccade.visual.tables import TrackedPoints
from saccade.visual.visual_map import VisualMap

LEAVING = 0.15
"""Radians from which a turn leaves so many points behind that new ones are detected before it."""
MAX_LANDMARKS = 60
"""Landmarks of a belief, those least recently observed first."""
STEP = np.radians(20.0)
"""Between candidates, by default."""
SPACING, MIN_SALIENCY, PLACES_PER_FRAME = 1 / 16, 0.3, 8
"""Of the memory of salient places: distance between two, as a fraction of `GazeLimits.max_range`,
and how salient and how many are kept of a frame."""


def pan_candidates(camera: Camera, limits: GazeLimits) -> Candidates:
    """Gazes `STEP` apart over the range of a pan, with ahead among them."""
    low, high = (int(np.ceil(limits.pan[0] / STEP)), int(np.floor(limits.pan[1] / STEP)))
    pan = STEP * np.arange(low, high + 1)
    width = 2 * float(np.arctan(camera.width / 2 / camera.fx))
    height = 2 * float(np.arctan(camera.height / 2 / camera.fy))
    return Candidates(pan, np.zeros(len(pan)), (width, height))


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
        policy: chooses among the candidates.
        candidates: the gazes to choose from.
        limits: of the motion.
        turn: carries a decision out; called with the time in seconds and the gaze.
        interval: seconds between decisions.
    """

    def __init__(
        self,
        policy: Policy,
        candidates: Candidates,
        limits: GazeLimits,
        turn: Callable[[float, Gaze], object],
        interval: float = 0.2,
    ) -> None:
        self._policy, self._candidates, self._limits = policy, candidates, limits
        self._turn, self._interval = turn, interval
        self._places = PlaceMemory(limits.max_range)
        self._viewpoints: dict[int, FloatArray] = {}
        self._last: tuple[float, FloatArray] | None = None
        self._velocity = np.zeros(3)
        self._observed: dict[int, float] = {}
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
        """Update the memory by a frame; decide, and turn the camera if it is time to.

        Args:
            time: of the frame in seconds.
            features: the frame, and the points detected in it, if any.
            visual_map: the map after it.
            tracked: points tracked in it.
            egomotion: what measures the motion.
        """
        pose, present = visual_map.ekf.pose, features.frame.frame.gaze
        if self._last is not None and time > self._last[0]:
            seconds = time - self._last[0]
            self._velocity = steps_between(np.stack([self._last[1], pose]))[0] / seconds
        self._last = time, pose
        for landmark in tracked.landmark[tracked.is_landmark].tolist():
            self._observed[landmark] = time
            self._viewpoints.setdefault(landmark, pose[:2])
        width = self._candidates.field_of_view[0]
        self._places.attend(time, pose, present.pan, width)
        if features.candidates is not None and features.saliency is not None:
            camera, points = visual_map.camera, features.candidates
            saliency = sample_saliency(features.saliency, (camera.height, camera.width), points.xy)
            self._places.add(time, pose, camera, points, saliency)
        previous = self.decisions[-1].time if self.decisions else -np.inf
        if time - previous < self._interval - 1e-6:
            return
        belief = self._belief(time, present, visual_map, tracked, egomotion)
        places = self._places.around(time, pose)
        chosen = self._policy(belief, places, self._candidates, self._limits)
        self.decisions.append(Decision(time, present, chosen))
        self._turn(time, chosen)

    def _belief(
        self,
        time: float,
        gaze: Gaze,
        visual_map: VisualMap,
        tracked: TrackedPoints,
        egomotion: EgomotionSource,
    ) -> Belief:
        ekf, landmarks = visual_map.ekf, visual_map.landmarks
        rows = self._nearby(time, visual_map)
        ids = landmarks.id[rows]
        found, missed = landmarks.observations[rows], landmarks.missed[rows]
        rate = (np.minimum(found, 4) + 1) / (np.minimum(found, 4) + missed + 2)
        own = tracked.landmarks
        is_tracked, corrects = np.isin(ids, own.landmark), own.landmark[own.reidentified]
        rate = np.where(is_tracked, np.isin(ids, corrects), rate)
        joint, given_pose = joint_innovations(ekf, rows)
        pose = ekf.pose
        return Belief(
            time=time,
            pose=pose,
            covariance=ekf.pose_covariance,
            velocity=self._velocity,
            gaze=gaze,
            points=len(tracked),
            landmarks=ekf.landmarks[rows],
            landmark_covariance=ekf.landmark_covariances[rows],
            height=landmarks.height[rows] - visual_map.camera.position[2],
            redetection=rate.astype(np.float64),
            tracked=is_tracked,
            joint_innovation=joint,
            innovation_given_pose=given_pose,
            viewpoint=np.array([self._viewpoints.get(i, pose[:2]) for i in ids.tolist()]).reshape(
                -1, 2
            ),
            egomotion=egomotion,
        )

    def _nearby(self, time: float, visual_map: VisualMap) -> IntArray:
        """Rows of the landmarks near the robot."""
        ekf, ids = visual_map.ekf, visual_map.landmarks.id
        near = np.flatnonzero(np.hypot(*(ekf.landmarks - ekf.pose[:2]).T) < self._limits.max_range)
        seen = np.array([self._observed.get(i, time) for i in ids[near].tolist()])
        return np.sort(near[np.argsort(seen, kind="stable")[:MAX_LANDMARKS]])


def joint_innovations(ekf: EkfSlam, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Covariances (2m, 2m) of the predicted observations of m landmarks, and given the pose."""
    robot = ekf.robot_state
    r, m = len(robot), len(rows)
    if m == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    _, H = ekf.sensor.observe(robot, ekf.landmarks[rows])
    J = np.zeros((m, 2, r + 2 * m))
    J[..., :r] = H[..., :r]
    for k in range(m):
        J[k, :, r + 2 * k : r + 2 * k + 2] = H[k, :, r:]
    P, flat = ekf.marginal(rows), J.reshape(2 * m, r + 2 * m)
    cross = P[r:, :r]
    known = P[r:, r:] - cross @ np.linalg.solve(P[:r, :r] + 1e-12 * np.eye(r), cross.T)
    return flat @ P @ flat.T, flat[:, r:] @ known @ flat[:, r:].T


@dataclass
class PlaceMemory:
    """Salient places of the map, and when each was last looked at: inhibition of return."""

    max_range: float
    """Metres within which places count."""
    xy: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    """(p, 2) metres in the map's frame."""
    saliency: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(p,) in [0, 1]."""
    attended: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(p,) seconds."""
    viewpoint: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    """(p, 2) position of the robot from which each was first seen."""

    def add(
        self,
        time: float,
        pose: FloatArray,
        camera: Camera,
        points: TrackedPoints,
        saliency: FloatArray,
    ) -> None:
        """Add the most salient of k points, with saliencies (k,), that are far from all others."""
        known = np.isfinite(points.depth) & (saliency > MIN_SALIENCY)
        xyz = from_pixels(camera, points.xy.astype(np.float64), np.nan_to_num(points.depth))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        places = pose[:2] + xyz[:, :2] @ np.array([[c, s], [-s, c]])
        known &= np.hypot(*xyz[:, :2].T) < self.max_range
        order = np.argsort(-saliency[known], kind="stable")[:PLACES_PER_FRAME]
        for xy, value in zip(places[known][order], saliency[known][order], strict=True):
            distance = np.hypot(*(self.xy - xy).T)
            if len(distance) and distance.min() < SPACING * self.max_range:
                nearest = int(distance.argmin())
                self.saliency[nearest] = max(self.saliency[nearest], value)
                continue
            self.xy = np.concatenate([self.xy, xy[None]])
            self.saliency = np.append(self.saliency, value)
            self.attended = np.append(self.attended, time)
            self.viewpoint = np.concatenate([self.viewpoint, pose[None, :2]])

    def attend(self, time: float, pose: FloatArray, pan: float, width: float) -> None:
        """Mark the places in a view as looked at."""
        offset = self.xy - pose[:2]
        bearing = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - pose[2] - pan)
        seen = (np.abs(bearing) < width / 2) & (np.hypot(*offset.T) < self.max_range)
        self.attended[seen] = time

    def around(self, time: float, pose: FloatArray) -> SalientPlaces:
        """The places near a pose."""
        near = np.hypot(*(self.xy - pose[:2]).T) < self.max_range
        unattended = time - self.attended[near]
        return SalientPlaces(self.xy[near], self.saliency[near], unattended, self.viewpoint[near])
