"""Joint compatibility branch and bound (JCBB).

After Neira & Tardos (2001), "Data association in stochastic mapping using the joint
compatibility test": of all pairings of a scan whose innovations are jointly compatible, the one
with the most pairs, and of those the one with the smallest joint distance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from saccade.slam.association._jcbb_kernels import branch_and_bound
from saccade.slam.association._kernels import DROPPED, NEW, drop_ambiguous, pair_mutual
from saccade.slam.association.gating import mahalanobis_squared
from saccade.slam.association.rule import Association
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.results import PredictedObservations
from saccade.types import FloatArray, IntArray


@dataclass(frozen=True)
class JointCompatibility(Association):
    """The largest jointly compatible set of pairs.

    An observation outside the larger gate of every landmark is new; the others without a pair are
    ambiguous, and so are those to which an unpaired landmark is almost as near.
    """

    gate: float = 0.99
    """Probability with which an observation of a landmark is inside its gate, and the correct
    pairs of a scan inside their joint one."""
    new_gate: float = 0.9999
    """Probability with which an observation that is not of a new landmark is inside this one."""
    max_nodes: int = 2000
    """Pairs that are tried for a scan; then the best set so far is accepted."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate a scan; see `Association`."""
        gate, new_gate = (chi_square_gate(2, p) for p in (self.gate, self.new_gate))
        distance = mahalanobis_squared(ekf, z, R, new_gate)  # (m, N)
        outside = distance.min(1, initial=np.inf) > new_gate
        paired = np.empty(len(z), np.int64)
        pair_mutual(distance, gate, paired)
        rows = np.flatnonzero((distance <= gate).any(1))
        if len(rows) > 1:
            columns = np.flatnonzero((distance <= gate).any(0))
            predicted, S = predict_jointly(ekf, columns)
            v = ekf.sensor.difference(z[rows, None], predicted)
            joint_gates = np.array([chdtri(2 * (k + 1), 1 - self.gate) for k in range(len(rows))])
            best = np.full(len(rows), -1)
            gated = distance[np.ix_(rows, columns)]
            branch_and_bound(gated, gate, v, S, R[rows], joint_gates, self.max_nodes, best)
            paired[rows] = np.where(best >= 0, columns[best], DROPPED)
        drop_ambiguous(distance, ekf.confirmed, paired)
        return np.where(outside, NEW, paired).astype(np.int64)


def predict_jointly(ekf: EkfSlam, landmarks: IntArray) -> PredictedObservations:
    """Predicted observations of some landmarks, with their joint covariance.

    Args:
        ekf: the filter.
        landmarks: (c,) their numbers.

    Returns:
        z (c, 2) and its covariance (2c, 2c), without that of the sensor.
    """
    robot = ekf.robot_state
    r, c = len(robot), len(landmarks)
    predicted, H = ekf.sensor.observe(robot, ekf.landmarks[landmarks])
    J = np.zeros((c, 2, r + 2 * c))
    J[..., :r] = H[..., :r]
    for k in range(c):
        J[k, :, r + 2 * k : r + 2 * k + 2] = H[k, :, r:]
    flat = J.reshape(2 * c, r + 2 * c)
    return PredictedObservations(predicted, flat @ ekf.marginal(landmarks) @ flat.T)
