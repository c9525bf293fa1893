"""How far every observation is from every landmark, at the speed of compiled code."""

from math import atan2, hypot, inf, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._kernels import wrapped
from saccade.slam.filter.state import INVARIANT, LANDMARKS, FilterState
from saccade.slam.models import NEAREST
from saccade.types import FloatArray, IntArray

NEW = -1
"""Of no landmark in the map: it may become one."""
DROPPED = -2
"""Ambiguous: near a landmark, but not near enough or not the only one."""
AMBIGUOUS = 3.0
"""An observation is of its landmark if no free one is so near by the normalized distance squared:
it is four times as likely of this one as of any other."""
_SLACK = 1 + 1e-9
"""Rounding must not take a landmark out of reach."""


@kernel()
def predict_observations(
    b: FilterState, kind: int, landmark: IntArray, z: FloatArray, S: FloatArray
) -> None:
    """Fill range and bearing z (c, 2) of landmarks (c,), and S = H P H^T (c, 2, 2)."""
    r, s, a, P = len(b.workspace), b.state, b.heading_lever, b.P
    D, W = np.zeros((2, 5)), np.zeros((2, 5))  # x, y, heading, landmark
    for i in range(len(landmark)):
        m, blocks = r + 2 * landmark[i], b.blocks[landmark[i]]
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = hypot(dx, dy)
        for k in range(2):
            for p in range(5):
                D[k, p] = 0.0
        z[i, 0], z[i, 1] = q, 0.0
        if q > NEAREST:
            z[i, 1] = wrapped(atan2(dy, dx) - s[2])
            D[0, 3], D[0, 4], D[1, 3], D[1, 4] = dx / q, dy / q, -dy / q**2, dx / q**2
            D[1, 2] = -1.0
            for k in range(2):
                D[k, 0], D[k, 1] = -D[k, 3], -D[k, 4]
                if kind == INVARIANT:  # by eta
                    D[k, 2] += D[k, 3] * (a[m] - a[0]) + D[k, 4] * (a[m + 1] - a[1])
        for j in range(2):
            d = D[j]
            for p in range(3):
                W[j, p] = P[p, m] * d[3] + P[p, m + 1] * d[4]
                for o in range(3):
                    W[j, p] += P[p, o] * d[o]
            W[j, 3] = blocks[0] * d[3] + blocks[1] * d[4]
            W[j, 4] = blocks[1] * d[3] + blocks[2] * d[4]
            for p in range(3):
                W[j, 3] += P[p, m] * d[p]
                W[j, 4] += P[p, m + 1] * d[p]
        for j in range(2):
            for k in range(2):
                S[i, j, k] = 0.0
                for p in range(5):
                    S[i, j, k] += D[max(j, k), p] * W[min(j, k), p]


@kernel()
def mahalanobis_distances(
    expected: FloatArray,
    spread: FloatArray,
    z: FloatArray,
    R: FloatArray,
    limit: float,
    distance: FloatArray,
) -> None:
    """Fill the normalized innovations squared (m, c), infinite over the limit.

    Of observations z (m, 2) and R (m, 2, 2), with landmarks as `predict_observations` has them.
    """
    for i in range(len(z)):
        for j in range(len(expected)):
            distance[i, j] = inf
            v = z[i, 0] - expected[j, 0]
            a = spread[j, 0, 0] + R[i, 0, 0]
            if v * v > limit * a:
                continue
            w = wrapped(z[i, 1] - expected[j, 1])
            c, d = spread[j, 0, 1] + R[i, 0, 1], spread[j, 1, 1] + R[i, 1, 1]
            determinant = a * d - c * c
            if w * w <= limit * d and determinant > 0:
                total = (d * v * v - 2 * c * v * w + a * w * w) / determinant
                if total <= limit:
                    distance[i, j] = total


