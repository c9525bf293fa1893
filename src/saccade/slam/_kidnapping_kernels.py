"""Evidence of a scan that the robot is not where the filter believes."""

from ctypes import Structure, c_double
from math import atan2, cos, exp, floor, hypot, inf, log, log2, pi, sin, sqrt

import numpy as np

from saccade._jit import kernel, structure
from saccade.slam.association._kernels import mahalanobis_distances
from saccade.slam.filter._kernels import wrapped
from saccade.slam.filter._range_bearing_kernels import expected_observations
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import BoolArray, FloatArray, IntArray

RANGES = 64
"""Cells of the sensor's view by range: quarter octaves from `SHORTEST` on."""
BEARINGS = 16
"""Cells of the sensor's view by bearing."""
SHORTEST = 0.1
"""Range at which the cells begin, in meters."""
UNTRIED = 10.0
"""Misses that every cell begins with: without experience, no evidence."""
MEMORY = 500.0
"""Expected landmarks in a cell after which its counts are halved, so that they follow changes."""
WRONG_LABEL = 0.05
"""Probability that a labeled observation is not of its landmark."""
SCALE_MEMORY = 200.0
"""Observations over which the normalized innovation squared is averaged."""
MAX_UNEXPLAINED = 1.5
"""Largest evidence of an observation that no landmark explains."""
SCAN_MEMORY = 50.0
"""Scans over which the numbers of unexplained observations and of misses are averaged."""
RAREST = 0.01
"""Least number of unexplained observations, and of squared misses, that is expected in a scan."""
TINY = 1e-9
"""Evidence of a point that has none yet; 0 is that of a free row."""
MAX_OBSERVATIONS = 2.0
"""Observations of an unexplained point that count, however often it is observed."""
POINTS = 32
"""Number of unexplained points that are remembered."""
EVIDENCE = 2
"""Column of the evidence of an unexplained point."""
MAX_EVIDENCE = 3.0
"""Largest evidence of one scan: its misses have common causes."""
MIN_LANDMARKS = 8
"""Size of the smallest map that is tested; in a smaller one a robot cannot be found again."""
MIN_CONTRADICTION = 1.5
"""Evidence of a scan from which it contradicts the believed pose."""
MIN_CUMULATIVE = 4.0
"""Cumulative evidence from which a scan without labels contradicts the believed pose: gates protect
the filter from most of a single wrong scan."""
MIN_CONTRADICTED_LABELS = 3
"""Labels of a scan whose landmarks are not where the filter expects them for the scan to
contradict the believed pose; fewer are rejected one by one."""


class EvidenceScalars(Structure):
    """Numbers of `LandmarkEvidence`."""

    _fields_ = (
        ("total", c_double),  # cumulative evidence
        ("latest", c_double),  # of the latest scan
        ("max_range", c_double),  # meters to the most distant landmark observed
        ("clutter", c_double),  # mean number of unexplained observations in a scan
        ("scale", c_double),  # mean of half the normalized innovation squared
        ("squares", c_double),  # mean of the square of excess misses in a scan
        ("variance", c_double),  # mean of its variance if they were independent
    )


@structure
class LandmarkEvidence:
    """What was expected and observed so far."""

    expected: FloatArray
    """(RANGES, BEARINGS) landmarks that were predicted in each cell of the view."""
    observed: FloatArray
    """(RANGES, BEARINGS) of these, how many were observed."""
    points: FloatArray
    """(POINTS, 3) x, y in meters and the evidence of unexplained points, 0 for free rows."""
    now: EvidenceScalars
    """Numbers that change from scan to scan."""


@kernel()
def bind_evidence(
    expected: FloatArray, observed: FloatArray, points: FloatArray, now: EvidenceScalars
) -> LandmarkEvidence:
    """Evidence of these fields, see `_jit.share`."""
    return LandmarkEvidence(expected, observed, points, now)


