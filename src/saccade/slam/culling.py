"""Confirms candidate landmarks that are observed again, and culls landmarks that are missed."""

import numpy as np

from saccade._jit import share
from saccade.slam._culling_kernels import (
    BEARING_BINS,
    RANGE_BINS,
    CullingRule,
    Totals,
    VisibilityCounts,
    bind_counts,
    check_visibility,
    predict_visible,
)
from saccade.slam.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import scalars
from saccade.types import BoolArray, FloatArray, IntArray

MAX_AMBIGUOUS = 0.5
"""Fraction of the observations that may be ambiguous without a warning."""
PER_LANDMARK = (
    *("observed", "last_observed", "confirmed", "detected", "expected", "predicted", "culled"),
)
"""Fields of `VisibilityCounts` with a row for each landmark."""
BINS = ("bin_detected", "bin_expected")
TOTALS = tuple(name for name, _ in Totals._fields_)


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
        self._whole = _new_counts(0, Totals(reach=-np.inf))
        self._local: VisibilityCounts | None = None
        self._numbers = np.empty(0, np.int64)  # in the map, of the rows of the local counts

    @property
    def counts(self) -> VisibilityCounts:
        """The counts of the whole map, up to date."""
        if self._local is not None:
            for name in PER_LANDMARK:
                getattr(self._whole, name)[self._numbers] = getattr(self._local, name)
            self._local = None
        return self._whole

    @property
    def in_view(self) -> VisibilityCounts:
        """The counts of the part of the map in which the filter works."""
        return self._whole if self._local is None else self._local

    def enter(self, numbers: IntArray) -> None:
        """Work on the counts of these landmarks (k,), with their numbers there, until `counts`."""
        whole = self.counts
        self._numbers = numbers
        arrays = (getattr(whole, name)[numbers] for name in PER_LANDMARK)
        bins = whole.bin_detected, whole.bin_expected
        self._local = share(bind_counts, *arrays, *bins, whole.totals)

    def has_local_room(self, landmarks: int) -> bool:
        """Whether it works on the counts of a part of the map, with room for so many landmarks."""
        return self._local is not None and landmarks <= len(self._local.culled)

    @property
    def removed(self) -> int:
        """Landmarks that were culled."""
        return int(self._whole.totals.culled)

    @property
    def forgotten(self) -> int:
        """Candidates that were dropped."""
        return int(self._whole.totals.dropped)

    @property
    def reach(self) -> float:
        """Largest range that was observed so far; minus infinity without any."""
        return float(self._whole.totals.reach)

    @property
    def ambiguous(self) -> int:
        """Observations that were dropped because they may be of several landmarks."""
        return int(self._whole.totals.ambiguous)

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
        if self.ambiguous > MAX_AMBIGUOUS * observations:
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
        return self.rule.enabled and (self._whole.totals.scans + 1) % self.rule.interval == 0

    def add_reach(self, reach: float) -> None:
        """Note the largest range of a scan."""
        totals = self._whole.totals
        totals.reach = max(totals.reach, reach)

    def predict_visible(self, ekf: EkfSlam, z: FloatArray, *, may_cull: bool) -> bool:
        """Predict the observations of all landmarks in view if missed ones are counted in a scan.

        Args:
            ekf: the filter, before the update by the scan.
            z: (k, 2) the scan.
            may_cull: whether there may be a landmark to cull.

        Returns:
            Whether missed landmarks are counted.
        """
        self.add_reach(max(z[:, 0].tolist()))
        if not (self.is_due() and may_cull):
            return False
        if ekf.models.observes_ranges:
            predict_visible(ekf.view, self.in_view.predicted)
        else:
            self.in_view.predicted[: len(ekf)] = ekf.predict_observations().z
        return True

    def count_scan(
        self, ekf: EkfSlam, check: bool, candidates: int, association: IntArray
    ) -> IntArray:
        """Count the observed and the missed landmarks of a scan.

        Args:
            ekf: the filter, after the scan.
            check: whether those missed are counted, by their predicted observations.
            candidates: number of the first landmark that was added as a candidate.
            association: (m,) landmark of each observation, negative for none.

        Returns:
            (g,) landmarks that are to be culled.
        """
        landmarks = ekf.view.now.landmarks
        outside = len(ekf) - landmarks
        self.update(check, candidates - outside, landmarks, ekf.to_view(association))
        return ekf.from_view(np.flatnonzero(self.in_view.culled)) if check else association[:0]

    def update(self, check: bool, candidates: int, landmarks: int, association: IntArray) -> None:
        """See `count_scan`; with numbers of the landmarks in view."""
        if self.rule.enabled:
            counts = self.in_view
            check_visibility(counts, self.rule, check, candidates, landmarks, association)

    def keep(self, landmarks: IntArray) -> None:
        """Do not cull these landmarks (k,)."""
        self.counts.culled[landmarks] = False

    def reserve(self, landmarks: int) -> None:
        """Make room for a map of so many landmarks."""
        old = self.counts
        if landmarks > len(old.culled):
            new = _new_counts(max(landmarks, 2 * len(old.culled)), old.totals)
            for name in PER_LANDMARK:
                getattr(new, name)[: len(old.culled)] = getattr(old, name)
            new.bin_detected[:], new.bin_expected[:] = old.bin_detected, old.bin_expected
            self._whole = new

    def add_confirmed(self, first: int, count: int) -> None:
        """Count landmarks from number `first` on as confirmed, as those of another map are."""
        self.reserve(first + count)
        counts, rows = self.counts, slice(first, first + count)
        counts.confirmed[rows] = True
        counts.observed[rows] = self.rule.confirm_after
        counts.last_observed[rows] = counts.totals.scans

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
            counts.totals.culled += confirmed
            counts.totals.dropped += len(culled) - confirmed
            for name in PER_LANDMARK:
                array = getattr(counts, name)
                array[: len(kept)] = array[kept]
                array[len(kept) :] = 0
        return culled

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        arrays = {name: getattr(self.counts, name) for name in (*PER_LANDMARK, *BINS)}
        return {
            **arrays,
            "totals": np.array([getattr(self.counts.totals, name) for name in TOTALS]),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        fields = (arrays[name] for name in (*PER_LANDMARK, *BINS))
        self._whole = share(bind_counts, *fields, scalars(Totals, arrays["totals"]))
        self._local = None


def numbers_of_kept(kept: BoolArray) -> IntArray:
    """(n + 1,) number of each of n landmarks among those that are kept, -1 for the others.

    The last one is -1, so that an association of none, -1, stays none.
    """
    return np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)


def _new_counts(capacity: int, totals: Totals) -> VisibilityCounts:
    return share(
        bind_counts,
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.bool_),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros((capacity, 2)),
        np.zeros(capacity, np.bool_),
        np.zeros((RANGE_BINS, BEARING_BINS)),
        np.zeros((RANGE_BINS, BEARING_BINS)),
        totals,
    )
