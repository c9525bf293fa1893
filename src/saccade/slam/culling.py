"""Confirms candidate landmarks that are observed again, and culls landmarks that are missed."""

import numpy as np

from saccade.io.checkpoint import Arrays, attribute_arrays, restore_attributes
from saccade.slam.association._kernels import DROPPED
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.models import observe
from saccade.types import BoolArray, FloatArray, IntArray

MAX_AMBIGUOUS = 0.5
"""Fraction of the observations that may be ambiguous without a warning."""
RANGE_BINS, BEARING_BINS = 96, 24
"""Of the detection probability: quarters of an octave of the range from 0.24 mm to 4 km, and
sectors of the bearing."""
CHECKS = 4
"""Checks from one removal of landmarks to the next: a removal costs more than a step."""
UNKNOWN = 4.0
"""Expectations that are added to those of a bin: of a new bin no detection is expected."""
PER_LANDMARK = ("observed", "last_observed", "is_confirmed", "detected", "expected", "culled")
"""Attributes of `Culling` with a row for each landmark."""
NUMBERS = ("bins", "scans", "ambiguous", "forgotten", "removed", "reach", "log_likelihood")
"""Attributes of `Culling` that change from scan to scan, too."""


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
        self.enabled, self.confirm_after, self.interval = enabled, confirm_after, interval
        self.candidate_scans = candidate_scans
        self.min_ratio, self.max_missed = min_ratio or 0.0, max_missed
        self.observed = np.zeros(0, np.int64)
        """(c,) observations; 0 until the scan in which it was added has been counted."""
        self.last_observed = np.zeros(0, np.int64)
        """(c,) number of the scan of the last one."""
        self.is_confirmed = np.zeros(0, np.bool_)
        """(c,) whether it is a landmark; else a candidate."""
        self.detected = np.zeros(0)
        """(c,) checks in which it was observed, without the scan in which it was added."""
        self.expected = np.zeros(0)
        """(c,) detections that were expected in all checks."""
        self.culled = np.zeros(0, np.bool_)
        """(c,) whether it is to be removed."""
        self.bins = np.zeros((2, RANGE_BINS, BEARING_BINS))
        """Detections and checks of confirmed landmarks, by range and bearing."""
        self.scans = 0
        """Scans so far."""
        self.ambiguous = 0
        """Observations that were dropped because they may be of several landmarks."""
        self.forgotten = 0
        """Candidates that were dropped."""
        self.removed = 0
        """Landmarks that were culled."""
        self.reach = -np.inf
        """Largest range that was observed so far."""
        self.log_likelihood = 0.0
        """Of which confirmed landmarks were detected, and which were missed, in all checks."""

    def warning(self, association: IntArray) -> str:
        """Why nothing was mapped, or most observations were not used; empty if neither is so.

        Args:
            association: (k,) landmark of the map for each observation, negative for none.
        """
        observations = len(association)
        if observations == 0:
            return "nothing is mapped: there are no observations"
        if not self.enabled:
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
            f"nothing is mapped: no candidate was observed {self.confirm_after} times with at "
            f"most {self.candidate_scans} scans in between; see confirm_after and candidate_scans"
        )

    def confirmed(self, landmarks: int) -> BoolArray:
        """Which of so many landmarks are confirmed (n,); the others are candidates."""
        if not self.enabled:
            return np.ones(landmarks, np.bool_)
        self.reserve(landmarks)
        return self.is_confirmed[:landmarks].copy()

    def confirmed_in_view(self, ekf: EkfSlam) -> BoolArray:
        """(n,) landmarks of `EkfSlam.view` that were counted as confirmed."""
        self.reserve(len(ekf))
        return self.is_confirmed[ekf.from_view(np.arange(ekf.view.now.landmarks))]

    def is_due(self) -> bool:
        """Whether the whole map is checked in the next scan."""
        return self.enabled and (self.scans + 1) % self.interval == 0

    def predict_visible(self, ekf: EkfSlam, z: FloatArray, *, may_cull: bool) -> FloatArray | None:
        """Predict the observations of all landmarks in view if missed ones are counted in a scan.

        Args:
            ekf: the filter, before the update by the scan.
            z: (k, 2) the scan.
            may_cull: whether there may be a landmark to cull.

        Returns:
            (n, 2) by each landmark in view; None if missed landmarks are not counted.
        """
        self.reach = max(self.reach, *z[:, 0].tolist())
        if not (self.is_due() and may_cull):
            return None
        f = ekf.view
        points = f.state[f.robot_size :][: 2 * f.now.landmarks].reshape(-1, 2)
        return observe(f.state[: f.robot_size], points)[0]

    def count_scan(
        self,
        ekf: EkfSlam,
        predicted: FloatArray | None,
        candidates: int,
        association: IntArray,
    ) -> IntArray:
        """Count the observed and the missed landmarks of a scan.

        Args:
            ekf: the filter, after the scan.
            predicted: of `predict_visible`.
            candidates: number of the first landmark that was added as a candidate; others that
                are new were added by a rule that does not wait for more observations.
            association: (m,) landmark of each observation, negative for none.

        Returns:
            (g,) landmarks that are to be culled.
        """
        if not self.enabled:
            return association[:0]
        landmarks = len(ekf)
        self.reserve(landmarks)
        self.scans += 1
        added = int(self.observed[:landmarks].nonzero()[0].max(initial=-1)) + 1
        self.is_confirmed[added:candidates] = True
        used = association[association >= 0]
        np.add.at(self.observed, used, 1)
        self.last_observed[used] = self.scans
        self.is_confirmed[used] |= self.observed[used] >= self.confirm_after
        self.ambiguous += int((association == DROPPED).sum())
        if predicted is None:
            return association[:0]
        inside = predicted[:, 0] <= self.reach
        view = ekf.from_view(np.arange(len(predicted)))
        self._count_detections(view[inside], predicted[inside])
        if self.scans % (CHECKS * self.interval) == 0:
            few = self.detected < self.min_ratio * self.expected
            missed = few & (self.expected - self.detected > self.max_missed)
            late = self.scans - self.last_observed > self.candidate_scans
            self.culled = np.where(self.is_confirmed, missed, late)
            self.culled[landmarks:] = False
        return np.flatnonzero(self.culled)

    def _count_detections(self, landmarks: IntArray, predicted: FloatArray) -> None:
        """Count whether landmarks (n,) in view (n, 2) were detected, and whether it was expected.

        A detection is expected with the probability with which the confirmed landmarks of the map
        were detected, so far, at the same range and bearing.
        """
        octaves = 4 * np.log2(np.maximum(predicted[:, 0], 1e-6))
        row = (octaves + RANGE_BINS / 2).astype(np.int64).clip(0, RANGE_BINS - 1)
        sector = ((predicted[:, 1] / (2 * np.pi) + 0.5) * BEARING_BINS).astype(np.int64)
        column = sector % BEARING_BINS
        hits, checks = self.bins[:, row, column]
        detected = self.last_observed[landmarks] == self.scans
        self.expected[landmarks] += hits / (checks + UNKNOWN)
        self.detected[landmarks] += detected
        known, p = self.is_confirmed[landmarks], (hits + 1) / (checks + 2)
        self.log_likelihood += float(np.log(np.where(detected, p, 1 - p))[known].sum())
        place = row[known], column[known]
        np.add.at(self.bins[0], place, detected[known])
        np.add.at(self.bins[1], place, 1.0)

    def keep(self, landmarks: IntArray) -> None:
        """Do not cull these landmarks (k,)."""
        self.culled[landmarks] = False

    def reserve(self, landmarks: int) -> None:
        """Make room for a map of so many landmarks."""
        missing = landmarks - len(self.observed)
        if missing > 0:
            for name in PER_LANDMARK:
                setattr(self, name, np.pad(getattr(self, name), (0, missing + landmarks // 2)))

    def add_confirmed(self, first: int, count: int) -> None:
        """Count landmarks from number `first` on as confirmed, as those of another map are."""
        self.reserve(first + count)
        rows = slice(first, first + count)
        self.is_confirmed[rows] = True
        self.observed[rows] = self.confirm_after
        self.last_observed[rows] = self.scans

    def join(self, kept: int, removed: int) -> None:
        """Count the observations of two landmarks as those of the first; the second is not removed.

        A check in which one of them was observed expected one detection, not two.
        """
        self.observed[kept] += self.observed[removed]
        self.detected[kept] += self.detected[removed]
        for name in ("last_observed", "expected", "is_confirmed"):
            each = getattr(self, name)
            each[kept] = max(each[kept], each[removed])

    def remove_culled(self, others: IntArray) -> IntArray:
        """Remove the counts of the landmarks that are to be culled, and of others.

        Args:
            others: (n,) landmarks that are removed for other reasons.

        Returns:
            (k,) all of them.
        """
        culled = np.union1d(np.flatnonzero(self.culled), others)
        if len(culled) > 0:
            self.reserve(int(culled[-1]) + 1)
            confirmed = int(self.is_confirmed[culled].sum())
            self.removed += confirmed
            self.forgotten += len(culled) - confirmed
            for name in PER_LANDMARK:
                setattr(self, name, np.delete(getattr(self, name), culled))
        return culled

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return attribute_arrays(self, *PER_LANDMARK, *NUMBERS)

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        restore_attributes(self, arrays)


def numbers_of_kept(kept: BoolArray) -> IntArray:
    """(n + 1,) number of each of n landmarks among those that are kept, -1 for the others.

    The last one is -1, so that an association of none, -1, stays none.
    """
    return np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
