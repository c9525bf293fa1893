"""Results of a step, innovations and predicted observations."""

from dataclasses import dataclass
from typing import NamedTuple

from saccade.types import FloatArray, IntArray


class Innovation(NamedTuple):
    """The innovation of one observation."""

    value: FloatArray
    """(2,) observed minus predicted: range and bearing, or map coordinates (see `error_state`)."""
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
    """(k,) number of the landmark in the map for each observation, -1 if it was not used."""
    innovations: FloatArray
    """(k, 2) see `Innovation`; here and below NaN where an observation updated nothing."""
    innovation_covariances: FloatArray
    """(k, 2, 2) before the update."""
    nis: FloatArray
    """(k,) normalized innovations squared."""
    culled: IntArray
    """(g,) landmarks that were removed from the map, by their numbers before this; those behind
    them have moved up, also in `association`."""

    def __repr__(self) -> str:
        x, y, theta = self.pose
        used = int((self.association >= 0).sum())
        return (
            f"StepResult(pose {x:.2f} {y:.2f} m {theta:.3f} rad, "
            f"{used} of {len(self.association)} observations used)"
        )
