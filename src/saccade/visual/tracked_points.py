"""Points tracked in the present frame: landmarks, and candidates for landmarks."""

from dataclasses import dataclass, replace

import numpy as np

from saccade.types import Float32Array, FloatArray, IntArray, Keypoints
from saccade.visual.optical_flow import BoolArray, ByteArray
from saccade.visual.table import Table, column


@dataclass(frozen=True, eq=False)
class TrackedPoints(Table):
    """k points tracked in the present frame."""

    xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels."""
    depth: FloatArray = column()
    """(k,) metres along the optical axis, NaN where unknown."""
    depth_sigma: FloatArray = column()
    """(k,) metres."""
    landmark: IntArray = column(dtype=np.int64)
    """(k,) landmark ids, -1 where the point is no landmark."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of the sequence; -1 where it gives none."""
    first_frame: IntArray = column(dtype=np.int64)
    """(k,) number of the frame in which the point was detected."""
    first_xy: Float32Array = column(2, dtype=np.float32)
    """(k, 2) pixels in that frame."""
    response: Float32Array = column(dtype=np.float32)
    """(k,) detector response in that frame."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(k, 128) in that frame."""
    reidentified: BoolArray = column(dtype=np.bool_)
    """(k,) whether it was re-identified there, as a landmark that had been lost."""
    rematch_attempts: IntArray = column(dtype=np.int64)
    """(k,) detections since, in which it could be re-matched by its descriptor."""
    rematches: IntArray = column(dtype=np.int64)
    """(k,) those in which it was re-matched at its tracked position."""

    @property
    def is_landmark(self) -> BoolArray:
        """(k,) which are landmarks."""
        return self.landmark >= 0

    @property
    def landmarks(self) -> "TrackedPoints":
        """Those that are landmarks."""
        return self[self.is_landmark]

    @property
    def keypoints(self) -> Keypoints:
        """Present positions with the responses and descriptors of the first frame."""
        points = Keypoints.at(self.xy, 1.0)
        return replace(points, response=self.response, descriptors=self.descriptor)

    def near(self, others: "TrackedPoints", radius: float) -> BoolArray:
        """(k,) which are less than `radius` pixels from any of other points."""
        if len(self) == 0 or len(others) == 0:
            return np.zeros(len(self), np.bool_)
        squared = np.square(self.xy[:, None] - others.xy).sum(2)
        return np.asarray((squared < radius**2).any(1))