@kernel()
def update_evidence(
    f: FilterState,
    evidence: LandmarkEvidence,
    gate: float,
    z: FloatArray,
    R: FloatArray,
    confirmed: BoolArray,
    association: IntArray,
    others: int,
) -> bool:
    """Add the evidence of a scan to the cumulative sum; whether it contradicts the believed pose.

    Of a scan that does not, the landmarks that were expected and observed are counted. Only
    `confirmed` and labeled landmarks are expected, within the gate. The association (k,) has the
    rows of the landmarks of labels; others are negative. The map has `others` that are not in f.
    """
    N, now = f.now.landmarks, evidence.now
    now.latest = 0.0
    if N + others < MIN_LANDMARKS:
        return False
    landmark, cell = np.empty(N, np.int64), np.empty((N, 2), np.int64)
    count = _landmarks_in_view(f, now.max_range, z, confirmed, association, landmark, cell)
    landmark = landmark[:count]
    expected, S = np.empty((count, 2)), np.empty((count, 2, 2))
    expected_observations(f, landmark, expected, S)
    density, least = np.empty((len(z), count)), np.empty(len(z))
    view = 2 * pi * _max_range(now.max_range, z)
    _fill_densities(expected, S, z, R, gate, now.scale, view, density, least)
    for k in range(len(z)):
        if 0 <= association[k] < N:
            for j in range(count):
                if landmark[j] != association[k]:
                    density[k, j] = 0.0
    p, owner = np.empty(count), np.full(count, -1)
    hits, tries = evidence.observed, evidence.expected
    for j in range(count):
        p[j] = hits[cell[j, 0], cell[j, 1]] / (tries[cell[j, 0], cell[j, 1]] + UNTRIED)
    explained = _explained(density, p, owner)
    value = _evidence(evidence, density, p, owner, association, N, view)
    room = np.full(len(z), MAX_UNEXPLAINED)
    rarity = log((now.clutter + _total(p)) / now.clutter)
    for k in range(len(z)):
        if explained[k]:
            room[k] = 0.0
        elif not 0 <= association[k] < N:
            room[k] = min(rarity, MAX_UNEXPLAINED)
    now.latest = max(_limited(f, evidence.points, z, R, gate, room, value), -MAX_EVIDENCE)
    now.total = max(now.total + now.latest, 0.0)
    if now.total == 0.0:
        points = evidence.points
        for i in range(POINTS):
            points[i, EVIDENCE] = 0.0
    labeled, contradictions = 0, 0
    for k in range(len(z)):
        if 0 <= association[k] < N:
            labeled += 1
            contradictions += _total(density[k]) == 0.0
    enough = (
        contradictions >= MIN_CONTRADICTED_LABELS if labeled > 0 else now.total >= MIN_CUMULATIVE
    )
    if now.latest >= MIN_CONTRADICTION and enough:
        return True
    for j in range(count):
        _count(tries, hits, cell[j], owner[j] >= 0)
        if owner[j] >= 0:
            now.max_range = max(now.max_range, z[owner[j], 0])
    _learn(evidence, p, owner, explained, least)
    return False


@kernel(inline=True)
def _explained(density: FloatArray, p: FloatArray, owner: IntArray) -> BoolArray:
    """Fill the observation (c,) of each landmark; returns which observations (k,) have one.

    Each has its likeliest landmark, unless another observation has it that is likelier.
    """
    explained = np.zeros(len(density), np.bool_)
    for k in range(len(density)):
        best, most = -1, 0.0
        for j in range(density.shape[1]):
            if density[k, j] > most:
                best, most = j, density[k, j]
        if best < 0 or (owner[best] >= 0 and density[owner[best], best] >= most):
            continue
        if owner[best] >= 0:
            explained[owner[best]] = False
        owner[best], explained[k] = k, True
    return explained


@kernel(inline=True)
def _learn(
    evidence: LandmarkEvidence,
    p: FloatArray,
    owner: IntArray,
    explained: BoolArray,
    least: FloatArray,
) -> None:
    """Learn from a scan how large innovations are, and how many observations are unexplained."""
    misses, variance, now = 0.0, 0.0, evidence.now
    for j in range(len(p)):
        misses += p[j] - (owner[j] >= 0)
        variance += p[j] * (1 - p[j])
    now.squares += (misses * misses - now.squares) / SCAN_MEMORY
    now.variance += (variance - now.variance) / SCAN_MEMORY
    unexplained = 0
    for k in range(len(explained)):
        if explained[k]:
            now.scale += (least[k] / 2 - now.scale) / SCALE_MEMORY
        else:
            unexplained += 1
    now.scale = max(now.scale, 1.0)
    now.clutter += (unexplained - now.clutter) / SCAN_MEMORY
    now.clutter = max(now.clutter, RAREST)
    now.squares = max(now.squares, RAREST)


@kernel(inline=True)
def _landmarks_in_view(
    f: FilterState,
    farthest: float,
    z: FloatArray,
    confirmed: BoolArray,
    association: IntArray,
    landmark: IntArray,
    cell: IntArray,
) -> int:
    """Fill the landmarks that are labeled, or within the largest range so far, and their cells.

    Returns how many.
    """
    s, r, reach, count = f.state, f.robot_size, _max_range(farthest, z), 0
    for i in range(f.now.landmarks):
        is_labeled = False
        for k in association:
            is_labeled = is_labeled or k == i
        if not confirmed[i] and not is_labeled:
            continue
        dx, dy = s[r + 2 * i] - s[0], s[r + 2 * i + 1] - s[1]
        if max(abs(dx), abs(dy)) > reach and not is_labeled:
            continue
        q = hypot(dx, dy)
        if q > reach and not is_labeled:
            continue
        landmark[count] = i
        octaves = log2(max(q, SHORTEST) / SHORTEST)
        turn = wrapped(atan2(dy, dx) - s[2]) / (2 * pi) + 0.5
        cell[count, 0] = min(int(4 * octaves), RANGES - 1)
        cell[count, 1] = floor(turn * BEARINGS) % BEARINGS
        count += 1
    return count


