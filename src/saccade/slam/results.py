"""Results of a step, innovations, and hypotheses of a pose in a known map."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal

import numpy.typing as npt

from saccade.errors import LogError
from saccade.pictured import Pictured
from saccade.slam.consistency import Consistency
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkMap, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class PoseHypotheses:
    """Hypotheses of the robot's pose in a map, the most probable first."""

    pose: FloatArray
    """(h, 3) x, y in meters, heading in radians."""
    covariance: FloatArray
    """(h, 3, 3)."""
    probability: FloatArray
    """(h,) posterior probabilities; the rest to 1 is the probability of a pose outside the map."""
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
"""Largest coordinate of a pose in meters; beyond it the estimate has diverged."""
MAX_POSE_VARIANCE = 1e36
"""Largest variance of a position in square meters: products of larger ones overflow."""


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
    """(k,) id of the landmark of each observation, -1 if it was not used, in the most probable
    hypothesis; the landmark may be a candidate, or culled after this step."""
    innovations: FloatArray
    """(k, 2) see `Innovations`; NaN for a missing range or bearing. Here and below, NaN where an
    observation updated nothing."""
    innovation_covariances: FloatArray
    """(k, 2, 2) before the update."""
    nis: FloatArray
    """(k,) normalized innovations squared."""
    rejected: BoolArray
    """(k,) whether the label of each observation contradicted the map and was rejected."""
    culled: IntArray
    """(g,) ids of landmarks and candidates that were removed."""
    lost: bool = False
    """Whether the robot is kidnapped: until it is relocalized, the map does not change, and the
    pose is dead reckoning."""
    hypotheses: PoseHypotheses | None = None
    """Hypotheses of the pose of a lost robot, after its first scan."""

    def __repr__(self) -> str:
        x, y, theta = self.pose
        used = int((self.association >= 0).sum())
        return (
            f"StepResult(pose {x:.2f} {y:.2f} m {theta:.3f} rad, "
            f"{used} of {len(self.association)} observations used{', lost' * self.lost})"
        )


MAX_NONLINEARITY = 0.12
"""Largest `SlamResult.nonlinearity` of consistent filters in simulated worlds."""


@dataclass(frozen=True, eq=False, repr=False)
class SlamResult(Pictured):
    """Trajectory, map and consistency of a log."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, see `estimate`."""
    filtered: Trajectory
    """(t + 1) poses with covariance of the filter, each the estimate at its own time."""
    map: LandmarkMap
    """Landmarks with covariance: smoothed, or as in the filter at the end of the log."""
    ids: IntArray
    """(n,) ids of the landmarks of the map, as in `Slam.map`."""
    consistency: Consistency
    """Normalized innovations squared of the filter, and whether they agree with its covariances."""
    association: IntArray
    """(k,) row of the landmark in the map for each observation, -1 if it was not used."""
    innovation: FloatArray
    """(k, 2) of each observation in the filter (see `Innovations`); NaN where the NIS is."""
    innovation_covariance: FloatArray
    """(k, 2, 2) before the update."""
    dead_reckoning: Trajectory
    """(t + 1) poses from the controls alone, with covariance."""
    rejected: BoolArray
    """(k,) whether the label of each observation contradicted the map and was rejected."""
    estimate: Literal["smoothed", "filtered"] = "filtered"
    """Kind of the trajectory and the map: "smoothed" over the whole log, or "filtered"."""
    removed: int = 0
    """Landmarks that were culled."""
    warning: str = ""
    """Reason why the map is empty or may be wrong, or why most observations were not used; else
    empty."""
    remark: str = ""
    """Reason why the log is not smoothed; empty if it is, or if smoothing is switched off."""
    odometry_bias: FloatArray | None = None
    """(3,) estimated odometry biases: relative error of the distance, turn in radians per meter of
    distance, distance in meters per radian of turn, true minus measured. None if not estimated."""
    bias_covariance: FloatArray | None = None
    """(3, 3) their covariance."""
    weight: FloatArray | None = None
    """(k,) robust weight of each observation in the smoothing, from 0 to 1; NaN where it was not
    used. None without smoothing."""
    range_errors: FloatArray | None = None
    """(2,) estimated systematic errors of the ranges: relative error, and offset in meters; None if
    they are not estimated."""
    range_error_covariance: FloatArray | None = None
    """(2, 2) its covariance."""
    scale_disagreement: tuple[float, float] | None = None
    """Fraction by which ranges are longer than expected from odometry, and its standard deviation;
    None if the two are not estimated."""
    nonlinearity: float = 0.0
    """Root of the mean fraction of second-order terms in the variance of the innovations; above
    `MAX_NONLINEARITY` the filter is overconfident. Zero for the standard filter."""
    lost: BoolArray | None = None
    """(t + 1,) whether the robot is kidnapped at each pose, from the first scan that contradicts
    the filter. In a step it is lost once the evidence suffices, and dead reckoning then."""
    corrections: FloatArray | None = None
    """(t + 1, 3) displacement by which labels corrected each pose, in the frame of the robot, as
    after a slip of the odometry; zero for most."""
    session: IntArray | None = None
    """(n,) session in which each landmark of the map was added, from 0, see `Slam.load`."""

    def __repr__(self) -> str:
        return (
            f"SlamResult({self.estimate}, {self.trajectory!r}, {self.map!r}, {self.consistency!r})"
        )


def check_diverged(pose: FloatArray, covariance: FloatArray, number: int) -> None:
    """Checks that a pose (3,) and its covariance (3, 3) did not diverge.

    Raises:
        LogError: names the pose by its number.
    """
    x, y, theta = pose.tolist()
    is_near = abs(x) < MAX_COORDINATE and abs(y) < MAX_COORDINATE
    is_known = covariance[0, 0] < MAX_POSE_VARIANCE and covariance[1, 1] < MAX_POSE_VARIANCE
    if not (is_near and is_known and isfinite(theta)):
        raise LogError(
            f"pose {number}: expected a position within {MAX_COORDINATE:g} m, found that the "
            "estimate diverged; observations or controls contradict their standard deviations"
        )
