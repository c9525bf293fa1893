"""Nearest-neighbor data association."""

from dataclasses import dataclass

import numpy as np

from saccade.slam.association._kernels import Gates, select_pairs
from saccade.slam.association.gating import mahalanobis_squared
from saccade.slam.association.rule import Association
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray


@dataclass(frozen=True)
class NearestNeighbor(Association):
    """The nearest landmark within a gate, by Mahalanobis distance.

    Within a scan each landmark is paired with at most one observation and each observation with
    at most one landmark, the closest pair first. An observation outside the larger gate of every
    landmark is new; the others are ambiguous, and so are those to which an unpaired landmark is
    almost as near.
    """

    gate: float = 0.99
    """Probability with which an observation of a landmark is inside its gate."""
    new_gate: float = 0.9999
    """Probability with which an observation that is not of a new landmark is inside this one."""
    mutual: bool = False
    """Whether a pair must be mutually nearest, so that no second choices are made."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate by distance alone; see `Association`."""
        return self.associate(ekf, z, R, identity[:0])

    def associate(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, taken: IntArray) -> IntArray:
        """Associate a scan of which other observations are of the landmarks `taken` (n,)."""
        distance = mahalanobis_squared(ekf, z, R, self.gates.new_gate)  # (m, N)
        paired = np.empty(len(z), np.int64)
        select_pairs(distance, self.gates, taken, ekf.confirmed, paired)
        return paired

    @property
    def gates(self) -> Gates:
        """The gates as squared Mahalanobis distances."""
        return Gates(chi_square_gate(2, self.gate), chi_square_gate(2, self.new_gate), self.mutual)
