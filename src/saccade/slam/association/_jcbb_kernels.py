"""Joint compatibility branch and bound."""

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray


@kernel()
def branch_and_bound(
    distance: FloatArray,
    gate: float,
    v: FloatArray,
    S: FloatArray,
    R: FloatArray,
    joint_gates: FloatArray,
    max_nodes: int,
    best: IntArray,
) -> None:
    """Depth-first branch and bound over the rows; fills `best` with the column of each.

    Args:
        distance: (m, c) squared Mahalanobis distance of each pair alone.
        gate: largest distance of a pair.
        v: (m, c, 2) innovations.
        S: (2c, 2c) joint covariance of the predicted observations.
        R: (m, 2, 2) noise of the observations.
        joint_gates: (m,) largest joint distance of 1, 2, ... pairs.
        max_nodes: pairs that are tried.
        best: (m,) is filled, -1 where a row stays unpaired.
    """
    m, c = distance.shape
    order = np.empty((m, c), np.int64)  # columns of each row, the nearest first
    for i in range(m):
        order[i] = np.argsort(distance[i])
    next_choice = np.zeros(m, np.int64)  # of each row, an index into `order`; c leaves it unpaired
    chosen, used = np.full(m, -1), np.zeros(c, np.bool_)
    L, white = np.zeros((2 * m, 2 * m)), np.zeros(2 * m)
    total, pairs = np.zeros(m + 1), np.zeros(m + 1, np.int64)
    max_pairs, min_total = 0, np.inf
    tried, i = 0, 0 * m  # no literal: a kernel called with one is compiled for it, too
    while i >= 0:
        if i == m:
            if pairs[m] > max_pairs or (pairs[m] == max_pairs and total[m] < min_total):
                max_pairs, min_total = int(pairs[m]), float(total[m])
                for k in range(m):
                    best[k] = chosen[k]
            i -= 1
            continue
        if chosen[i] >= 0:
            used[chosen[i]] = False
            chosen[i] = -1
        bound = pairs[i] + m - i
        pruned = bound < max_pairs or (bound == max_pairs and total[i] >= min_total)
        if next_choice[i] > c or pruned or tried >= max_nodes:
            next_choice[i] = 0
            i -= 1
            continue
        choice = next_choice[i]
        next_choice[i] += 1
        total[i + 1], pairs[i + 1] = total[i], pairs[i]
        if choice < c:
            j = order[i, choice]
            if distance[i, j] > gate:
                next_choice[i] = c
                continue
            if used[j]:
                continue
            tried += 1
            k = 2 * pairs[i]
            _extend_cholesky(L, white, k, i, j, chosen, v, S, R)
            total[i + 1] += white[k] ** 2 + white[k + 1] ** 2
            if not total[i + 1] <= joint_gates[pairs[i]]:
                continue
            chosen[i], used[j], pairs[i + 1] = j, True, pairs[i] + 1
        i += 1
        if i < m:
            next_choice[i] = 0


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
    """Append the pair of row i and column j to the Cholesky root L of the chosen pairs, at k."""
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
