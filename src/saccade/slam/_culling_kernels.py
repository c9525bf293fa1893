"""Confirmation of candidate landmarks and culling of wrong ones, by counts of detections."""

from ctypes import Structure, c_double, c_int64
from math import log2, pi
from typing import NamedTuple

from saccade._jit import kernel, structure
from saccade.slam.association._kernels import DROPPED
from saccade.slam.filter._range_bearing_kernels import expected_observation
from saccade.slam.filter._state_kernels import FilterState
from saccade.types import BoolArray, FloatArray, IntArray

RANGE_BINS, BEARING_BINS = 96, 24
"""Of the detection probability: quarters of an octave of the range from 0.24 mm to 4 km, and
sectors of the bearing."""
CHECKS = 4
"""Checks from one removal of landmarks to the next: a removal costs more than a step."""
UNKNOWN = 4.0
"""Expectations that are added to those of a bin: of a new bin no detection is expected."""


class CullingRule(NamedTuple):
    """When a candidate becomes a landmark, and when either is removed from the map."""

    enabled: bool
    """Whether there are candidates at all; else every landmark is one at once, and stays."""
    confirm_after: int
    """Observations that confirm a candidate."""
    candidate_scans: int
    """Scans without an observation after which a candidate is dropped."""
    min_ratio: float
    """Detections of a landmark, as a fraction of those expected, under which it is culled."""
    max_missed: float
    """Misses that are tolerated before that fraction counts."""
    interval: int
    """Scans from one check of the whole map to the next."""


class Totals(Structure):
    """Numbers of `VisibilityCounts` since the start."""

    _fields_ = (
        ("scans", c_int64),
        ("ambiguous", c_int64),  # observations that may be of several landmarks
        ("dropped", c_int64),  # candidates
        ("culled", c_int64),  # landmarks
        ("reach", c_double),  # largest range that was observed
    )


@structure
class VisibilityCounts:
    """How often each landmark was observed and missed, with room for c of them.

    A detection is expected with the probability with which the confirmed landmarks of the map
    were detected, so far, at the same range and bearing.
    """

    observed: IntArray
    """(c,) observations; 0 until the scan in which it was added has been counted."""
    last_observed: IntArray
    """(c,) number of the scan of the last one."""
    confirmed: BoolArray
    """(c,) whether it is a landmark; else a candidate."""
    detected: FloatArray
    """(c,) checks in which it was observed, without the scan in which it was added."""
    expected: FloatArray
    """(c,) detections that were expected in all checks."""
    predicted: FloatArray
    """(c, 2) predicted range and bearing in the present scan."""
    culled: BoolArray
    """(c,) whether it is to be removed."""
    bin_detected: FloatArray
    """(`RANGE_BINS`, `BEARING_BINS`) detections of confirmed landmarks."""
    bin_expected: FloatArray
    """(`RANGE_BINS`, `BEARING_BINS`) checks of confirmed landmarks."""
    totals: Totals
    """Numbers since the start."""


@kernel()
def bind_counts(
    observed: IntArray,
    last_observed: IntArray,
    confirmed: BoolArray,
    detected: FloatArray,
    expected: FloatArray,
    predicted: FloatArray,
    culled: BoolArray,
    bin_detected: FloatArray,
    bin_expected: FloatArray,
    totals: Totals,
) -> VisibilityCounts:
    """Counts of these fields, see `_jit.share`."""
    return VisibilityCounts(
        observed,
        last_observed,
        confirmed,
        detected,
        expected,
        predicted,
        culled,
        bin_detected,
        bin_expected,
        totals,
    )


@kernel()
def predict_visible(f: FilterState, predicted: FloatArray) -> None:
    """Fill the predicted observation of every landmark, before a scan is processed."""
    for i in range(f.now.landmarks):
        predicted[i, 0], predicted[i, 1] = expected_observation(f, i)


@kernel()
def check_visibility(
    visibility: VisibilityCounts,
    rule: CullingRule,
    check: bool,
    candidates: int,
    landmarks: int,
    association: IntArray,
) -> None:
    """Count the observed landmarks of a scan, and in a check those missed; mark what is culled.

    Landmarks from number `candidates` were added as candidates in this scan; others that are new
    were added by an association rule that does not wait for more observations.
    """
    observed, confirmed, totals = visibility.observed, visibility.confirmed, visibility.totals
    last_observed, predicted, culled = (
        visibility.last_observed,
        visibility.predicted,
        visibility.culled,
    )
    totals.scans += 1
    mapped_before = landmarks
    while mapped_before > 0 and observed[mapped_before - 1] == 0:
        mapped_before -= 1
    for i in range(mapped_before, candidates):
        confirmed[i] = True
    for i in association:
        if i >= 0:
            observed[i] += 1
            last_observed[i] = totals.scans
            confirmed[i] = confirmed[i] or observed[i] >= rule.confirm_after
        elif i == DROPPED:
            totals.ambiguous += 1
    if not check:
        return
    for i in range(mapped_before):
        if predicted[i, 0] <= totals.reach:
            _count_detection(visibility, i)
    if totals.scans % (CHECKS * rule.interval) > 0:
        return
    for i in range(landmarks):
        culled[i] = _is_culled(visibility, rule, i)


@kernel(inline=True)
def _count_detection(visibility: VisibilityCounts, i: int) -> None:
    """Count whether a landmark was detected, and whether that was expected."""
    detected = 1.0 if visibility.last_observed[i] == visibility.totals.scans else 0.0
    row, column = _bin(visibility.predicted[i, 0], visibility.predicted[i, 1])
    hits, checks = visibility.bin_detected, visibility.bin_expected
    visibility.expected[i] += hits[row, column] / (checks[row, column] + UNKNOWN)
    visibility.detected[i] += detected
    if visibility.confirmed[i]:
        hits[row, column] += detected
        checks[row, column] += 1.0


@kernel(inline=True)
def _bin(distance: float, bearing: float) -> tuple[int, int]:
    """Bins of range and bearing; ranges outside are in the first and the last bin."""
    row = int(4 * log2(max(distance, 1e-6)) + RANGE_BINS / 2)
    column = int((bearing / (2 * pi) + 0.5) * BEARING_BINS)
    return min(max(row, 0), RANGE_BINS - 1), column % BEARING_BINS


@kernel(inline=True)
def _is_culled(visibility: VisibilityCounts, rule: CullingRule, i: int) -> bool:
    """Whether a landmark is missed too often, or a candidate is not observed again."""
    if not visibility.confirmed[i]:
        waited = visibility.totals.scans - visibility.last_observed[i]
        return bool(waited > rule.candidate_scans)
    detected, expected = visibility.detected[i], visibility.expected[i]
    return bool(expected - detected > rule.max_missed and detected < rule.min_ratio * expected)