@kernel(inline=True)
def _fill_densities(
    expected: FloatArray,
    S: FloatArray,
    z: FloatArray,
    R: FloatArray,
    gate: float,
    scale: float,
    view: float,
    density: FloatArray,
    least: FloatArray,
) -> None:
    """Fill the density (k, c) of each observation for each landmark, 0 outside of the gate."""
    mahalanobis_distances(expected, S, z, R, gate, density)
    for k in range(len(z)):
        least[k] = inf
        for j in range(len(expected)):
            square = density[k, j]
            density[k, j] = 0.0
            if square <= gate:
                a, c, d = (
                    S[j, 0, 0] + R[k, 0, 0],
                    S[j, 0, 1] + R[k, 0, 1],
                    S[j, 1, 1] + R[k, 1, 1],
                )
                area = min(2 * pi * scale * sqrt(a * d - c * c), view)
                density[k, j] = exp(-square / 2 / scale) / area
                least[k] = min(least[k], square)


@kernel(inline=True)
def _evidence(
    evidence: LandmarkEvidence,
    density: FloatArray,
    p: FloatArray,
    owner: IntArray,
    association: IntArray,
    landmarks: int,
    view: float,
) -> float:
    """Log likelihood ratio of a lost robot to one that is not, by densities (k, c).

    Each observation of a robot that is not lost is of an expected landmark, with the density of
    the filter, or of something else, anywhere in the view, meters times radians; in proportion to
    how many of both there are in a scan. Those of a lost one are anywhere in the view. Missed
    landmarks count as far as misses were independent so far: what hides one may hide many.
    """
    total, misses, now = 0.0, 0.0, evidence.now
    clutter, expected = now.clutter, _total(p)
    for k in range(len(density)):
        if 0 <= association[k] < landmarks:
            value = -log(WRONG_LABEL + (1 - WRONG_LABEL) * view * _total(density[k]))
        else:
            known = 0.0
            for j in range(len(p)):
                known += p[j] * density[k, j]
            value = -log((clutter + view * known) / (clutter + expected))
        total += min(value, MAX_UNEXPLAINED)
    for j in range(len(p)):
        missed = 1.0 if owner[j] < 0 else 0.0
        misses -= log(1 - p[j]) * (missed - (1 - p[j]))
    return float(total + misses * min(1.0, now.variance / now.squares))


@kernel(inline=True)
def _limited(
    f: FilterState,
    points: FloatArray,
    z: FloatArray,
    R: FloatArray,
    gate: float,
    room: FloatArray,
    value: float,
) -> float:
    """Limit the evidence of a scan by what each of its unexplained points may add (k,).

    A point that is observed again is no new evidence, and a view without any is blocked.
    """
    s = f.state
    row = np.empty(len(z), np.int64)
    for k in range(len(room)):
        if room[k] == 0:
            continue
        x, y = s[0] + z[k, 0] * cos(s[2] + z[k, 1]), s[1] + z[k, 0] * sin(s[2] + z[k, 1])
        variance = R[k, 0, 0] + z[k, 0] * z[k, 0] * R[k, 1, 1]
        least = inf
        for i in range(len(points)):
            square = (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
            if points[i, EVIDENCE] > 0 and square < least:
                row[k], least = i, square
        if least > 2 * gate * variance:
            row[k] = 0
            for i in range(len(points)):
                if points[i, EVIDENCE] < points[row[k], EVIDENCE]:
                    row[k] = i
            points[row[k], EVIDENCE] = TINY
        points[row[k], 0], points[row[k], 1] = x, y
        room[k] = min(room[k], max(MAX_OBSERVATIONS * room[k] - points[row[k], EVIDENCE], 0.0))
    total = _total(room)
    limited = min(value, total, MAX_EVIDENCE)
    if limited > 0:
        for k in range(len(room)):
            if room[k] > 0:
                points[row[k], EVIDENCE] += limited * room[k] / total
    return float(limited)


@kernel(inline=True)
def _count(tries: FloatArray, hits: FloatArray, cell: IntArray, observed: bool) -> None:
    """Count a landmark that was expected in a cell (2,)."""
    i, k = cell[0], cell[1]
    if tries[i, k] >= MEMORY:
        tries[i, k] /= 2
        hits[i, k] /= 2
    tries[i, k] += 1
    hits[i, k] += observed


@kernel()
def _max_range(before: float, z: FloatArray) -> float:
    """Meters to the most distant landmark observed, in the scan z (k, 2) or before."""
    farthest = before
    for k in range(len(z)):
        farthest = max(farthest, z[k, 0])
    return farthest


@kernel()
def _total(values: FloatArray) -> float:
    """Sum of (n,) values, in their order."""
    total = 0.0
    for i in range(len(values)):
        total += values[i]
    return total
