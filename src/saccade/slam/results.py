"""Results of a step, innovations and predicted observations."""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from saccade.errors import LogError
from saccade.slam._step_kernels import StepResults, Steps
from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.slam.hypotheses import PoseHypotheses
from saccade.types import BoolArray, FloatArray, IntArray

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


class PredictedObservations(NamedTuple):
    """Predicted observations of every landmark."""

    z: FloatArray
    """(n, 2)."""
    covariance: FloatArray
    """(n, 2, 2) H P H^T of each, without the noise of an observation."""


@dataclass(frozen=True, eq=False, repr=False)
class StepResult:
    """Pose, association and innovations of one step; depends on nothing that comes later."""

    pose: FloatArray
    """(3,) x, y in metres, heading in radians."""
    covariance: FloatArray
    """(3, 3) of the pose."""
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

    @classmethod
    def of(
        cls,
        s: Steps,
        out: StepResults,
        k: int,
        culled: list[IntArray],
        hypotheses: PoseHypotheses | None,
    ) -> "StepResult":
        """A copy of the first step, of k observations, from the memory of kernels."""
        return cls(
            pose=out.pose[0].copy(),
            covariance=out.covariance[0].copy(),
            association=np.maximum(s.landmark[:k], -1),
            innovations=out.innovations.value[:k].copy(),
            innovation_covariances=out.innovations.covariance[:k].copy(),
            nis=out.innovations.nis[:k].copy(),
            refused=s.refused[:k].copy(),
            culled=culled[0] if culled else np.empty(0, np.int64),
            lost=bool(out.lost[0]),
            hypotheses=hypotheses,
        )

    def __repr__(self) -> str:
        x, y, theta = self.pose
        used = int((self.association >= 0).sum())
        return (
            f"StepResult(pose {x:.2f} {y:.2f} m {theta:.3f} rad, "
            f"{used} of {len(self.association)} observations used{', lost' * self.lost})"
        )


def new_innovations(k: int) -> Innovations:
    """Room for the innovations of so many observations."""
    return Innovations(np.full((k, 2), np.nan), np.full((k, 2, 2), np.nan), np.full(k, np.nan))


def check_diverged(pose: FloatArray, first: int) -> None:
    """Check that no pose (t, 3) diverged; the number of the first is `first`.

    Raises:
        LogError: names the pose.
    """
    for i, (x, y, theta) in enumerate(pose.tolist(), first):
        if not (abs(x) < MAX_COORDINATE and abs(y) < MAX_COORDINATE and isfinite(theta)):
            raise LogError(
                f"pose {i}: expected a position within {MAX_COORDINATE:g} m, found that the "
                "estimate diverged; observations or controls contradict their standard deviations"
            )
