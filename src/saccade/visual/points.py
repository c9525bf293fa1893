"""Tracked points, their observations and landmarks: tables with a row for each."""

from dataclasses import dataclass, replace

import numpy as np

from saccade.types import BoolArray, Float32Array, FloatArray, IntArray, Keypoints, Table, column
from saccade.visual.optical_flow import ByteArray

FIRST_ID = 2**20
"""Number of point ids reserved for each frame."""


@dataclass(frozen=True, eq=False)
class TrackedPoints(Table):
    """k points tracked in the current frame, with their appearance where they were detected."""

    xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels."""
    depth: FloatArray = column()
    """(k,) meters along the optical axis, NaN where unknown."""
    depth_sigma: FloatArray = column()
    """(k,) meters."""
    landmark: IntArray = column(dtype=np.int64)
    """(k,) landmark ids; -1 for points that are not landmarks."""
    id: IntArray = column(dtype=np.int64)
    """(k,) ids of the points, ascending from `FIRST_ID` times the number of the first frame."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of a drive of tracks; -1 for other drives."""
    first_xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels in the first frame."""
    size: Float32Array = column(dtype=np.float32)
    """(k,) diameters in pixels in the first frame, twice the scale."""
    response: Float32Array = column(dtype=np.float32)
    """(k,) detector responses in the first frame."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(k, 128) descriptors in the first frame."""
    reidentified: BoolArray = column(dtype=np.bool_)
    """(k,) whether observations of the landmark correct the pose: it was re-identified, or the
    motion is measured by wheels."""
    rematch_attempts: IntArray = column(dtype=np.int64)
    """(k,) numbers of detections while the point was tracked."""
    rematches: IntArray = column(dtype=np.int64)
    """(k,) numbers of detections in which its descriptor matched at its tracked position."""

    @property
    def first_frame(self) -> IntArray:
        """(k,) number of the frame in which each point was detected."""
        return self.id // FIRST_ID

    @property
    def is_landmark(self) -> BoolArray:
        """(k,) whether each point is a landmark."""
        return self.landmark >= 0

    @property
    def landmarks(self) -> "TrackedPoints":
        """The points that are landmarks."""
        return self[self.is_landmark]

    def without_landmarks(self) -> "TrackedPoints":
        """The points with their landmark ids removed."""
        none = np.zeros(len(self), np.bool_)
        return replace(self, landmark=np.full(len(self), -1), reidentified=none)

    @property
    def keypoints(self) -> Keypoints:
        """Keypoints at the current positions, with responses and descriptors of the first frame."""
        points = Keypoints.at(self.xy, 1.0)
        return replace(points, response=self.response, descriptors=self.descriptor)

    def near(self, others: "TrackedPoints", radius: float) -> BoolArray:
        """(k,) whether each point is less than `radius` pixels from any of the others."""
        if len(self) == 0 or len(others) == 0:
            return np.zeros(len(self), np.bool_)
        squared = np.square(self.xy[:, None] - others.xy).sum(2)
        return np.asarray((squared < radius**2).any(1))


@dataclass(frozen=True, eq=False)
class RangeBearings(Table):
    """k range-bearing observations in the robot's frame."""

    z: FloatArray = column(2)
    """(k, 2) range over the ground in meters, bearing in radians to the left of ahead."""
    covariance: FloatArray = column(2, 2)
    """(k, 2, 2) covariances of `z`."""
    height: FloatArray = column()
    """(k,) heights above the robot's origin, in meters."""


@dataclass(frozen=True, eq=False)
class Landmarks(Table):
    """n landmarks in the order of their rows in the filter."""

    id: IntArray = column(dtype=np.int64)
    """(n,) ids, ascending; never reused."""
    height: FloatArray = column()
    """(n,) heights above the robot's origin, in meters."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(n, 128) descriptors at the first observation."""
    observations: IntArray = column(dtype=np.int64)
    """(n,) numbers of frames in which each landmark was observed."""
    missed: IntArray = column(dtype=np.int64)
    """(n,) numbers of frames in which each was expected in view and not re-identified."""
    last_observed: IntArray = column(dtype=np.int64)
    """(n,) numbers of the last frames in which each was observed."""
    is_tag: BoolArray = column(dtype=np.bool_)
    """(n,) whether each is a tag, which has no descriptor."""

    def rows(self, ids: IntArray) -> IntArray:
        """(k,) rows of landmark ids (k,); -1 for ids that are not in the map."""
        if len(self) == 0:
            return np.full(len(ids), -1)
        rows = np.searchsorted(self.id, ids).clip(0, len(self) - 1)
        return np.where(self.id[rows] == ids, rows, -1)

    def count(self, rows: IntArray, height: FloatArray, frame: int) -> None:
        """Counts observations of landmarks (k,) in a frame, and averages their heights (k,)."""
        self.observations[rows] += 1
        self.last_observed[rows] = frame
        self.height[rows] += (height - self.height[rows]) / self.observations[rows]

    def least_useful(self, count: int, tracked: IntArray) -> IntArray:
        """Rows (count,), ascending, of the landmarks with the highest miss rate.

        Landmarks with equal rates are ordered by their last observation. The ids in `tracked` are
        excluded.
        """
        miss_rate = (self.missed + 1) / (self.observations + self.missed + 2)
        rows = self.rows(tracked)
        miss_rate[rows[rows >= 0]] = -1.0
        miss_rate[self.is_tag] = -1.0
        return np.sort(np.lexsort((self.last_observed, -miss_rate))[:count])
