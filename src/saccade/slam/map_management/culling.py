"""Landmarks that should have been seen and were not are no landmarks for long."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog


class FieldOfView(NamedTuple):
    """Where a sensor mostly sees what is there."""

    max_range: float
    """Range."""
    left: float
    right: float
    """Bearings, left over right."""

    @classmethod
    def from_log(cls, log: LandmarkLog) -> "FieldOfView":
        """The nearer half of what a log saw, and all but the last of its bearings."""
        if len(log.observation) == 0:
            return cls(0.0, 0.0, 0.0)
        right, left = np.quantile(log.observation[:, 1], [0.05, 0.95]).tolist()
        return cls(float(np.median(log.observation[:, 0])), left, right)


class VisibilityCounts(NamedTuple):
    """What is kept of each landmark, with room for more."""

    counts: IntArray
    """(c, 2) how often it was seen, and missed; zero for what is to come."""
    expected: FloatArray
    """(c, 2) range and bearing at which it should be seen in a scan."""
    mapped_before: IntArray
    """(1,) how many landmarks were in the map before that scan."""
    culled: BoolArray
    """(c,) whether it should have been seen more often."""

    @classmethod
    def from_counts(cls, times: IntArray) -> "VisibilityCounts":
        """Of landmarks that were seen and missed so often."""
        c = len(times)
        return cls(times, np.zeros((c, 2)), np.zeros(1, np.int64), np.zeros(c, np.bool_))


class CullingRule(NamedTuple):
    """When a landmark is none."""

    field_of_view: FieldOfView
    min_ratio: float
    max_missed: int
    interval: int
    """Poses from one look at the whole map to the next; 0 never looks."""


NO_CULLING = CullingRule(FieldOfView(0.0, 0.0, 0.0), 0.0, 0, 0)
"""All landmarks stay."""


class Culling:
    """Counts how often each landmark was seen, and how often it was not but should have been.

    Args:
        view: where a landmark should be seen.
        least: share of the times at which a landmark should have been seen that it must be.
        patience: times for which a landmark may hide before that counts.
        every: poses from one look at the whole map to the next.
    """

    def __init__(
        self, field_of_view: FieldOfView, min_ratio: float, max_missed: int = 5, interval: int = 4
    ) -> None:
        self.rule = CullingRule(field_of_view, min_ratio, max_missed, interval)
        self.counts = VisibilityCounts.from_counts(np.zeros((0, 2), np.int64))
        self.removed = 0
        """Landmarks that were taken out of the map."""

    def update(self, ekf: EkfSlam, expected: FloatArray, found: IntArray) -> IntArray:
        """Hear what was seen in a scan.

        Args:
            ekf: the filter, after the scan.
            expected: (n, 2) range and bearing of the landmarks that were in the map before it.
            found: (m,) landmark of each observation, negative where it is of none.

        Returns:
            (k,) landmarks to be removed, of which nothing is kept here any more.
        """
        self.make_room(len(ekf))
        self.counts.expected[: len(expected)], self.counts.mapped_before[0] = (
            expected,
            len(expected),
        )
        check_visibility(self.counts, self.rule, len(ekf), found)
        return self.remove_culled()

    def make_room(self, landmarks: int) -> None:
        """For a map of so many."""
        old, more = self.counts, landmarks - len(self.counts.culled)
        if more > 0:
            self.counts = VisibilityCounts.from_counts(
                np.concatenate([old.counts, np.zeros((more, 2), np.int64)])
            )
            self.counts.expected[: len(old.culled)], self.counts.mapped_before[:] = (
                old.expected,
                old.mapped_before,
            )

    def remove_culled(self) -> IntArray:
        """Keep nothing of the landmarks (k,) that are gone."""
        gone = np.flatnonzero(self.counts.culled)
        if len(gone) > 0:
            self.counts = VisibilityCounts.from_counts(np.delete(self.counts.counts, gone, 0))
            self.removed += len(gone)
        return gone


@kernel()
def _in_view(view: FieldOfView, z: FloatArray) -> bool:
    return bool(z[0] < view.max_range and view.right < z[1] < view.left)


@kernel()
def check_visibility(
    w: VisibilityCounts, rule: CullingRule, landmarks: int, found: IntArray
) -> bool:
    """Count what was `found` (m,) of so many landmarks; gives whether any of them is gone."""
    seen, missed, before = w.counts[:, 0], w.counts[:, 1], w.mapped_before[0]
    for i in range(before):
        missed[i] += _in_view(rule.field_of_view, w.expected[i])
    for i in range(len(found)):
        if found[i] >= 0:
            seen[found[i]] += 1
            if found[i] < before:
                missed[found[i]] -= _in_view(rule.field_of_view, w.expected[found[i]])
    any_gone = False
    for i in range(landmarks):
        w.culled[i] = missed[i] > rule.max_missed and seen[i] < rule.min_ratio * (
            seen[i] + missed[i]
        )
        any_gone = any_gone or w.culled[i]
    return any_gone
