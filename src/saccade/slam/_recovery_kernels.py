"""Evidence of a scan that the robot is not where the filter believes."""

from math import atan2, exp, floor, hypot, log, log2, pi, sqrt
from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import predict_observations, squared_distance
from saccade.slam.filter._kernels import wrapped
from saccade.slam.filter._state_kernels import LANDMARKS, FilterState
from saccade.types import BoolArray, FloatArray, IntArray

RANGES, BEARINGS = 64, 16
"""Cells of the sensor's view: quarter octaves of the range from `SHORTEST` on, sectors."""
SHORTEST = 0.1
"""Metres."""
UNTRIED = 10.0
"""Misses that every cell is assumed to have begun with: without experience, no evidence."""
MEMORY = 500.0
"""Expected landmarks in a cell after which its counts are halved, so that they follow changes."""
WRONG_NAME = 0.05
"""Probability that a named observation is not of its landmark."""
CAUTION = 4.0
"""Factor on the covariance of innovations: a filter may be overconfident and still not lost."""
MAX_UNEXPLAINED = 1.5
"""Largest evidence for every observation that is near no landmark."""
MAX_EVIDENCE = 3.0
"""Largest evidence of one scan: its misses have common causes."""
MIN_LANDMARKS = 8
"""Landmarks of a map in which a robot may be lost; in a smaller one it cannot be found again."""
LEFT_OUT, PATIENCE = 1.5, 4.0
"""Evidence of a scan from which it is left out of the filter, and the cumulative evidence that this
takes if the scan has no names: gates protect the filter from most of a single wrong scan."""
TOTAL, LATEST, REACH, SKIPPED = 0, 1, 2, 3
"""Indices into `LostEvidence.values`."""


class LostRule(NamedTuple):
    """When a robot is lost."""

    enabled: bool
    """Whether this is tested at all."""
    limit: float
    """Cumulative evidence (log likelihood ratio) from which it is."""
    gate: float
    """Squared Mahalanobis distance up to which an observation may be of a landmark."""


class LostEvidence(NamedTuple):
    """What was expected and observed so far."""

    expected: FloatArray
    """(RANGES, BEARINGS) landmarks that were predicted in each cell of the view."""
    observed: FloatArray
    """(RANGES, BEARINGS) of these, how many were observed."""
    values: FloatArray
    """(4,) cumulative evidence, that of the latest scan, metres to the most distant landmark
    observed, and 1 if the latest scan was left out."""


@kernel()
def leaves_out(
    f: FilterState,
    evidence: LostEvidence,
    rule: LostRule,
    z: FloatArray,
    R: FloatArray,
    confirmed: BoolArray,
    association: IntArray,
) -> bool:
    """Add the evidence of a scan to the cumulative sum (Page 1954); whether to leave it out.

    Of a scan that is not left out, the landmarks that were expected and observed are counted.
    Only `confirmed` landmarks are expected; of none, all. The association (k,) has the landmarks of
    named observations; others are negative.
    """
    N = f.counts[LANDMARKS]
    evidence.values[LATEST] = evidence.values[SKIPPED] = 0.0
    if N < MIN_LANDMARKS:
        return False
    landmark, cell = np.empty(N, np.int64), np.empty((N, 2), np.int64)
    count = _landmarks_in_view(f, evidence, z, confirmed, landmark, cell)
    landmark = landmark[:count]
    expected, S = np.empty((count, 2)), np.empty((count, 2, 2))
    predict_observations(f, landmark, expected, S)
    density = np.empty((len(z), count))
    _fill_densities(expected, S, z, R, rule.gate, density)
    reach, out_of_view = evidence.values[REACH], 0
    for k in range(len(z)):
        reach = max(reach, z[k, 0])
        if 0 <= association[k] < N:
            out_of_view += 1
            for j in range(count):
                if landmark[j] == association[k]:
                    out_of_view -= 1
                else:
                    density[k, j] = 0.0
    value = _evidence(evidence, cell, density, landmark, association, 2 * pi * reach)
    value -= out_of_view * log(WRONG_NAME)
    values = evidence.values
    values[LATEST] = min(max(value, -MAX_EVIDENCE), MAX_EVIDENCE)
    values[TOTAL] = max(values[TOTAL] + values[LATEST], 0.0)
    if values[LATEST] >= LEFT_OUT and (association.max() >= 0 or values[TOTAL] >= PATIENCE):
        values[SKIPPED] = 1.0
        return True
    for j in range(count):
        observed = False
        for k in range(len(z)):
            observed = observed or density[k, j] > 0
        _count(evidence, cell[j], observed)
        if observed:
            values[REACH] = max(values[REACH], expected[j, 0])
    return False


