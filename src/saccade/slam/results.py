"""Results of a step, innovations, and hypotheses of a pose in a known map."""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from saccade.errors import LogError
from saccade.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Hypotheses of the robot's pose in a map, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in metres, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,) posterior probabilities; the rest to 1 is that of being outside of the map."""
    association: IntArray
    """(h, k) row of the landmark of each of the k observed points, -1 for none."""

    def __len__(self) -> int:
        return len(self.pose)

    def __repr__(self) -> str:
        if len(self) == 0:
            return "PoseHypotheses(none)"
        x, y, theta = self.pose[0]
        return (
            f"PoseHypotheses({len(self)}, first {x:.2f} {y:.2f} m {theta:.3f} rad "
            f"with {self.probability[0]:.3f})"
        )


MAX_COORDINATE = 1e9
"""Metres from the origin at which the estimate has diverged."""


class Innovation(NamedTuple):
    """The innovation of one observation."""

    value: FloatArray
    """(2,) observed minus predicted range and bearing."""
    covariance: FloatArray
    """(2, 2) S of C.12, before the update."""
    nis: float
    """Normalized innovation squared; chi-square with two degrees if the filter is right."""


@dataclass(frozen=True, eq=False, repr=False)
class StepResult:
    """Pose, association and innovations of one step; depends on nothing that comes later."""

    pose: FloatArray
    """(3,) x, y in metres, heading in radians: the mean over the association hypotheses."""
    covariance: FloatArray
    """(3, 3) of the pose, with the differences between the hypotheses."""
    association: IntArray
    """(k,) number of the landmark in the filter for each observation, -1 if it was not used; it
    may be a candidate (see `Slam.confirmed`)."""
    innovations: FloatArray
    """(k, 2) see `Innovation`; here and below NaN where an observation updated nothing."""
    innovation_covariances: FloatArray
    """(k, 2, 2) before the update."""
    nis: FloatArray
    """(k,) normalized innovations squared."""
    refused: BoolArray
    """(k,) whether the landmark name of each observation contradicted the map and was refused."""
    culled: IntArray
    """(g,) landmarks that were removed from the map, by their numbers before this; those behind
    them have moved up, also in `association`."""
    lost: bool = False
    """Whether the robot finds itself lost: the map is kept as it is, and the pose is by odometry
    until the robot is found in it."""
    hypotheses: PoseHypotheses | None = None
    """Of the pose of a lost robot, after its first scan."""
    num_hypotheses: int = 1
    """Association hypotheses that are followed after it."""

    def __repr__(self) -> str:
        x, y, theta = self.pose
        used = int((self.association >= 0).sum())
        return (
            f"StepResult(pose {x:.2f} {y:.2f} m {theta:.3f} rad, "
            f"{used} of {len(self.association)} observations used{', lost' * self.lost})"
        )


def check_diverged(pose: FloatArray, number: int) -> None:
    """Check that a pose (3,) did not diverge.

    Raises:
        LogError: names the pose by its number.
    """
    x, y, theta = pose.tolist()
    if not (abs(x) < MAX_COORDINATE and abs(y) < MAX_COORDINATE and isfinite(theta)):
        raise LogError(
            f"pose {number}: expected a position within {MAX_COORDINATE:g} m, found that the "
            "estimate diverged; observations or controls contradict their standard deviations"
        )
