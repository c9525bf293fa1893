"""Mahalanobis gating and pairing of observations with landmarks."""

from math import atan2, inf, sqrt
from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._kernels import wrapped
from saccade.slam.filter._range_bearing_kernels import MIN_RANGE, expected_observations
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import BoolArray, FloatArray, IntArray

NEW = -1
"""No landmark of the map is near the observation: it may become one."""
DROPPED = -2
"""Ambiguous: near a landmark, but outside its gate, or not near that one alone."""
AMBIGUITY_MARGIN = 3.0
"""A pair is ambiguous if the squared Mahalanobis distance of the observation from an unpaired
landmark is larger by less than this: the pair is less than four times as likely."""
_SLACK = 1 + 1e-9
"""Factor on gates, so that rounding excludes no landmark."""


class Gates(NamedTuple):
    """Parameters of nearest-neighbor association."""

    gate: float
    """Squared Mahalanobis distance up to which an observation may be paired with a landmark."""
    new_gate: float
    """Squared Mahalanobis distance from every landmark beyond which an observation is new."""
    mutual: bool
    """Whether a pair must be the nearest for both."""


@kernel()
def mahalanobis_distances(
    expected: FloatArray,
    S: FloatArray,
    z: FloatArray,
    R: FloatArray,
    gate: float,
    distance: FloatArray,
) -> None:
    """Fill squared Mahalanobis distances (m, c), infinite over `gate`.

    Of observations z (m, 2) with R (m, 2, 2) from predicted ones, see `expected_observations`.
    """
    for i in range(len(z)):
        for j in range(len(expected)):
            distance[i, j] = inf
            v = z[i, 0] - expected[j, 0]
            a = S[j, 0, 0] + R[i, 0, 0]
            if v * v > gate * a:
                continue
            w = wrapped(z[i, 1] - expected[j, 1])
            c, d = S[j, 0, 1] + R[i, 0, 1], S[j, 1, 1] + R[i, 1, 1]
            if w * w <= gate * d:
                square = squared_distance(v, w, a, c, d)
                if square <= gate:
                    distance[i, j] = square


@kernel()
def squared_distance(v: float, w: float, a: float, c: float, d: float) -> float:
    """Squared Mahalanobis distance of (v, w) by [[a, c], [c, d]]; infinite if that is singular."""
    determinant = a * d - c * c
    return (d * v * v - 2 * c * v * w + a * w * w) / determinant if determinant > 0 else inf


@kernel()
def compare_with_landmarks(
    f: FilterState,
    z: FloatArray,
    R: FloatArray,
    landmark: IntArray,
    nis: FloatArray,
    looseness: FloatArray,
) -> None:
    """Compare each observation (m,) with a landmark, negative for none.

    Fills its normalized innovation squared, and the variance of the prediction over that of the
    observation, the larger of the two.
    """
    which, expected, S = np.zeros(1, np.int64), np.empty((1, 2)), np.empty((1, 2, 2))
    for i in range(len(z)):
        if landmark[i] >= 0:
            which[0] = landmark[i]
            expected_observations(f, which, expected, S)
            v, u = z[i, 0] - expected[0, 0], wrapped(z[i, 1] - expected[0, 1])
            H, N = S[0], R[i]
            a, c, d = H[0, 0] + N[0, 0], H[0, 1] + N[0, 1], H[1, 1] + N[1, 1]
            nis[i] = squared_distance(v, u, a, c, d)
            looseness[i] = max(H[0, 0] / N[0, 0], H[1, 1] / N[1, 1])


@kernel()
def prefilter_landmarks(
    f: FilterState, z: FloatArray, R: FloatArray, gate: float, landmark: IntArray
) -> int:
    """Fill in the landmarks that may be inside the gate of an observation; returns their number.

    The standard deviation of a sum is at most the sum of the standard deviations: this bound
    excludes no pair inside the gate, and most others without their covariance.
    """
    r, s, a, P, blocks, count = f.robot_size, f.state, f.heading_lever, f.P, f.blocks, 0
    position_sigma, heading_sigma = sqrt(abs(P[0, 0]) + abs(P[1, 1])), sqrt(abs(P[2, 2]))
    nearest, farthest, range_variance, bearing_variance = inf, -inf, 0.0, 0.0
    for k in range(len(z)):
        nearest, farthest = min(nearest, z[k, 0]), max(farthest, z[k, 0])
        range_variance = max(range_variance, R[k, 0, 0])
        bearing_variance = max(bearing_variance, R[k, 1, 1])
    radius, range_sigma = sqrt(gate) * _SLACK, sqrt(range_variance)
    for i in range(f.now.landmarks):
        m = r + 2 * i
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = sqrt(dx * dx + dy * dy)
        lever = abs(a[m] - a[0]) + abs(a[m + 1] - a[1])
        sigma = position_sigma + sqrt(abs(blocks[i, 0]) + abs(blocks[i, 2]))
        sigma += lever * heading_sigma
        along = radius * (sigma + range_sigma)
        if q - farthest > along or nearest - q > along:
            continue
        bearing, across = 0.0, inf
        if q > MIN_RANGE:
            bearing = atan2(dy, dx) - s[2]
            across = radius * sqrt((sigma / q + heading_sigma) ** 2 + bearing_variance)
        for k in range(len(z)):
            if abs(z[k, 0] - q) <= along and abs(wrapped(z[k, 1] - bearing)) <= across:
                landmark[count] = i
                count += 1
                break
    return count