@kernel()
def _landmarks_in_view(
    f: FilterState,
    evidence: LostEvidence,
    z: FloatArray,
    confirmed: BoolArray,
    landmark: IntArray,
    cell: IntArray,
) -> int:
    """Fill the landmarks as far away as any observation so far, their cells; returns how many."""
    s, r, reach, count = f.state, f.robot_size, evidence.values[REACH], 0
    for k in range(len(z)):
        reach = max(reach, z[k, 0])
    for i in range(f.counts[LANDMARKS]):
        if len(confirmed) > 0 and not confirmed[i]:
            continue
        dx, dy = s[r + 2 * i] - s[0], s[r + 2 * i + 1] - s[1]
        if abs(dx) > reach or abs(dy) > reach:
            continue
        q = hypot(dx, dy)
        if q > reach:
            continue
        landmark[count] = i
        octaves = log2(max(q, SHORTEST) / SHORTEST)
        turn = wrapped(atan2(dy, dx) - s[2]) / (2 * pi) + 0.5
        cell[count, 0] = min(int(4 * octaves), RANGES - 1)
        cell[count, 1] = floor(turn * BEARINGS) % BEARINGS
        count += 1
    return count


@kernel()
def _fill_densities(
    expected: FloatArray,
    S: FloatArray,
    z: FloatArray,
    R: FloatArray,
    gate: float,
    density: FloatArray,
) -> None:
    """Fill the density (k, c) of each observation for each landmark, 0 outside of the gate."""
    for k in range(len(z)):
        for j in range(len(expected)):
            density[k, j] = 0.0
            v, a = z[k, 0] - expected[j, 0], S[j, 0, 0] + R[k, 0, 0]
            if v * v > gate * a:
                continue
            w = wrapped(z[k, 1] - expected[j, 1])
            c, d = S[j, 0, 1] + R[k, 0, 1], S[j, 1, 1] + R[k, 1, 1]
            square = squared_distance(v, w, a, c, d)
            if square <= gate:
                area = 2 * pi * CAUTION * sqrt(a * d - c * c)
                density[k, j] = exp(-square / 2 / CAUTION) / area


@kernel()
def _evidence(
    evidence: LostEvidence,
    cell: IntArray,
    density: FloatArray,
    landmark: IntArray,
    association: IntArray,
    view: float,
) -> float:
    """Log likelihood ratio of a lost robot to one that is not, by densities (k, c).

    A robot that is not lost observes a landmark as often as others in its cell, with the density
    of the filter; a lost one makes the same number of observations anywhere in the view, metres
    times radians.
    """
    total, unexplained = 0.0, 0
    for k in range(len(density)):
        explained = False
        for j in range(density.shape[1]):
            explained = explained or density[k, j] > 0
        unexplained += not explained
    for j in range(density.shape[1]):
        e, o = evidence.expected[cell[j, 0], cell[j, 1]], evidence.observed[cell[j, 0], cell[j, 1]]
        p, named, sum_density = o / (e + UNTRIED), False, 0.0
        for k in range(len(density)):
            named = named or association[k] == landmark[j]
            sum_density += density[k, j]
        if named:
            total -= log(WRONG_NAME + (1 - WRONG_NAME) * view * sum_density)
        else:
            total -= log(1 - p + p * view / len(density) * sum_density)
    return min(total, MAX_UNEXPLAINED * unexplained)


@kernel()
def _count(evidence: LostEvidence, cell: IntArray, observed: bool) -> None:
    """Count a landmark that was expected in a cell (2,)."""
    i, k = cell[0], cell[1]
    if evidence.expected[i, k] >= MEMORY:
        evidence.expected[i, k] /= 2
        evidence.observed[i, k] /= 2
    evidence.expected[i, k] += 1
    evidence.observed[i, k] += observed
