"""What comes of a drive."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray, IntArray, LandmarkMap, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkObservations:
    """Every sighting of a landmark that went into the map, in the order of the frames."""

    frame: IntArray
    """(k,) number of the frame."""
    landmark: IntArray
    """(k,) number of the landmark."""
    kind: IntArray
    """(k,) 0 where it was taken in, 1 where it was followed, 2 where it was recognized after it
    had been out of sight."""
    xy: FloatArray
    """(k, 2) pixels."""
    z: FloatArray
    """(k, 2) range in metres, bearing in radians."""
    sigma: FloatArray
    """(k, 2) standard deviations of `z`."""
    innovation: FloatArray
    """(k, 2) `z` without what the filter expected; NaN where it corrected nothing."""
    innovation_covariance: FloatArray
    """(k, 2, 2) of them, as the filter expected; likewise."""

    def __len__(self) -> int:
        return len(self.frame)

    def __repr__(self) -> str:
        return f"Meetings({len(self)} of {len(np.unique(self.landmark))} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class VisualResult:
    """Where the robot was, where the landmarks are, and how it came about."""

    trajectory: Trajectory
    """(n,) poses with covariance, each as it was believed at its own time."""
    odometry: Trajectory
    """(n,) poses by odometry alone."""
    visual_odometry: Trajectory
    """(n,) poses by the motion from frame to frame alone; where the camera tells none,
    odometry fills in."""
    map: LandmarkMap
    """Landmarks at the end."""
    descriptors: npt.NDArray[np.uint8]
    """(m, 128) of the landmarks of the map."""
    height: FloatArray
    """(m,) metres above the robot's origin."""
    observations: LandmarkObservations
    """What was seen of which landmark when."""
    tilt: FloatArray
    """(n, 3) what the camera saw of metres up, radians rolled and pitched since the last frame."""
    missed: int
    """Times that a landmark should have been in view, was not followed, and was not recognized."""
    seconds: dict[str, float]
    """Where the time went, by step; frames are read and searched for points beside the rest."""
    frame_seconds: FloatArray
    """(n,) from each frame to the next."""
    remarks: tuple[str, ...]
    """What went wrong on the way, in sentences."""

    def __repr__(self) -> str:
        return f"VisualResult({self.trajectory!r}, {self.map!r}, {self.observations!r})"
