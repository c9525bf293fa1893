"""Notes of a drive while it is mapped."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.frames import Drive
from saccade.slam.checkpoint import Arrays, attribute_arrays, merge, restore_attributes, select
from saccade.slam.models import compose
from saccade.types import Float32Array, FloatArray, IntArray, LandmarkMap, Trajectory
from saccade.visual.camera import RangeBearings
from saccade.visual.egomotion import Motion
from saccade.visual.frame_features import FrameFeatures
from saccade.visual.result import LandmarkObservations, VisualResult
from saccade.visual.visual_map import VisualMap

INITIALIZED, TRACKED, REIDENTIFIED = 0, 1, 2
"""Kinds of meetings with landmarks."""
MAX_NAMED = 5
"""Frames that cannot be used are named, at most."""
MAX_CHUNKS = 512
"""Pieces in which meetings are kept, at most."""


@dataclass(eq=False)
class RunLog:
    """What was believed and seen in each frame so far."""

    drive: Drive
    remarks: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    missed: int = 0
    last_visible: int = -1
    """Number of the last frame in which there was something to be seen."""
    _frame_seconds: list[float] = field(default_factory=list)
    _pose: list[FloatArray] = field(default_factory=list)
    _covariance: list[FloatArray] = field(default_factory=list)
    _visual: list[FloatArray] = field(default_factory=list)
    _tilt: list[FloatArray] = field(default_factory=list)
    _observations: list[tuple[npt.NDArray[Any], ...]] = field(default_factory=list)

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Add the time of a block to that of its step."""
        start = perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + perf_counter() - start

    def add_features(self, features: FrameFeatures) -> FrameFeatures:
        """Note how long a frame took that was looked at ahead, and what was wrong with it."""
        for step, seconds in features.seconds.items():
            self.seconds[step] = self.seconds.get(step, 0.0) + seconds
        self.remarks.extend(features.remarks)
        return features

    def _remarks(self) -> tuple[str, ...]:
        """What was wrong with frames: the first of many by name, how many others there are."""
        more = len(self.remarks) - MAX_NAMED
        if more <= 0:
            return tuple(self.remarks)
        return (*self.remarks[:MAX_NAMED], f"{more} more frames could not be used")

    def add_observations(
        self,
        number: int,
        kind: int,
        landmark: IntArray,
        xy: Float32Array,
        seen: RangeBearings,
        innovation: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        """Note k sightings of one frame, and their innovations with covariances if any."""
        k = len(landmark)
        sigma = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
        named = np.full(k, number), landmark, np.full(k, kind)
        innovation = innovation or (np.full((k, 2), np.nan), np.full((k, 2, 2), np.nan))
        self._observations.append((*named, xy.astype(np.float64), seen.z, sigma, *innovation))
        if len(self._observations) == MAX_CHUNKS:
            self._observations = [tuple(self._columns())]

    def add_motion(self, expected: FloatArray, motion: Motion | None) -> None:
        """Note what the camera says of the way to this frame, or else what was expected (3,)."""
        control = expected if motion is None else motion.control
        before = self._visual[-1] if self._visual else self.drive.start
        self._visual.append(compose(before, control)[0])
        self._tilt.append(np.full(3, np.nan) if motion is None else motion.tilt)

    def add_pose(self, pose: FloatArray, covariance: FloatArray, seconds: float) -> None:
        """Note where the robot is, after all that the frame showed, and how long that took."""
        self._frame_seconds.append(seconds)
        self._pose.append(pose)
        self._covariance.append(covariance)

    def result(self, world: VisualMap) -> VisualResult:
        """All of it."""
        time = self.drive.time[: len(self._pose)]
        reckoned = [self.drive.start]
        for control in self.drive.control[: len(time) - 1]:
            reckoned.append(compose(reckoned[-1], control)[0])
        known = world.landmarks
        return VisualResult(
            trajectory=Trajectory(time, np.array(self._pose), np.array(self._covariance)),
            odometry=Trajectory(time, np.array(reckoned)),
            visual_odometry=Trajectory(time, np.array(self._visual)),
            map=LandmarkMap(
                known.id, world.ekf.landmarks, world.landmark_covariances, known.observations
            ),
            descriptors=known.descriptor,
            height=known.height,
            observations=LandmarkObservations(*self._columns()),
            tilt=np.array(self._tilt),
            missed=self.missed,
            seconds=dict(self.seconds),
            frame_seconds=np.array(self._frame_seconds),
            remarks=(*self._remarks(), *world.planarity.remarks()),
        )

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, for a checkpoint."""
        observations = {str(i): column for i, column in enumerate(self._columns())}
        return {**attribute_arrays(self), **merge({"observations": observations})}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        restore_attributes(self, arrays)
        columns = select(arrays, "observations")
        self._observations = [tuple(columns[str(i)] for i in range(len(columns)))]

    def _columns(self) -> list[npt.NDArray[Any]]:
        if not self._observations:
            none = np.zeros(0, np.int64)
            pairs = [np.zeros((0, 2))] * 4
            return [none, none, none, *pairs, np.zeros((0, 2, 2))]
        return [np.concatenate(column) for column in zip(*self._observations, strict=True)]
