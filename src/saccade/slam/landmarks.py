"""The landmark table: ids, labels, counts and descriptors of landmarks."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Self, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.landmark_names import Label, labels_of
from saccade.slam._evidence_kernels import BEARING_BINS, RANGE_BINS, detection_rates
from saccade.slam.association.outcomes import DROPPED, UNDECIDED, UNUSED
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.robot_models import observe
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkMap, Table, column

MAX_AMBIGUOUS = 0.5
"""Largest fraction of ambiguous observations without a warning."""
CHECKS = 4
"""Number of checks between removals of landmarks: a removal costs more than a step."""
ESTABLISHED = 3
"""Minimum number of accepted observations for a label to be known to be of its landmark."""
DescriptorArray: TypeAlias = npt.NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class LandmarkRows(Table):
    """Counts of landmarks, one row each."""

    id: IntArray = column(dtype=np.int64)
    """(n,) ascending; as in the filter."""
    confirmed: BoolArray = column(dtype=np.bool_)
    """(n,) whether each is a landmark of the map; else a candidate."""
    observations: IntArray = column(dtype=np.int64)
    """(n,) number of observations."""
    last_observed: IntArray = column(dtype=np.int64)
    """(n,) number of the scan of the last observation."""
    detected: FloatArray = column()
    """(n,) checks in which each was observed, without the scan in which it was added."""
    expected: FloatArray = column()
    """(n,) detections that were expected in all checks."""
    session: IntArray = column(dtype=np.int64)
    """(n,) session in which each was added, see `Slam.load`."""


@dataclass
class LabelRecord:
    """Evidence on one label."""

    landmark: int = -1
    """Id of its landmark, -1 for none."""
    accepted: int = 0
    """Observations that were accepted for that landmark."""
    repeated: int = 0
    """Successive rejected observations at one position."""
    target: int = UNDECIDED
    """Id of the landmark near that position, `NEW` or `UNDECIDED`."""
    closings: int = 0
    """Recent observations that would close a loop by themselves."""
    closing_at: int = -1
    """Number of the scan of the last such observation."""
    xy: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,) position in the map of the last rejected observation."""
    covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """(2, 2) of its noise."""

    @property
    def is_established(self) -> bool:
        """Whether the label is known to be of its landmark."""
        return self.accepted >= ESTABLISHED


@dataclass(frozen=True)
class CullingPolicy:
    """Confirmation of candidates and culling of landmarks."""

    enabled: bool
    """Whether candidates are confirmed and landmarks are culled."""
    confirm_after: int
    """Number of the observation that confirms a candidate; 1 for the first."""
    candidate_scans: int
    """Largest number of scans without an observation of a candidate."""
    culling_ratio: float = 0.0
    """Least detections of a landmark, as a fraction of the expected number."""
    max_missed: float = 5.0
    """Number of missed detections that are always tolerated."""
    interval: int = 4
    """Scans from one check of the detections to the next."""


