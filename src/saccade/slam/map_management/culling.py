"""Confirms candidate landmarks that are observed again, and culls landmarks that are missed."""

import numpy as np

from saccade.slam.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management._kernels import (
    AMBIGUOUS,
    BEARING_BINS,
    CULLED,
    FORGOTTEN,
    RANGE_BINS,
    SCANS,
    CullingRule,
    VisibilityCounts,
    check_visibility,
    is_check,
)
from saccade.types import BoolArray, FloatArray, IntArray

MOST = 0.5
"""Fraction of the observations that may be ambiguous without a warning."""
PER_LANDMARK = VisibilityCounts._fields[:7]
"""Fields of `VisibilityCounts` with a row for each landmark."""


class Culling:
    """Counts how often each landmark was observed, and how often missed where one is expected.

    A new landmark is a candidate: it is in the filter, so that no observation of it is lost, but
    not in the map until it was observed often enough, and it is dropped if it is not. A landmark is
    culled if it is observed much less often than landmarks at the same ranges and bearings usually
    are; how often that is, is learnt from the scans so far.

    Args:
        enabled: whether landmarks are doubted at all.
        confirm_after: observations after which a candidate becomes a landmark; 1 for the first.
        candidate_scans: scans without an observation after which it is dropped.
        min_ratio: fraction of the expected detections that a landmark must have; None culls none.
        max_missed: misses that are tolerated before that fraction counts.
        interval: scans from one check of the whole map to the next.
    """

    def __init__(
        self,
        enabled: bool,
        confirm_after: int,
        candidate_scans: int,
        min_ratio: float | None,
        max_missed: float = 5.0,
        interval: int = 4,
    ) -> None:
        self.rule = CullingRule(
            enabled, confirm_after, candidate_scans, min_ratio or 0.0, max_missed, interval
        )
        self.counts = _new_counts(0)

    @property
    def removed(self) -> int:
        """Landmarks that were culled."""
        return int(self.counts.totals[CULLED])

    @property
    def forgotten(self) -> int:
        """Candidates that were dropped."""
        return int(self.counts.totals[FORGOTTEN])

    @property
    def reach(self) -> float:
        """Largest range that was observed so far; minus infinity without any."""
        return float(self.counts.reach[0])

    @property
    def ambiguous(self) -> int:
        """Observations that were dropped because they may be of several landmarks."""
        return int(self.counts.totals[AMBIGUOUS])

    def warning(self, association: IntArray) -> str:
        """Why nothing was mapped, or most observations were not used; empty if neither is so.

        Args:
            association: (k,) landmark of the map for each observation, negative for none.
        """
        observations, rule = len(association), self.rule
        if observations == 0:
            return "nothing is mapped: there are no observations"
        if not rule.enabled:
            return "" if (association >= 0).any() else "no observation names a landmark"
        if self.ambiguous > MOST * observations:
            return (
                f"{self.ambiguous} of {observations} observations are not used: each may be of "
                "several landmarks, which are too close together for the odometry and its noise"
            )
        if (association >= 0).any():
            return ""
        if self.removed > 0:
            return (
                f"nothing is mapped: all of {self.removed} landmarks were culled, as they were "
                "often not observed where landmarks usually are; see culling_ratio"
            )
        return (
            f"nothing is mapped: no candidate was observed {rule.confirm_after} times with at "
            f"most {rule.candidate_scans} scans in between; see confirm_after and candidate_scans"
        )

    def confirmed(self, landmarks: int) -> BoolArray:
        """Which of so many landmarks are confirmed (n,); the others are candidates."""
        if not self.rule.enabled:
            return np.ones(landmarks, np.bool_)
        self.reserve(landmarks)
        return self.counts.confirmed[:landmarks].copy()

    def is_due(self) -> bool:
        """Whether the whole map is checked in the next scan."""
        return self.rule.enabled and is_check(self.counts, self.rule)

    def update(
        self,
        ekf: EkfSlam,
        predicted: FloatArray | None,
        candidates: int,
        reach: float,
        association: IntArray,
    ) -> None:
        """Count the observed and the missed landmarks of a scan; marks those that are culled.

        Args:
            ekf: the filter, after the scan.
            predicted: (n, 2) range and bearing, predicted before it, of the landmarks in the map;
                None if they are not checked.
            candidates: number of the first landmark that was added as a candidate.
            reach: largest range in the scan.
            association: (m,) landmark of each observation, negative for none.
        """
        self.reserve(len(ekf))
        self.reserve(len(ekf))
        self.counts.reach[0] = max(self.counts.reach[0], reach)
        check = predicted is not None
        if predicted is not None:
            self.counts.predicted[: len(predicted)] = predicted
        check_visibility(self.counts, self.rule, check, candidates, len(ekf), association)

    def reserve(self, landmarks: int) -> None:
        """Make room for a map of so many landmarks."""
        if landmarks > len(self.counts.culled):
            old, new = self.counts, _new_counts(landmarks)
            for name in PER_LANDMARK:
                getattr(new, name)[: len(old.culled)] = getattr(old, name)
            self.counts = new._replace(
                bin_detected=old.bin_detected,
                bin_expected=old.bin_expected,
                reach=old.reach,
                totals=old.totals,
            )

    def add_confirmed(self, first: int, count: int) -> None:
        """Count landmarks from number `first` on as confirmed, as those of another map are."""
        self.reserve(first + count)
        self.counts.confirmed[first : first + count] = True
        self.counts.observed[first : first + count] = self.rule.confirm_after
        self.counts.last_observed[first : first + count] = self.counts.totals[SCANS]

    def join(self, kept: int, removed: int) -> None:
        """Count the observations of two landmarks as those of the first; the second is not removed.

        A check in which one of them was observed expected one detection, not two.
        """
        counts = self.counts
        counts.observed[kept] += counts.observed[removed]
        counts.confirmed[kept] |= counts.confirmed[removed]
        counts.detected[kept] += counts.detected[removed]
        both = counts.last_observed, counts.expected
        for each in both:
            each[kept] = max(each[kept], each[removed])

    def remove_culled(self, others: IntArray) -> IntArray:
        """Remove the counts of the landmarks that are to be culled, and of others.

        Args:
            others: (n,) landmarks that are removed for other reasons.

        Returns:
            (k,) all of them.
        """
        counts = self.counts
        if len(others) == 0 and not counts.culled.any():
            return others
        culled = np.union1d(np.flatnonzero(counts.culled), others)
        if len(culled) > 0 and len(counts.culled) > 0:
            confirmed = int(counts.confirmed[culled].sum())
            kept = np.delete(np.arange(len(counts.culled)), culled)
            counts.totals[CULLED] += confirmed
            counts.totals[FORGOTTEN] += len(culled) - confirmed
            for name in PER_LANDMARK:
                array = getattr(counts, name)
                array[: len(kept)] = array[kept]
                array[len(kept) :] = 0
        return culled

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return self.counts._asdict()

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.counts = VisibilityCounts(**arrays)


def _new_counts(capacity: int) -> VisibilityCounts:
    return VisibilityCounts(
        observed=np.zeros(capacity, np.int64),
        last_observed=np.zeros(capacity, np.int64),
        confirmed=np.zeros(capacity, np.bool_),
        detected=np.zeros(capacity),
        expected=np.zeros(capacity),
        predicted=np.zeros((capacity, 2)),
        culled=np.zeros(capacity, np.bool_),
        bin_detected=np.zeros((RANGE_BINS, BEARING_BINS)),
        bin_expected=np.zeros((RANGE_BINS, BEARING_BINS)),
        reach=np.full(1, -np.inf),
        totals=np.zeros(4, np.int64),
    )
