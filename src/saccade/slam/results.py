"""Results of a step, innovations, and hypotheses of a pose in a known map."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

import numpy.typing as npt

from saccade.errors import LogError
from saccade.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Hypotheses of the robot's pose in a map, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in meters, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,) posterior probabilities; the rest to 1 is that of being outside of the map."""
    association: IntArray
    """(h, k) landmark of each of the k observed points, -1 for none."""

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
"""Meters from the origin at which the estimate has diverged."""


class Innovation(NamedTuple):
    """The innovation of one observation."""

    value: FloatArray
    """(2,) observed minus predicted range and bearing."""
    covariance: FloatArray
    """(2, 2) S of C.12, before the update."""
    nis: float
    """Normalized innovation squared; chi-square with two degrees if the filter is right."""


@dataclass(frozen=True, eq=False, repr=False)
class SlamMap:
    """The landmarks of a map."""

    id: IntArray
    """(n,) ascending; the id of a landmark never changes."""
    label: npt.NDArray[Any]
    """(n,) labels, -1 for those without; if any is text, all are, "" for those without."""
    xy: FloatArray
    """(n, 2) meters."""
    covariance: FloatArray
    """(n, 2, 2) square meters."""

    def __len__(self) -> int:
        return len(self.id)

    def __repr__(self) -> str:
        return f"SlamMap({len(self)} landmarks)"


@dataclass(frozen=True, eq=False, repr=False)
class StepResult:
    """Pose, association and innovations of one step; depends on nothing that comes later."""

    pose: FloatArray
    """(3,) x, y in meters, heading in radians: the mean over the association hypotheses."""
    covariance: FloatArray
    """(3, 3) of the pose, with the differences between the hypotheses."""
    association: IntArray
    """(k,) id of the landmark of each observation, -1 if it was not used; the landmark may be a
    candidate, or culled after this step. While several hypotheses are followed, the ids are those
    of the most probable one."""
    innovations: FloatArray
    """(k, 2) see `Innovation`; here and below NaN where an observation updated nothing."""
    innovation_covariances: FloatArray
    """(k, 2, 2) before the update."""
    nis: FloatArray
    """(k,) normalized innovations squared."""
    rejected: BoolArray
    """(k,) whether the label of each observation contradicted the map and was rejected."""
    culled: IntArray
    """(g,) ids of landmarks and candidates that were removed."""
    lost: bool = False
    """Whether the robot was kidnapped and not found yet: the map is kept as it is, and the pose is
    by odometry until the robot is found in it."""
    hypotheses: PoseHypotheses | None = None
    """Hypotheses of the pose of a lost robot, after its first scan."""
    num_hypotheses: int = 1
    """Number of association hypotheses that are followed after it."""

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
