"""Joint compatibility: a scan is associated as a whole, since its errors hang together.

After Neira & Tardos (2001), "Data association in stochastic mapping using the joint
compatibility test": of all pairings whose innovations are compatible together, the one with
the most pairs, and of those the one with the smallest joint distance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from saccade._jit import kernel
from saccade.slam.association.gating import DROPPED, NEW, drop_ambiguous, pair_mutual
from saccade.slam.association.nearest_neighbor import mahalanobis_squared
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.results import PredictedObservations
from saccade.types import FloatArray, IntArray


@dataclass(frozen=True)
class JointCompatibility:
    """The largest set of pairs that fit together.

    An observation outside the larger gate of every landmark is new; one that no compatible set
    has a place for is ambiguous, and so is what another landmark, of which the scan shows nothing,
    is almost as near to.
    """

    gate: float = 0.99
    """Probability with which an observation of a landmark is inside its gate, and right pairs
    inside theirs together."""
    new_gate: float = 0.9999
    """Probability with which an observation that is not of a new landmark is inside this one."""
    nodes: int = 2000
    """Pairs that are tried for a scan at most; then the best set so far is taken."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate a scan; see `Association`."""
        limit, outer = (chi_square_gate(2, p) for p in (self.gate, self.new_gate))
        distance = mahalanobis_squared(ekf, z, R, outer)  # (m, N)
        outside = distance.min(1, initial=np.inf) > outer
        paired = np.empty(len(z), np.int64)
        pair_mutual(distance, limit, paired)
        rows = np.flatnonzero((distance <= limit).any(1))
        if len(rows) > 1:
            columns = np.flatnonzero((distance <= limit).any(0))
            expected, S = predict_jointly(ekf, columns)
            v = ekf.sensor.difference(z[rows, None], expected)
            gates = np.array([chdtri(2 * (k + 1), 1 - self.gate) for k in range(len(rows))])
            best = np.full(len(rows), -1)
            near = distance[np.ix_(rows, columns)]
            branch_and_bound(near, limit, v, S, R[rows], gates, self.nodes, best)
            paired[rows] = np.where(best >= 0, columns[best], DROPPED)
        drop_ambiguous(distance, paired)
        return np.where(outside, NEW, paired).astype(np.int64)

    def added(self, landmark: int, identity: int) -> None:
        """Nothing to remember: the map is in the filter."""


def predict_jointly(ekf: EkfSlam, landmarks: IntArray) -> PredictedObservations:
    """What should be seen of some landmarks, and how its errors hang together.

    Args:
        ekf: the filter.
        landmarks: (c,) their numbers.

    Returns:
        z (c, 2) and its covariance (2c, 2c), without that of the sensor.
    """
    pose = ekf.state[: len(ekf.state) - 2 * len(ekf)]
    r, c = len(pose), len(landmarks)
    expected, H = ekf.sensor.observe(pose, ekf.landmarks[landmarks])
    J = np.zeros((c, 2, r + 2 * c))
    J[..., :r] = H[..., :r]
    for k in range(c):
        J[k, :, r + 2 * k : r + 2 * k + 2] = H[k, :, r:]
    flat = J.reshape(2 * c, r + 2 * c)
    return PredictedObservations(expected, flat @ ekf.marginal(landmarks) @ flat.T)


@kernel()
def branch_and_bound(
    distance: FloatArray,
    limit: float,
    v: FloatArray,
    S: FloatArray,
    R: FloatArray,
    gates: FloatArray,
    nodes: int,
    best: IntArray,
) -> None:
    """Fill `best` (m,) with the column of each row, -1 for none: branch and bound.

    Args:
        distance: (m, c) of each pair alone; those over the limit are not tried.
        limit: of a pair.
        v: (m, c, 2) innovations.
        S: (2c, 2c) joint covariance of what is expected of the columns.
        R: (m, 2, 2).
        gates: (m,) largest joint distance of 1, 2, ... pairs.
        nodes: pairs that are tried at most.
        best: is filled.
    """
    m, c = distance.shape
    order = np.empty((m, c), np.int64)  # of each row the nearest first, then those too far
    for i in range(m):
        order[i] = np.argsort(distance[i])
    at = np.zeros(m, np.int64)  # which of its choices a row tries next; c is to stay alone
    chosen, taken = np.full(m, -1), np.zeros(c, np.bool_)
    L, white = np.zeros((2 * m, 2 * m)), np.zeros(2 * m)
    total, pairs = np.zeros(m + 1), np.zeros(m + 1, np.int64)
    most, least = 0, np.inf
    tried, i = 0, 0
    while i >= 0:
        if i == m:
            if pairs[m] > most or (pairs[m] == most and total[m] < least):
                most, least = int(pairs[m]), float(total[m])
                best[:] = chosen
            i -= 1
            continue
        if chosen[i] >= 0:
            taken[chosen[i]] = False
            chosen[i] = -1
        hopeless = pairs[i] + m - i < most or (pairs[i] + m - i == most and total[i] >= least)
        if at[i] > c or hopeless or tried >= nodes:
            at[i] = 0
            i -= 1
            continue
        choice = at[i]
        at[i] += 1
        total[i + 1], pairs[i + 1] = total[i], pairs[i]
        if choice < c:
            j = order[i, choice]
            if distance[i, j] > limit:
                at[i] = c
                continue
            if taken[j]:
                continue
            tried += 1
            k = 2 * pairs[i]
            _extend_cholesky(L, white, k, i, j, chosen, v, S, R)
            total[i + 1] += white[k] ** 2 + white[k + 1] ** 2
            if not total[i + 1] <= gates[pairs[i]]:
                continue
            chosen[i], taken[j], pairs[i + 1] = j, True, pairs[i] + 1
        i += 1
        if i < m:
            at[i] = 0


@kernel()
def _extend_cholesky(
    L: FloatArray,
    white: FloatArray,
    k: int,
    i: int,
    j: int,
    chosen: IntArray,
    v: FloatArray,
    S: FloatArray,
    R: FloatArray,
) -> None:
    """Add row i with column j to the Cholesky root L of the chosen rows before it, at k."""
    for half in range(2):
        row, n = k + half, 0
        for p in range(i):
            if chosen[p] >= 0:
                L[row, n] = S[2 * j + half, 2 * chosen[p]]
                L[row, n + 1] = S[2 * j + half, 2 * chosen[p] + 1]
                n += 2
        for q in range(half + 1):
            L[row, k + q] = S[2 * j + half, 2 * j + q] + R[i, half, q]
        for n in range(row + 1):
            for q in range(n):
                L[row, n] -= L[row, q] * L[n, q]
            if n < row:
                L[row, n] /= L[n, n]
        L[row, row] = np.sqrt(L[row, row])
        rest = v[i, j, half]
        for q in range(row):
            rest -= L[row, q] * white[q]
        white[row] = rest / L[row, row]
