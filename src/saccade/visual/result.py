"""Results of visual SLAM."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from saccade.types import FloatArray, IntArray, LandmarkMap, Trajectory
from saccade.visual.optical_flow import ByteArray
from saccade.visual.tables import Table, column


class ObservationKind(IntEnum):
    """How a landmark was observed."""

    INITIALIZED = 0
    TRACKED = 1
    REIDENTIFIED = 2


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkObservations(Table):
    """k observations of landmarks, in the order of the frames."""

    frame: IntArray = column(dtype=np.int64)
    """(k,) number of the frame."""
    landmark: IntArray = column(dtype=np.int64)
    """(k,) id of the landmark."""
    kind: IntArray = column(dtype=np.int64)
    """(k,) `ObservationKind`: 0 where the landmark was initialized, 1 where it was tracked, 2 where
    it was re-identified after it had been lost."""
    xy: FloatArray = column(2)
    """(k, 2) pixels."""
    z: FloatArray = column(2)
    """(k, 2) range in metres, bearing in radians."""
    sigma: FloatArray = column(2)
    """(k, 2) standard deviations of `z`."""
    innovation: FloatArray = column(2)
    """(k, 2) `z` less its prediction; NaN where the filter was not corrected."""
    innovation_covariance: FloatArray = column(2, 2)
    """(k, 2, 2) predicted by the filter; NaN likewise."""

    def __repr__(self) -> str:
        return f"LandmarkObservations({len(self)} of {len(np.unique(self.landmark))} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class VisualResult:
    """Trajectory, map and observations of a drive of n frames."""

    trajectory: Trajectory
    """(n,) poses with covariances, each estimated from the frames up to it."""
    odometry: Trajectory
    """(n,) poses by odometry alone."""
    visual_odometry: Trajectory
    """(n,) poses by egomotion alone; by odometry where the camera measured none."""
    map: LandmarkMap
    """m landmarks at the end."""
    descriptors: ByteArray
    """(m, 128) of the landmarks."""
    height: FloatArray
    """(m,) metres above the robot's origin, of the landmarks."""
    observations: LandmarkObservations
    """Every observation of a landmark."""
    off_plane: FloatArray
    """(n, 3) metres up, radians rolled and pitched since the last frame, by the camera; NaN where
    it measured no motion."""
    missed: int
    """Times that a lost landmark was expected in view and not re-identified."""
    seconds: dict[str, float]
    """Time by step; "read" and "detect" run in parallel to the others."""
    frame_seconds: FloatArray
    """(n,) time of each frame."""
    remarks: tuple[str, ...]
    """What went wrong, in sentences."""

    def __repr__(self) -> str:
        return f"VisualResult({self.trajectory!r}, {self.map!r}, {self.observations!r})"
