"""Data association by labels that may be wrong, and by geometry without one.

A label is accepted if the observation is inside the gate of its landmark, which is nearly always.
Rejected labels are rare; they are processed in plain NumPy.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from saccade.landmark_names import Label
from saccade.slam.association.nearest_neighbor import Gates, associate_by_geometry, compare
from saccade.slam.association.outcomes import DROPPED, NEW, UNDECIDED
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.robot_models import inverse_observe
from saccade.slam.landmarks import LabelRecord, LandmarkTable
from saccade.types import BoolArray, FloatArray, IntArray

MAX_REPEATED = 10
"""Maximum number of rejected observations that move a label, however often it was accepted."""
MIN_CLOSINGS = 3
"""Minimum number of observations of one label that close a loop together."""
CLOSING_SCANS = 10
"""Largest number of scans between two of them."""
LOOP_GATE = 100.0
"""Gate of the normalized innovation squared where the pose is uncertain: the errors of odometry
have heavier tails than a Gaussian, and the heading is too uncertain for a linear gate."""
LOOP_GATE_RATIO = 25.0
"""Minimum ratio of predicted variance to noise for this gate: five standard deviations of an
observation."""
PAIRED_RATIO = 4.0
"""Minimum ratio of predicted variance to noise for labels to be checked in pairs. For a
lower ratio, the gate of one observation is about as narrow as the gate of a distance."""
LOOP_RATIO = 100.0
"""Largest ratio of predicted variance to noise for one observation of a new label to close a loop:
ten standard deviations of an observation."""
LONG_LOOP_RATIO = 1000.0
"""Largest ratio of predicted variance to noise for one observation of any label to close a loop."""
UNLABELED_LOOP_RATIO = 10.0
"""Largest ratio of predicted variance to noise for an observation without a label to be of a
landmark with a label, while labels are observed: the next label closes the loop more surely."""
MAX_UNLABELED = 20
"""Maximum number of successive observations without a label while labels are expected."""
PAIR_GATE = 10.83
"""Gate of the squared error of the distance of two landmarks: 99.9 % of a chi-square variable with
one degree of freedom."""


class LabelAssociation:
    """Association by label where there is one, if it agrees with the map; else by geometry.

    A label is rejected if the observation is outside the gate of its landmark. Where the pose is so
    uncertain that a label closes a loop, two labels of a scan must agree, or one must be observed
    again. Several rejected observations at one position move the label there: the landmark has
    moved, or its first observation had the wrong label.

    With "known" association every label is accepted. Observations without a label are dropped then,
    and so is a second observation, in one scan, of a landmark that is not in the map yet.
    """

    def __init__(self, config: EkfConfig) -> None:
        self.gates = Gates(
            chi_square_gate(2, config.gate),
            chi_square_gate(2, config.new_gate),
            config.rule.pairing,
        )
        """Gates of observations without a label, and of observations whose label is rejected."""
        self.rejected: BoolArray = np.zeros(0, np.bool_)
        """(m,) whether the label of each observation of the last scan was rejected."""
        self.unlabeled = 0
        """Observations since the last label."""
        self._all_accepted = config.rule.accepts_all
        self._gate = chi_square_gate(2, config.label_gate)

    def __call__(
        self,
        ekf: EkfSlam,
        table: LandmarkTable,
        z: FloatArray,
        R: FloatArray,
        labels: Sequence[Label | None],
    ) -> IntArray:
        """(m,) id of the landmark of each observation of a scan, `NEW` or `DROPPED`.

        `next_id` of the filter and the ids that follow are of new landmarks that need no more
        observations. The labels of the table are updated.
        """
        if self._all_accepted:
            return self._look_up(ekf.next_id, table, labels)
        self.rejected = np.zeros(len(labels), np.bool_)
        table.has_unlabeled = table.has_unlabeled or None in labels
        if all(label is None for label in labels):
            self.unlabeled += len(labels)
            matches = self._by_geometry(ekf, table, z, R)
            self._drop_loops(ekf, table, z, R, labels, matches)
            return matches
        self.unlabeled = 0
        matches = np.array(self._gate_labels(ekf, table, z, R, labels), np.int64)
        rest = np.flatnonzero(matches == UNDECIDED)
        if len(rest) > 0:
            near = self._by_geometry(ekf, table, z[rest], R[rest], matches[matches >= 0])
            pairs = zip(rest.tolist(), near.tolist(), strict=True)
            self._resolve(ekf.next_id, table, labels, dict(pairs), matches)
            self._drop_loops(ekf, table, z, R, labels, matches)
        return matches

    def _by_geometry(
        self,
        ekf: EkfSlam,
        table: LandmarkTable,
        z: FloatArray,
        R: FloatArray,
        taken: IntArray | None = None,
    ) -> IntArray:
        confirmed = table.counts.confirmed if table.policy.enabled else None
        if confirmed is not None and ekf.submap is not None:
            confirmed = confirmed[table.rows(ekf.active_ids)]
        return associate_by_geometry(ekf, z, R, self.gates, taken, confirmed)

    def _drop_loops(
        self,
        ekf: EkfSlam,
        table: LandmarkTable,
        z: FloatArray,
        R: FloatArray,
        labels: Sequence[Label | None],
        matches: IntArray,
    ) -> None:
        """Drops observations (m,) that close a loop without a label, while labels are observed."""
        if not table.labels or self.unlabeled > MAX_UNLABELED:
            return
        without = np.array([label is None for label in labels], np.bool_) & (matches >= 0)
        if not without.any():
            return
        _, ratio = compare(ekf, z, R, np.where(without, matches, -1))
        for i in np.flatnonzero(without & (ratio > UNLABELED_LOOP_RATIO)).tolist():
            if table.is_labeled(int(matches[i])):
                matches[i] = DROPPED

    def _look_up(
        self, next_id: int, table: LandmarkTable, labels: Sequence[Label | None]
    ) -> IntArray:
        """(m,) landmark of each label, new ones from `next_id` on."""
        new: set[Label] = set()  # labels first observed in this scan
        matches = np.full(len(labels), DROPPED)
        for i, label in enumerate(labels):
            if label is None or label in new:
                continue
            record = table.labels.get(label) or table.labels.setdefault(label, LabelRecord())
            if record.landmark < 0:
                record.landmark = next_id + len(new)
                new.add(label)
            matches[i] = record.landmark
        return matches

    def _gate_labels(
        self,
        ekf: EkfSlam,
        table: LandmarkTable,
        z: FloatArray,
        R: FloatArray,
        labels: Sequence[Label | None],
    ) -> list[int]:
        """(m,) landmarks of the labels that are accepted, `DROPPED`, `UNDECIDED` for all others."""
        landmarks, matches = table.landmarks_of(labels), [UNDECIDED] * len(labels)
        known = {i: table.labels[labels[i]] for i in np.flatnonzero(landmarks >= 0).tolist()}  # type: ignore[index]
        if not known:
            return matches
        nis, ratio = (each.tolist() for each in compare(ekf, z, R, landmarks))
        rejected = {i for i in known if not nis[i] <= loop_gate(ratio[i], self._gate)}
        paired = any(ratio[i] > PAIRED_RATIO for i in known.keys() - rejected)
        seen: dict[int, _Sighting] = {}
        if rejected or paired:
            xy, _, Gz = inverse_observe(ekf.pose, ekf.without_range_errors(z))  # C.15
            C = Gz @ R @ Gz.transpose(0, 2, 1)
            seen = {i: _Sighting(int(landmarks[i]), xy[i], C[i], Gz[i, :, 0]) for i in known}
        if paired:
            rejected |= _inconsistent(ekf, {i: seen[i] for i in known if i not in rejected})
        closing = sum(ratio[i] > LOOP_RATIO for i in known if i not in rejected)
        for i, record in known.items():
            few = not record.is_established
            loop = ratio[i] > (LOOP_RATIO if few else LONG_LOOP_RATIO)
            alone = loop and closing <= 1 and i not in rejected
            if alone and few and _is_duplicate(ekf, table, seen[i]):
                rejected.add(i)
            if i in rejected:
                _remember(seen[i], record)
            elif alone and not _is_repeated(record, table.scans):
                matches[i] = DROPPED
            else:
                matches[i] = record.landmark
                record.accepted, record.repeated = record.accepted + 1, 0
        self.rejected[list(rejected)] = True
        return matches

    def _resolve(
        self,
        next_id: int,
        table: LandmarkTable,
        labels: Sequence[Label | None],
        near: dict[int, int],
        matches: IntArray,
    ) -> None:
        """Associates the other observations, given the landmark that each is near to.

        The first observation of a label is of a new landmark, or of a landmark without a label. A
        rejected observation is not used; after several at one position the label moves there, but
        not in a map that is given.
        """
        for i, j in near.items():
            label, matches[i] = labels[i], j if labels[i] is None else DROPPED
            if label is None:
                continue
            record = table.labels.setdefault(label, LabelRecord())
            if not self.rejected[i]:
                if record.landmark >= 0:
                    continue  # another observation in this scan
                j = NEW if j < 0 or table.is_labeled(j) else j
                record.repeated = 1
            else:
                if not record.is_established and (j == DROPPED or (j >= 0 and table.is_labeled(j))):
                    j = NEW  # the only landmark that the observation may not be near is its own
                if j != DROPPED and record.target not in (UNDECIDED, DROPPED, j):
                    record.repeated = 1
                record.target = j
                few = record.repeated < min(record.accepted + 1, MAX_REPEATED)
                if few or j == DROPPED or not table.policy.enabled:
                    continue
            if j == NEW:
                j, next_id = next_id, next_id + 1
            _move(table, record, j)
            matches[i] = j


def loop_gate(variance_ratio: float, gate: float) -> float:
    """Gate of a label: `gate`, or a wider one where the pose is uncertain."""
    return LOOP_GATE if variance_ratio > LOOP_GATE_RATIO else gate


class _Sighting(NamedTuple):
    """An observation with a label, as a point of the map."""

    landmark: int
    """Id of the landmark of its label."""
    xy: FloatArray
    """(2,) meters."""
    covariance: FloatArray
    """(2, 2) of the noise of the observation."""
    direction: FloatArray
    """(2,) from the robot to the point, of length 1."""


def _is_repeated(record: LabelRecord, scan: int) -> bool:
    """Counts an observation that closes a loop by itself; returns whether they suffice."""
    if scan - record.closing_at > CLOSING_SCANS:
        record.closings = 0
    record.closings += 1
    record.closing_at = scan
    return record.closings >= MIN_CLOSINGS


def _remember(seen: _Sighting, record: LabelRecord) -> None:
    """Records a rejected observation of a label."""
    C = seen.covariance + record.covariance
    if record.repeated > 0 and normalized_squared(seen.xy - record.xy, C) <= PAIR_GATE:
        record.repeated += 1
    else:
        record.repeated, record.target = 1, UNDECIDED
    record.xy, record.covariance = seen.xy, seen.covariance


def _inconsistent(ekf: EkfSlam, seen: dict[int, _Sighting]) -> set[int]:
    """Observations whose mutual distances contradict the distances of their landmarks.

    An uncertain prediction, as before a loop is closed, accepts many landmarks; the distances
    between landmarks are certain all the same.
    """
    conflicts: dict[int, set[int]] = {i: set() for i in seen}
    for (i, each), (j, other) in combinations(seen.items(), 2):
        if each.landmark != other.landmark and not _agree(ekf, each, other):
            conflicts[i].add(j)
            conflicts[j].add(i)
    rejected: set[int] = set()
    while (most := max(map(len, conflicts.values()), default=0)) > 0:
        worst = {i for i, each in conflicts.items() if len(each) == most}
        rejected |= worst
        conflicts = {i: each - worst for i, each in conflicts.items() if i not in worst}
    return rejected


def _move(table: LandmarkTable, record: LabelRecord, j: int) -> None:
    """Gives a label to landmark j; its former landmark is removed if it has few observations."""
    old, record.landmark = record.landmark, j
    if old >= 0:
        table.has_unlabeled = True
        if not record.is_established and not table.is_labeled(old):
            table.stale.append(old)
    record.accepted, record.repeated = record.repeated, 0


def _is_duplicate(ekf: EkfSlam, table: LandmarkTable, seen: _Sighting) -> bool:
    """Whether a landmark with an established label is at the position of a sighting's landmark.

    The first observation of the sighting's label was wrong then.
    """
    ids = [n.landmark for n in table.labels.values() if n.landmark >= 0 and n.is_established]
    others = np.array(ids, np.int64)
    others = others[(ekf.rows(others) >= 0) & (others != seen.landmark)]
    f = ekf.active
    rows = ekf.rows(np.append(seen.landmark, others))
    positions = f.state[f.robot_size :].reshape(-1, 2)[rows]
    squared = ((positions[1:] - positions[0]) ** 2).sum(1)
    near = others[squared < PAIRED_RATIO * PAIR_GATE * seen.covariance.trace()].tolist()
    return any(_agree(ekf, seen, seen._replace(landmark=j)) for j in near)


def _agree(ekf: EkfSlam, a: _Sighting, b: _Sighting) -> bool:
    """Whether two observed points are as far from each other as their landmarks in the map.

    Systematic errors of the ranges move both points, each along its direction.
    """
    seen, C = a.xy - b.xy, a.covariance + b.covariance
    position, joint = ekf.relative_position(a.landmark, b.landmark)
    mean, along = position[:2], [np.zeros(2), np.zeros(2)]
    observed, mapped = float(np.hypot(*seen)), float(np.hypot(*mean))
    if observed > 0:
        along[0] = seen / observed
    if mapped > 0:
        along[1] = mean / mapped
    by_error = -along[0] @ np.column_stack([seen, a.direction - b.direction])  # scale, offset
    g = np.append(-along[1], by_error)[: len(joint)]
    variance = float(along[0] @ C @ along[0]) + max(float(g @ joint @ g), 0.0)
    return (observed - mapped) ** 2 <= PAIR_GATE * variance