@kernel()
def associate_nearest(
    f: FilterState,
    z: FloatArray,
    R: FloatArray,
    gates: Gates,
    taken: IntArray,
    confirmed: BoolArray,
    association: IntArray,
) -> None:
    """Nearest-neighbor association: fill the landmark of each observation, `NEW` or `DROPPED`.

    Other observations of the scan are of the landmarks `taken` (n,), see `select_pairs`. For
    `confirmed`, of all landmarks, see `drop_ambiguous`.
    """
    landmark = np.empty(f.now.landmarks, np.int64)
    landmark = landmark[: prefilter_landmarks(f, z, R, gates.new_gate, landmark)]
    expected, S = np.empty((len(landmark), 2)), np.empty((len(landmark), 2, 2))
    expected_observations(f, landmark, expected, S)
    distance = np.empty((len(z), len(landmark)))
    mahalanobis_distances(expected, S, z, R, gates.new_gate, distance)
    columns, count = np.empty(len(taken), np.int64), 0
    for i in range(len(taken)):
        for j in range(len(landmark)):
            if landmark[j] == taken[i]:
                columns[count] = j
                count += 1
    select_pairs(distance, gates, columns[:count], confirmed[landmark], association)
    for i in range(len(z)):
        if association[i] >= 0:
            association[i] = landmark[association[i]]


@kernel()
def select_pairs(
    distance: FloatArray, gates: Gates, taken: IntArray, confirmed: BoolArray, paired: IntArray
) -> None:
    """Fill the column of each row (m,) of distances (m, c), `NEW` or `DROPPED`.

    What is near a column that is `taken` (n,) is not new, but is not paired with it either.
    """
    for j in taken:
        for i in range(len(distance)):
            if distance[i, j] <= gates.new_gate:
                distance[i, j] = gates.new_gate
    if gates.mutual:
        pair_mutual(distance, gates.gate, paired)
    else:
        pair_nearest_first(distance, gates.gate, paired)
    drop_ambiguous(distance, confirmed, paired)
    for i in range(len(distance)):
        for j in taken:
            if paired[i] == j:
                paired[i] = DROPPED
        new = True
        for j in range(distance.shape[1]):
            new = new and distance[i, j] > gates.new_gate
        if new:
            paired[i] = NEW


@kernel()
def drop_ambiguous(distance: FloatArray, confirmed: BoolArray, paired: IntArray) -> None:
    """Drop pairs of (m, c) for which an unpaired column is almost as near.

    For a pair with a confirmed column (c,), only confirmed ones count: next to a landmark, a
    candidate is most often one of its own observations that was outside of its gate.
    """
    used = np.zeros(distance.shape[1], np.bool_)
    for i in range(len(distance)):
        if paired[i] >= 0:
            used[paired[i]] = True
    for i in range(len(distance)):
        column = paired[i]
        if column < 0:
            continue
        for j in range(distance.shape[1]):
            rival = not used[j] and (confirmed[j] or not confirmed[column])
            if rival and distance[i, j] <= distance[i, column] + AMBIGUITY_MARGIN:
                paired[i] = DROPPED


@kernel()
def pair_nearest_first(distance: FloatArray, gate: float, paired: IntArray) -> None:
    """Pair rows with columns of (m, c) greedily, the smallest distance first, none twice.

    Pairs over the gate are not made; a row without one is `DROPPED`.
    """
    used = np.zeros(distance.shape[1], np.bool_)
    for i in range(len(paired)):
        paired[i] = DROPPED
    while True:
        least, row, column = inf, -1, -1
        for i in range(len(distance)):
            for j in range(distance.shape[1]):
                if distance[i, j] < least and paired[i] == DROPPED and not used[j]:
                    least, row, column = distance[i, j], i, j
        if row < 0 or least > gate:
            return
        paired[row] = column
        used[column] = True


@kernel()
def pair_mutual(distance: FloatArray, gate: float, paired: IntArray) -> None:
    """Pair rows with columns of (m, c) that are mutually nearest; of ties, the first.

    Pairs over the gate are not made; a row without one is `DROPPED`.
    """
    for i in range(len(distance)):
        paired[i], least, column = DROPPED, gate, -1
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
