"""The most probable joint associations of a scan."""

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray


@kernel()
def best_assignments(
    first: IntArray,
    landmark: IntArray,
    v: FloatArray,
    S: FloatArray,
    noise: FloatArray,
    huber: float,
    new_cost: float,
    window: float,
    max_nodes: int,
    cost: FloatArray,
    pair: IntArray,
) -> None:
    """Depth-first branch and bound over the rows of a scan; fills the best assignments, in order.

    The cost of an assignment is minus twice its log-likelihood, up to a constant: the joint squared
    Mahalanobis distance of its pairs, plus the log ratio of the determinants of their covariance
    and of the noise, plus `new_cost` for each row without a pair. The distance of each pair, given
    the pairs before it, has Huber's loss, as in the filter.

    Args:
        first: (m + 1,) row i may have the pairs first[i] to first[i + 1].
        landmark: (p,) of each pair, from 0 on; no two pairs of an assignment have the same.
        v: (p, 2) innovations.
        S: (2p, 2p) their joint covariance.
        noise: (p,) log determinant of the covariance of the observation.
        huber: root of the squared distance of a pair beyond which it costs Huber's loss.
        new_cost: of a row without a pair.
        window: largest cost of an assignment above the cost of the best one.
        max_nodes: pairs that are tried.
        cost: (k,) is filled; infinite where there are fewer assignments.
        pair: (k, m) is filled; -1 for none.
    """
    m = len(first) - 1
    for k in range(len(cost)):
        cost[k] = np.inf
        for i in range(m):
            pair[k, i] = -1
    next_pair, chosen, landmarks = np.empty(m, np.int64), np.full(m, -1), 0
    for i in range(m):
        next_pair[i] = first[i]
    for p in range(len(landmark)):
        landmarks = max(landmarks, landmark[p] + 1)
    used = np.zeros(landmarks, np.bool_)
    L, white = np.zeros((2 * m, 2 * m)), np.zeros(2 * m)
    total, pairs = np.zeros(m + 1), np.zeros(m + 1, np.int64)
    tried, i = 0, 0 * m  # no literal: a kernel called with one is compiled for it, too
    while i >= 0:
        if i == m:
            _insert(cost, pair, total[m], chosen)
            i -= 1
            continue
        if chosen[i] >= 0:
            used[landmark[chosen[i]]] = False
            chosen[i] = -1
        pruned = total[i] > cost[0] + window or total[i] >= cost[-1] or tried >= max_nodes
        if next_pair[i] > first[i + 1] or pruned:
            next_pair[i] = first[i]
            i -= 1
            continue
        p = next_pair[i]
        next_pair[i] += 1
        total[i + 1], pairs[i + 1] = total[i] + new_cost, pairs[i]
        if p < first[i + 1]:
            if used[landmark[p]]:
                continue
            tried += 1
            pair_cost = _pair_cost(L, white, 2 * pairs[i], i, p, chosen, v, S, noise, huber)
            total[i + 1] = total[i] + pair_cost
            if not total[i + 1] <= cost[0] + window:
                continue
            chosen[i], used[landmark[p]], pairs[i + 1] = p, True, pairs[i] + 1
        i += 1
        if i < m:
            next_pair[i] = first[i]


@kernel()
def _insert(cost: FloatArray, pair: IntArray, total: float, chosen: IntArray) -> None:
    """Inserts an assignment in the order of costs, if there is room."""
    if total >= cost[-1]:
        return
    k = len(cost) - 1
    while k > 0 and cost[k - 1] > total:
        cost[k] = cost[k - 1]
        for i in range(len(chosen)):
            pair[k, i] = pair[k - 1, i]
        k -= 1
    cost[k] = total
    for i in range(len(chosen)):
        pair[k, i] = chosen[i]


@kernel()
def _pair_cost(
    L: FloatArray,
    white: FloatArray,
    k: int,
    i: int,
    p: int,
    chosen: IntArray,
    v: FloatArray,
    S: FloatArray,
    noise: FloatArray,
    huber: float,
) -> float:
    """Appends pair p of row i to the Cholesky root L of the chosen pairs; returns its cost."""
    log_determinant = -noise[p]
    for half in range(2):
        row, n = k + half, 0
        for o in range(i):
            if chosen[o] >= 0:
                L[row, n] = S[2 * p + half, 2 * chosen[o]]
                L[row, n + 1] = S[2 * p + half, 2 * chosen[o] + 1]
                n += 2
        for q in range(half + 1):
            L[row, k + q] = S[2 * p + half, 2 * p + q]
        for n in range(row + 1):
            for q in range(n):
                L[row, n] -= L[row, q] * L[n, q]
            if n < row:
                L[row, n] /= L[n, n]
        if not L[row, row] > 0:
            return np.inf
        L[row, row] = np.sqrt(L[row, row])
        log_determinant += 2 * np.log(L[row, row])
        rest = v[p, half]
        for q in range(row):
            rest -= L[row, q] * white[q]
        white[row] = rest / L[row, row]
    square = white[k] * white[k] + white[k + 1] * white[k + 1]
    if square > huber * huber:
        square = 2 * huber * np.sqrt(square) - huber * huber
    return float(square + max(log_determinant, 0.0))