class LandmarkTable:
    """Ids, labels, counts, sessions and descriptors of the landmarks of a filter.

    A new landmark is a candidate: it is in the filter, so that no observation of it is lost, but
    not in the map until it is confirmed by further observations; without them it is removed. A
    landmark is culled if its detection rate is much lower than the mean rate of landmarks at the
    same ranges and bearings in earlier scans.
    """

    def __init__(self, policy: CullingPolicy) -> None:
        self.policy = policy
        self.counts = LandmarkRows()
        """One row for each landmark, in the order of their ids."""
        self.labels: dict[Label, LabelRecord] = {}
        """Evidence on each label, with its landmark."""
        self.descriptors: dict[int, DescriptorArray] = {}
        """(d,) descriptors of landmarks by their ids, if the user sets any; removed with them."""
        self.has_unlabeled = False
        """Whether there may be a landmark without a label; landmarks with labels are not culled."""
        self.stale: list[int] = []
        """Ids of landmarks without their former label, which are to be removed."""
        self.session = 0
        """Number of the present session."""
        self.detections = np.zeros((2, RANGE_BINS, BEARING_BINS))
        """Detections and checks of confirmed landmarks, by range and bearing."""
        self.scans = 0
        """Scans so far."""
        self.max_range = -np.inf
        """Largest range that was observed so far."""
        self.ambiguous = 0
        """Number of observations that were dropped as ambiguous."""
        self.forgotten = 0
        """Number of candidates that were removed."""
        self.culled = 0
        """Number of landmarks of the map that were removed."""
        self.log_likelihood = 0.0
        """Log-likelihood of the detections and misses of confirmed landmarks in all checks."""

    def __len__(self) -> int:
        return len(self.counts)

    def rows(self, landmarks: IntArray) -> IntArray:
        """Rows (k,) of landmarks by their ids."""
        return np.searchsorted(self.counts.id, landmarks)

    def add(self, landmarks: IntArray, *, confirmed: bool, observations: int = 0) -> None:
        """Adds new landmarks (k,), by their ids, as candidates or as confirmed landmarks.

        Without culling, landmarks are in the map by their labels alone.
        """
        k = len(landmarks)
        new = LandmarkRows.zeros(
            k,
            id=landmarks,
            confirmed=np.full(k, confirmed and self.policy.enabled),
            observations=np.full(k, observations),
            last_observed=np.full(k, self.scans),
            session=np.full(k, self.session),
        )
        self.counts = LandmarkRows.concatenate([self.counts, new])

    def remove(self, landmarks: IntArray) -> None:
        """Removes landmarks (k,), by their ids, and takes their labels from them."""
        removed = np.isin(self.counts.id, landmarks)
        confirmed = int(self.counts.confirmed[removed].sum())
        self.culled += confirmed
        self.forgotten += int(removed.sum()) - confirmed
        self.counts = self.counts[~removed]
        gone = set(landmarks.tolist())
        for record in self.labels.values():
            if record.landmark in gone:
                record.landmark = -1
            if record.target in gone:
                record.target, record.repeated = UNDECIDED, 0
        self.descriptors = {i: each for i, each in self.descriptors.items() if i not in gone}

    def join(self, kept: int, removed: int) -> None:
        """Adds the counts of the second landmark to the first; the second stays in the table.

        Expected detections are not added: each check expects one detection of both together.
        """
        table, (i, j) = self.counts, self.rows(np.array([kept, removed])).tolist()
        table.observations[i] += table.observations[j]
        table.detected[i] += table.detected[j]
        for each in (table.last_observed, table.expected, table.confirmed):
            each[i] = max(each[i], each[j])

    def predict_visible(self, ekf: EkfSlam, z: FloatArray) -> tuple[IntArray, FloatArray] | None:
        """Ids (n,) and predicted observations (n, 2) of landmarks that a scan (k, 2) may miss.

        They are all landmarks of the active submap. None if misses do not count in this scan.
        """
        self.max_range = max([self.max_range, *z[:, 0].tolist()])
        if (self.scans + 1) % self.policy.interval > 0:
            return None
        f = ekf.active
        points = f.state[f.robot_size :][: 2 * f.now.landmarks].reshape(-1, 2)
        return ekf.active_ids.copy(), observe(f.state[: f.robot_size], points)[0]

    def count(self, matches: IntArray, visible: tuple[IntArray, FloatArray] | None) -> IntArray:
        """Counts observed and missed landmarks; returns (g,) ids of landmarks to be culled.

        The landmarks of its observations are `matches` (k,), negative for none; `visible` is the
        result of `predict_visible`.
        """
        stale, self.stale = np.array(self.stale, np.int64), []
        used, table = self.rows(matches[matches >= 0]), self.counts
        self.scans += 1
        table.last_observed[used] = self.scans
        if self.policy.enabled:
            np.add.at(table.observations, used, 1)
            table.confirmed[used] |= table.observations[used] >= self.policy.confirm_after
            self.ambiguous += int((matches == DROPPED).sum())
        return stale if visible is None else np.union1d(stale, self._missed(*visible))

    def _missed(self, visible: IntArray, predicted: FloatArray) -> IntArray:
        """Counts detections; returns (g,) ids of unlabeled landmarks that are to be culled."""
        inside = predicted[:, 0] <= self.max_range
        self._count_detections(self.rows(visible[inside]), predicted[inside])
        table, policy = self.counts, self.policy
        due = policy.enabled and self.has_unlabeled and self.scans % (CHECKS * policy.interval) == 0
        if not due:
            return visible[:0]
        few = table.detected < policy.culling_ratio * table.expected
        missed = few & (table.expected - table.detected > policy.max_missed)
        late = self.scans - table.last_observed > policy.candidate_scans
        removed = np.where(table.confirmed, missed, late) & ~self.labeled
        return np.asarray(table.id[removed], np.int64)

    def _count_detections(self, rows: IntArray, predicted: FloatArray) -> None:
        """Counts detections and expected detections of landmarks, predicted at (n, 2).

        The expected detection is the mean detection rate of confirmed landmarks at the same range
        and bearing in earlier scans.
        """
        table, counted = self.counts, self.detection_counts
        cell, rate = np.empty(len(predicted), np.int64), np.empty(len(predicted))
        detection_rates(predicted, counted, cell, rate)
        hits, checks = counted[:, cell]
        detected = table.last_observed[rows] == self.scans
        table.expected[rows] += rate
        table.detected[rows] += detected
        known, p = table.confirmed[rows], (hits + 1) / (checks + 2)
        self.log_likelihood += float(np.log(np.where(detected, p, 1 - p))[known].sum())
        np.add.at(counted[0], cell[known], detected[known])
        np.add.at(counted[1], cell[known], 1.0)

    @property
    def detection_counts(self) -> FloatArray:
        """(2, cells) detections and checks in each cell of the view."""
        return self.detections.reshape(2, -1)

    def landmarks_of(self, labels: Sequence[Label | None]) -> IntArray:
        """(k,) id of the landmark of each label, -1 for none."""
        known = self.labels
        found = [known[label].landmark if label in known else -1 for label in labels]
        return np.array(found, np.int64)

    def searched_for(self, labels: Sequence[Label | None]) -> IntArray:
        """`landmarks_of` for the search of a pose in the map.

        `UNUSED` for a label of no landmark where all landmarks have labels: by geometry alone the
        observation would be taken for one of them.
        """
        found = self.landmarks_of(labels)
        if self.has_unlabeled or len(self.labels) == 0:
            return found
        foreign = np.array([label is not None for label in labels], np.bool_) & (found < 0)
        return np.where(foreign, UNUSED, found)

    def labels_of(self, landmarks: Iterable[int]) -> list[Label | None]:
        """Label of each landmark, by ids; None for a landmark without a label."""
        found = {record.landmark: label for label, record in self.labels.items()}
        return [found.get(landmark) for landmark in landmarks]

    def is_labeled(self, landmark: int) -> bool:
        """Whether a landmark has a label."""
        return any(record.landmark == landmark for record in self.labels.values())

    @property
    def labeled(self) -> BoolArray:
        """(n,) landmarks that have a label."""
        return np.isin(self.counts.id, [each.landmark for each in self.labels.values()])

    @property
    def in_map(self) -> BoolArray:
        """(n,) landmarks of the map: confirmed or labeled, and observed more than once.

        A wrong label may be read once; the labels of a given map are established.
        """
        kept = self.counts.confirmed | self.labeled
        if self.policy.confirm_after > 1:
            sure = [each.landmark for each in self.labels.values() if each.is_established]
            kept &= (self.counts.observations != 1) | np.isin(self.counts.id, sure)
        return kept

    def warning(self, association: IntArray) -> str:
        """Reason why nothing was mapped, or why most observations were not used; else empty.

        The landmarks of the observations are `association` (k,), negative for none.
        """
        observations, policy = len(association), self.policy
        if observations == 0:
            return "nothing is mapped: there are no observations"
        if not policy.enabled:
            return "" if (association >= 0).any() else "no observation has a label"
        if self.ambiguous > MAX_AMBIGUOUS * observations:
            empty = "" if (association >= 0).any() else "nothing is mapped: "
            return (
                f"{empty}{self.ambiguous} of {observations} observations are not used: each may be "
                "of several landmarks, which are too close together for the odometry and its noise"
            )
        if (association >= 0).any():
            return ""
        if self.labels:
            return "nothing is mapped: no landmark was observed twice"
        if self.culled > 0:
            return (
                f"nothing is mapped: all of {self.culled} landmarks were culled, as they were "
                "often not observed where landmarks usually are; see culling_ratio"
            )
        return (
            f"nothing is mapped: no candidate was observed {policy.confirm_after} times with at "
            f"most {policy.candidate_scans} scans in between; see confirm_after and candidate_scans"
        )

    def adopt(self, saved: "LandmarkTable") -> None:
        """Takes the content of a saved table, after which a new session begins."""
        vars(self).update(vars(saved), policy=self.policy, session=saved.session + 1)

    def copy(self) -> Self:
        """An independent table with the same content."""
        new = copy.copy(self)
        new.counts, new.detections = self.counts[np.arange(len(self))], self.detections.copy()
        new.labels = {label: copy.copy(each) for label, each in self.labels.items()}
        new.descriptors = dict(self.descriptors)
        return new


def known_landmarks(landmarks: LandmarkMap) -> LandmarkTable:
    """The table of a given map, with ids from 0 in the order of its landmarks."""
    table, n = LandmarkTable(CullingPolicy(False, 1, 1)), len(landmarks)
    table.counts = LandmarkRows.zeros(n, id=np.arange(n), confirmed=np.ones(n, np.bool_))
    for i, label in enumerate(labels_of(landmarks.id, landmarks.text_names)):
        if label is not None:
            table.labels[label] = LabelRecord(landmark=i, accepted=ESTABLISHED)
    table.has_unlabeled = len(table.labels) < n
    return table
