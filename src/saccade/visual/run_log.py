"""Log of a run, from which its result is made."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from saccade.frames import Drive
from saccade.slam.checkpoint import Arrays, attribute_arrays, merge, restore_attributes, select
from saccade.slam.models import compose
from saccade.types import FloatArray, LandmarkMap, Trajectory
from saccade.visual.egomotion import Motion
from saccade.visual.frame_features import FrameFeatures
from saccade.visual.result import LandmarkObservations, ObservationKind, VisualResult
from saccade.visual.tables import RangeBearings, TrackedPoints
from saccade.visual.visual_map import VisualMap

MAX_REMARKS = 5
"""Remarks on frames that are given in full; the others are counted."""
MAX_TABLES = 512
"""Tables of observations before they are joined."""


@dataclass(eq=False)
class RunLog:
    """Poses, motions and observations of each frame so far."""

    drive: Drive
    remarks: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    missed: int = 0
    last_visible: int | None = None
    """Number of the last frame that was not blank."""
    _frame_seconds: list[float] = field(default_factory=list)
    _pose: list[FloatArray] = field(default_factory=list)
    _covariance: list[FloatArray] = field(default_factory=list)
    _observations: list[LandmarkObservations] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._visual_pose = [compose(self.drive.start, np.zeros(3))[0]]
        self._off_plane = [np.full(3, np.nan)]

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Add the time of a block to that of its step."""
        start = perf_counter()
        try:
            yield
        finally:
            self._add_seconds(step, perf_counter() - start)

    def _add_seconds(self, step: str, seconds: float) -> None:
        self.seconds[step] = self.seconds.get(step, 0.0) + seconds

    def add_features(self, features: FrameFeatures) -> None:
        """Log times and remarks of a frame's features."""
        for step, seconds in features.seconds.items():
            self._add_seconds(step, seconds)
        self.remarks.extend(features.remarks)

    def add_observations(
        self,
        number: int,
        kind: ObservationKind,
        points: TrackedPoints,
        observations: RangeBearings,
        innovation: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        """Log k observations in a frame, with innovations and their covariances if there are."""
        k = len(points)
        values, covariances = innovation or (np.full((k, 2), np.nan), np.full((k, 2, 2), np.nan))
        table = LandmarkObservations(
            frame=np.full(k, number),
            landmark=points.landmark,
            kind=np.full(k, kind),
            xy=points.xy.astype(np.float64),
            z=observations.z,
            sigma=np.sqrt(np.diagonal(observations.covariance, axis1=1, axis2=2)),
            innovation=values,
            innovation_covariance=covariances,
        )
        self._observations.append(table)
        if len(self._observations) == MAX_TABLES:
            self._observations = [LandmarkObservations.concatenate(self._observations)]

    def add_motion(self, expected: FloatArray, motion: Motion | None) -> None:
        """Log the motion to the next frame by the camera, or else the expected control (3,)."""
        control = expected if motion is None else motion.control
        self._visual_pose.append(compose(self._visual_pose[-1], control)[0])
        self._off_plane.append(np.full(3, np.nan) if motion is None else motion.off_plane)

    def add_pose(self, pose: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Log the pose at a frame, after all updates, and how long the frame took."""
        self._frame_seconds.append(seconds)
        self._pose.append(pose)
        self._covariance.append(covariance)

    def result(self, visual_map: VisualMap) -> VisualResult:
        """The result of the frames so far."""
        time = self.drive.time[: len(self._pose)]
        odometry = [self.drive.start]
        for control in self.drive.control[: len(time) - 1]:
            odometry.append(compose(odometry[-1], control)[0])
        landmarks, ekf = visual_map.landmarks, visual_map.ekf
        covariances = visual_map.landmark_covariances
        more = len(self.remarks) - MAX_REMARKS
        others = [f"{more} more frames could not be used"] if more > 0 else []
        return VisualResult(
            trajectory=Trajectory(time, np.array(self._pose), np.array(self._covariance)),
            odometry=Trajectory(time, np.array(odometry)),
            visual_odometry=Trajectory(time, np.array(self._visual_pose)),
            map=LandmarkMap(landmarks.id, ekf.landmarks, covariances, landmarks.observations),
            descriptors=landmarks.descriptor,
            height=landmarks.height,
            observations=self._all_observations(),
            off_plane=np.array(self._off_plane),
            missed=self.missed,
            seconds=dict(self.seconds),
            frame_seconds=np.array(self._frame_seconds),
            remarks=(*self.remarks[:MAX_REMARKS], *others, *visual_map.planarity.remarks()),
        )

    def to_arrays(self) -> Arrays:
        """The state as named arrays, for a checkpoint."""
        observations = attribute_arrays(self._all_observations())
        return {**attribute_arrays(self), **merge({"observations": observations})}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`."""
        restore_attributes(self, arrays)
        self._observations = [LandmarkObservations(**select(arrays, "observations"))]

    def _all_observations(self) -> LandmarkObservations:
        return LandmarkObservations.concatenate([LandmarkObservations(), *self._observations])