@kernel()
def prefilter_landmarks(
    b: FilterState, z: FloatArray, R: FloatArray, limit: float, landmark: IntArray
) -> int:
    """Fill in the landmarks that may be within `limit` of an observation; gives their number.

    No deviation of a sum is over the sum of the deviations: no pair that is left out could
    have a distance under the limit, but most landmarks are told without their covariance.
    """
    r, s, a, P, count = len(b.workspace), b.state, b.heading_lever, b.P, 0
    here, turn = sqrt(abs(P[0, 0]) + abs(P[1, 1])), sqrt(abs(P[2, 2]))
    first, last, coarse, skew = inf, -inf, 0.0, 0.0
    for k in range(len(z)):
        first, last = min(first, z[k, 0]), max(last, z[k, 0])
        coarse, skew = max(coarse, R[k, 0, 0]), max(skew, R[k, 1, 1])
    gate, noise = sqrt(limit) * _SLACK, sqrt(coarse)
    for i in range(b.counts[LANDMARKS]):
        m = r + 2 * i
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = sqrt(dx * dx + dy * dy)
        lever = abs(a[m] - a[0]) + abs(a[m + 1] - a[1])
        spread = here + sqrt(abs(b.blocks[i, 0]) + abs(b.blocks[i, 2])) + lever * turn
        along = gate * (spread + noise)
        if q - last > along or first - q > along:
            continue
        bearing, across = 0.0, inf
        if q > NEAREST:
            bearing = atan2(dy, dx) - s[2]
            across = gate * sqrt((spread / q + turn) ** 2 + skew)
        for k in range(len(z)):
            if abs(z[k, 0] - q) <= along and abs(wrapped(z[k, 1] - bearing)) <= across:
                landmark[count] = i
                count += 1
                break
    return count


@kernel()
def associate_nearest(
    b: FilterState,
    kind: int,
    z: FloatArray,
    R: FloatArray,
    limit: float,
    outer: float,
    mutual: bool,
    found: IntArray,
) -> None:
    """Fill the landmark of each observation (m,), `NEW` or `DROPPED`, as `NearestNeighbor`."""
    landmark = np.empty(b.counts[LANDMARKS], np.int64)
    landmark = landmark[: prefilter_landmarks(b, z, R, outer, landmark)]
    expected, S = np.empty((len(landmark), 2)), np.empty((len(landmark), 2, 2))
    predict_observations(b, kind, landmark, expected, S)
    distance = np.empty((len(z), len(landmark)))
    mahalanobis_distances(expected, S, z, R, outer, distance)
    select_pairs(distance, limit, outer, mutual, found)
    for i in range(len(z)):
        if found[i] >= 0:
            found[i] = landmark[found[i]]


@kernel()
def select_pairs(
    distance: FloatArray, limit: float, outer: float, mutual: bool, found: IntArray
) -> None:
    """Fill the column of each row (m,) of distances (m, c); `NEW` where all are over `outer`."""
    if mutual:
        pair_mutual(distance, limit, found)
    else:
        pair_nearest_first(distance, limit, found)
    drop_ambiguous(distance, found)
    for i in range(len(distance)):
        new = True
        for j in range(distance.shape[1]):
            new = new and distance[i, j] > outer
        if new:
            found[i] = NEW


@kernel()
def drop_ambiguous(distance: FloatArray, found: IntArray) -> None:
    """Drop pairs of (m, c) that another column, which nothing is paired with, is as good for."""
    taken = np.zeros(distance.shape[1], np.bool_)
    for i in range(len(distance)):
        if found[i] >= 0:
            taken[found[i]] = True
    for i in range(len(distance)):
        own = distance[i, found[i]] if found[i] >= 0 else inf
        for j in range(distance.shape[1]):
            if not taken[j] and distance[i, j] <= own + AMBIGUOUS and found[i] >= 0:
                found[i] = DROPPED


@kernel()
def pair_nearest_first(distance: FloatArray, limit: float, paired: IntArray) -> None:
    """Pair rows with columns of (m, c), the smallest distance first, none twice.

    Pairs over the limit are not made; a row without one is `DROPPED`.
    """
    taken = np.zeros(distance.shape[1], np.bool_)
    paired[:] = DROPPED
    while True:
        least, row, column = inf, -1, -1
        for i in range(len(distance)):
            for j in range(distance.shape[1]):
                if distance[i, j] < least and paired[i] == DROPPED and not taken[j]:
                    least, row, column = distance[i, j], i, j
        if row < 0 or least > limit:
            return
        paired[row] = column
        taken[column] = True


@kernel()
def pair_mutual(distance: FloatArray, limit: float, paired: IntArray) -> None:
    """Pair rows with columns of (m, c) that are the nearest of each other, first come first.

    Pairs over the limit are not made; a row without one is `DROPPED`.
    """
    for i in range(len(distance)):
        paired[i], least, column = DROPPED, limit, -1
        for j in range(distance.shape[1]):
            if distance[i, j] < least or (distance[i, j] == least and column < 0):
                least, column = distance[i, j], j
        for k in range(len(distance) if column >= 0 else 0):
            other = distance[k, column]
            if other < least or (other == least and k < i):
                column = -1
                break
        if column >= 0:
            paired[i] = column
