"""Tables of tracked points, observations and landmarks: arrays with a row for each item."""

from dataclasses import dataclass, replace

import numpy as np

from saccade.types import BoolArray, Float32Array, FloatArray, IntArray, Keypoints, Table, column
from saccade.visual.optical_flow import ByteArray

FIRST_ID = 2**20
"""More points than are ever detected in a frame."""
AGE_WEIGHT = 1e-3
"""Weight of a landmark's relative age beside its miss rate: it decides between equal rates."""


@dataclass(frozen=True, eq=False)
class TrackedPoints(Table):
    """k points tracked in the current frame."""

    xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels."""
    depth: FloatArray = column()
    """(k,) meters along the optical axis, NaN where unknown."""
    depth_sigma: FloatArray = column()
    """(k,) meters."""
    landmark: IntArray = column(dtype=np.int64)
    """(k,) landmark ids, -1 where the point is no landmark."""
    id: IntArray = column(dtype=np.int64)
    """(k,) ids of the points: `FIRST_ID` times the frame of their detection, and on."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of the drive, -1 where it has none."""
    first_xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels in that frame."""
    size: Float32Array = column(dtype=np.float32)
    """(k,) diameter in pixels in that frame, twice the scale."""
    response: Float32Array = column(dtype=np.float32)
    """(k,) detector response in that frame."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(k, 128) in that frame."""
    reidentified: BoolArray = column(dtype=np.bool_)
    """(k,) whether its observations correct the pose: it was re-identified there as a lost
    landmark, or the motion is measured by wheels."""
    rematch_attempts: IntArray = column(dtype=np.int64)
    """(k,) later frames in which points were detected while it was tracked."""
    rematches: IntArray = column(dtype=np.int64)
    """(k,) those of them in which its descriptor was matched at its tracked position."""

    @property
    def first_frame(self) -> IntArray:
        """(k,) number of the frame in which each was detected."""
        return self.id // FIRST_ID

    @property
    def is_landmark(self) -> BoolArray:
        """(k,) whether each is a landmark."""
        return self.landmark >= 0

    @property
    def landmarks(self) -> "TrackedPoints":
        """Those that are landmarks."""
        return self[self.is_landmark]

    def without_landmarks(self) -> "TrackedPoints":
        """All points, none of them a landmark."""
        none = np.zeros(len(self), np.bool_)
        return replace(self, landmark=np.full(len(self), -1), reidentified=none)

    @property
    def keypoints(self) -> Keypoints:
        """Current positions, with responses and descriptors of the first frame."""
        points = Keypoints.at(self.xy, 1.0)
        return replace(points, response=self.response, descriptors=self.descriptor)

    def near(self, others: "TrackedPoints", radius: float) -> BoolArray:
        """(k,) whether each is less than `radius` pixels from any of the others."""
        if len(self) == 0 or len(others) == 0:
            return np.zeros(len(self), np.bool_)
        squared = np.square(self.xy[:, None] - others.xy).sum(2)
        return np.asarray((squared < radius**2).any(1))


@dataclass(frozen=True, eq=False)
class RangeBearings(Table):
    """k observations in the robot's frame."""

    z: FloatArray = column(2)
    """(k, 2) range over the ground in meters, bearing in radians to the left of ahead."""
    covariance: FloatArray = column(2, 2)
    """(k, 2, 2) of `z`."""
    height: FloatArray = column()
    """(k,) meters above the robot's origin."""


@dataclass(frozen=True, eq=False)
class Landmarks(Table):
    """n landmarks in the order of their rows in the filter."""

    id: IntArray = column(dtype=np.int64)
    """(n,) ascending; never reused."""
    height: FloatArray = column()
    """(n,) meters above the robot's origin."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(n, 128) at the first observation."""
    observations: IntArray = column(dtype=np.int64)
    """(n,) number of frames in which it was observed."""
    missed: IntArray = column(dtype=np.int64)
    """(n,) number of frames in which it was expected in view and not re-identified."""
    last_observed: IntArray = column(dtype=np.int64)
    """(n,) the last frame in which it was observed."""

    def rows(self, ids: IntArray) -> IntArray:
        """(k,) rows of landmark ids (k,), -1 for those that are not in the map."""
        if len(self) == 0:
            return np.full(len(ids), -1)
        rows = np.searchsorted(self.id, ids).clip(0, len(self) - 1)
        return np.where(self.id[rows] == ids, rows, -1)

    def count(self, rows: IntArray, height: FloatArray, frame: int) -> None:
        """Count observations of landmarks (k,) in a frame, and average their heights (k,)."""
        self.observations[rows] += 1
        self.last_observed[rows] = frame
        self.height[rows] += (height - self.height[rows]) / self.observations[rows]

    def least_useful(self, count: int, tracked: IntArray, frame: int) -> IntArray:
        """Rows (count,), ascending, of the landmarks with the highest miss rate.

        Of equal rates those not observed for longest; none of the ids in `tracked`.
        """
        miss_rate = (self.missed + 1) / (self.observations + self.missed + 2)
        score = miss_rate + AGE_WEIGHT * ((frame - self.last_observed) / (frame + 1))
        rows = self.rows(tracked)
        score[rows[rows >= 0]] = -1.0
        return np.sort(np.argsort(-score, kind="stable")[:count])
