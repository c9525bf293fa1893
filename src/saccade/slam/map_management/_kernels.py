"""Confirmation of candidate landmarks, and counts for culling."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.association._kernels import pair_nearest_first, squared_distance
from saccade.slam.filter._range_bearing_kernels import expected_observation
from saccade.slam.filter._state_kernels import LANDMARKS, FilterState
from saccade.types import BoolArray, FloatArray, IntArray


class CandidateBuffer(NamedTuple):
    """Candidate landmarks, with room for c of them."""

    xy: FloatArray
    """(c, 2) metres in the frame of the map."""
    covariance: FloatArray
    """(c, 2, 2) square metres, of the sensor's noise alone."""
    observations: IntArray
    """(c,) number of observations."""
    last_observed: FloatArray
    """(c,) time of the last observation."""
    kept: BoolArray
    """(c,) scratch: whether `_compact` keeps it."""
    length: IntArray
    """(1,) candidates in use."""


class ConfirmationPolicy(NamedTuple):
    """When a candidate becomes a landmark, and when it is dropped."""

    confirm_after: int
    """Observations that confirm a candidate."""
    timeout: float
    """Time without an observation after which it is dropped."""
    gate: float
    """Squared Mahalanobis distance within which an observation is of a candidate."""


class FieldOfView(NamedTuple):
    """The part of a sensor's field of view in which it reliably detects landmarks."""

    max_range: float
    """Metres."""
    left: float
    right: float
    """Bearings in radians, left > right."""


class CullingRule(NamedTuple):
    """When a landmark is removed from the map."""

    enabled: bool
    """Whether landmarks are culled at all."""
    field_of_view: FieldOfView
    min_ratio: float
    """Fraction of the checks in which a landmark was in view that it must have been observed."""
    max_missed: int
    """Misses that are tolerated before that fraction counts."""
    interval: int
    """Poses from one check of the whole map to the next."""


class VisibilityCounts(NamedTuple):
    """How often each landmark was observed and missed, with room for c of them."""

    observed: IntArray
    """(c,) scans in which it was observed."""
    missed: IntArray
    """(c,) checks in which it was in view and not observed."""
    expected: FloatArray
    """(c, 2) predicted range and bearing in the present scan."""
    mapped_before: IntArray
    """(1,) landmarks in the map before the present scan."""
    culled: BoolArray
    """(c,) whether it is to be removed."""


@kernel()
def confirm(
    candidates: CandidateBuffer,
    policy: ConfirmationPolicy,
    xy: FloatArray,
    covariance: FloatArray,
    time: float,
    confirmed: BoolArray,
) -> None:
    """Fill whether observations at xy (m, 2) with covariance (m, 2, 2) confirm a candidate (m,)."""
    if policy.confirm_after <= 1:
        for i in range(len(xy)):
            confirmed[i] = True
        return
    if len(xy) == 0:
        return
    for j in range(candidates.length[0]):
        candidates.kept[j] = time - candidates.last_observed[j] <= policy.timeout
    _compact(candidates)
    paired = np.empty(len(xy), np.int64)
    pair_nearest_first(_distances(candidates, xy, covariance), policy.gate, paired)
    for i in range(len(xy)):
        j, times = paired[i], 1
        if j < 0:
            j = candidates.length[0]
            candidates.length[0] += 1
        else:
            times = candidates.observations[j] + 1
        candidates.xy[j] = xy[i]
        candidates.covariance[j] = covariance[i]
        candidates.observations[j], candidates.last_observed[j] = times, time
        confirmed[i] = times >= policy.confirm_after
    for j in range(candidates.length[0]):
        candidates.kept[j] = candidates.observations[j] < policy.confirm_after
    _compact(candidates)


@kernel()
def _distances(candidates: CandidateBuffer, xy: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared Mahalanobis distances (m, c) of observations from candidates."""
    distance = np.empty((len(xy), candidates.length[0]))
    for i in range(len(xy)):
        for j in range(candidates.length[0]):
            v, w = xy[i, 0] - candidates.xy[j, 0], xy[i, 1] - candidates.xy[j, 1]
            C, D = covariance[i], candidates.covariance[j]
            a, c, d = C[0, 0] + D[0, 0], C[0, 1] + D[0, 1], C[1, 1] + D[1, 1]
            distance[i, j] = squared_distance(v, w, a, c, d)
    return distance


@kernel()
def _compact(candidates: CandidateBuffer) -> None:
    """Drop the candidates that are not `kept`."""
    j = 0
    for i in range(candidates.length[0]):
        if candidates.kept[i]:
            candidates.xy[j] = candidates.xy[i]
            candidates.covariance[j] = candidates.covariance[i]
            candidates.observations[j] = candidates.observations[i]
            candidates.last_observed[j] = candidates.last_observed[i]
            j += 1
    candidates.length[0] = j


@kernel()
def predict_visible(f: FilterState, visibility: VisibilityCounts) -> None:
    """Fill the predicted observation of every landmark, before a scan is processed."""
    for i in range(f.counts[LANDMARKS]):
        visibility.expected[i, 0], visibility.expected[i, 1] = expected_observation(f, i)
    visibility.mapped_before[0] = f.counts[LANDMARKS]


@kernel()
def check_visibility(
    visibility: VisibilityCounts, rule: CullingRule, landmarks: int, association: IntArray
) -> bool:
    """Count observed and missed landmarks of a scan; returns whether any is to be culled."""
    observed, missed = visibility.observed, visibility.missed
    expected, mapped_before = visibility.expected, visibility.mapped_before[0]
    for i in range(mapped_before):
        missed[i] += _in_view(rule.field_of_view, expected[i])
    for i in association:
        if i >= 0:
            observed[i] += 1
            if i < mapped_before:
                missed[i] -= _in_view(rule.field_of_view, expected[i])
    any_culled = False
    for i in range(landmarks):
        required = rule.min_ratio * (observed[i] + missed[i])
        visibility.culled[i] = missed[i] > rule.max_missed and observed[i] < required
        any_culled = any_culled or visibility.culled[i]
    return any_culled


@kernel()
def _in_view(view: FieldOfView, z: FloatArray) -> bool:
    """Whether range and bearing z (2,) are in the field of view."""
    return bool(z[0] < view.max_range and view.right < z[1] < view.left)
