"""Which landmark of the map each observation of a scan is of."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from saccade.slam.association import gating
from saccade.slam.association.gating import DROPPED, NEW
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.models import RangeBearing
from saccade.types import FloatArray, IntArray


class Association(Protocol):
    """A rule that says what the observations of a scan are of."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate a scan.

        Args:
            ekf: the filter, predicted to the pose of the scan.
            z: (m, 2) range in metres, bearing in radians.
            R: (m, 2, 2) their covariances.
            identity: (m,) of the landmarks as the log has it, -1 where it does not say.

        Returns:
            (m,) the number of the landmark in the map, `NEW` or `DROPPED`.
        """

    def added(self, landmark: int, identity: int) -> None:
        """Hear that an observation of `identity` became number `landmark` of the map."""


@dataclass
class KnownIdentity:
    """The log says it.

    What has no identity is dropped, and so is the second sighting, in one scan,
    of a landmark that the map does not have yet.
    """

    number: dict[int, int] = field(default_factory=dict)
    """Of each identity seen so far, its landmark in the map."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Look each identity up; see `Association`."""
        names = identity.tolist()
        found = [self.number.get(name, NEW) if name >= 0 else DROPPED for name in names]
        again = [name in names[:i] for i, name in enumerate(names)]
        return np.array(
            [DROPPED if n == NEW and twice else n for n, twice in zip(found, again, strict=True)],
            np.int64,
        )

    def added(self, landmark: int, identity: int) -> None:
        """Remember which landmark it became."""
        self.number[identity] = landmark


def number_by_first_observation(identity: IntArray, pose: IntArray) -> IntArray:
    """What `KnownIdentity` finds in a whole log.

    Args:
        identity: (k,) of the landmarks, -1 where the log does not say.
        pose: (k,) from which each was seen, ascending.

    Returns:
        (k,) number of the landmark in the map, in the order of first sight; `DROPPED` for
        what has no identity or was seen before from the pose that saw it first.
    """
    _, first, which = np.unique(identity, return_index=True, return_inverse=True)
    again = (pose == pose[first[which]]) & (np.arange(len(pose)) != first[which])
    named = np.flatnonzero(identity[first] >= 0)
    number = np.full(len(first), DROPPED, np.int64)
    number[named[np.argsort(first[named])]] = np.arange(len(named))
    return np.where(again, DROPPED, number[which])


@dataclass(frozen=True)
class NearestNeighbor:
    """The nearest landmark within a gate, by Mahalanobis distance.

    Of a scan, each landmark takes at most one observation and each observation
    at most one landmark, the closest pair first. An observation outside the
    larger gate of every landmark is new; what is left over is ambiguous, and so is
    what another landmark, of which the scan shows nothing, is almost as near to.
    """

    gate: float = 0.99
    """Probability with which an observation of a landmark is inside its gate."""
    new_gate: float = 0.9999
    """Probability with which an observation that is not of a new landmark is inside this one."""
    mutual: bool = False
    """Whether a pair must be the nearest for both, so that no second choices are made."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate by distance alone; see `Association`."""
        limit, outer = self.limits
        distance = mahalanobis_squared(ekf, z, R, outer)  # (m, N)
        found = np.empty(len(z), np.int64)
        gating.select_pairs(distance, limit, outer, self.mutual, found)
        return found

    @property
    def limits(self) -> tuple[float, float]:
        """Normalized distances squared at the gates."""
        return chi_square_gate(2, self.gate), chi_square_gate(2, self.new_gate)

    def added(self, landmark: int, identity: int) -> None:
        """Nothing to remember: the map is in the filter."""


def mahalanobis_squared(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, limit: float = np.inf
) -> FloatArray:
    """Normalized innovation squared of every observation with every landmark.

    Args:
        ekf: the filter, with N landmarks.
        z: (m, 2) observations.
        R: (m, 2, 2) their covariances.
        limit: beyond it a distance need not be known.

    Returns:
        (m, N); infinite over the limit and where the innovation covariance is singular.
    """
    expected = ekf.predict_observations()
    if type(ekf.sensor) is RangeBearing:
        distance = np.empty((len(z), len(ekf)))
        gating.mahalanobis_distances(*expected, z, R, limit, distance)
        return distance
    v = ekf.sensor.difference(z[:, None], expected.z)  # (m, N, 2)
    distance = squared_distance(v, expected.covariance + R[:, None])
    return np.where(distance <= limit, distance, np.inf)


def squared_distance(v: FloatArray, S: FloatArray) -> FloatArray:
    """v^T S^-1 v of pairs (..., 2) and covariances (..., 2, 2); infinite where S is singular."""
    a, b, d = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    determinant = a * d - b * b
    square = d * v[..., 0] ** 2 - 2 * b * v[..., 0] * v[..., 1] + a * v[..., 1] ** 2
    regular = determinant > 0
    return np.where(regular, square / np.where(regular, determinant, 1.0), np.inf)
