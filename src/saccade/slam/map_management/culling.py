"""Landmarks that should have been seen and were not are no landmarks for long."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog


class View(NamedTuple):
    """Where a sensor mostly sees what is there."""

    reach: float
    """Range."""
    left: float
    right: float
    """Bearings, left over right."""

    @classmethod
    def of(cls, log: LandmarkLog) -> "View":
        """The nearer half of what a log saw, and all but the last of its bearings."""
        if len(log.observation) == 0:
            return cls(0.0, 0.0, 0.0)
        right, left = np.quantile(log.observation[:, 1], [0.05, 0.95]).tolist()
        return cls(float(np.median(log.observation[:, 0])), left, right)


class Watch(NamedTuple):
    """What is kept of each landmark, with room for more."""

    times: IntArray
    """(c, 2) how often it was seen, and missed; zero for what is to come."""
    expected: FloatArray
    """(c, 2) range and bearing at which it should be seen in a scan."""
    before: IntArray
    """(1,) how many landmarks were in the map before that scan."""
    gone: BoolArray
    """(c,) whether it should have been seen more often."""

    @classmethod
    def of(cls, times: IntArray) -> "Watch":
        """Of landmarks that were seen and missed so often."""
        c = len(times)
        return cls(times, np.zeros((c, 2)), np.zeros(1, np.int64), np.zeros(c, np.bool_))


class Rule(NamedTuple):
    """When a landmark is none."""

    seen_in: View
    least: float
    patience: int
    every: int
    """Poses from one look at the whole map to the next; 0 never looks."""


NEVER = Rule(View(0.0, 0.0, 0.0), 0.0, 0, 0)
"""All landmarks stay."""


class Presence:
    """Counts how often each landmark was seen, and how often it was not but should have been.

    Args:
        view: where a landmark should be seen.
        least: share of the times at which a landmark should have been seen that it must be.
        patience: times for which a landmark may hide before that counts.
        every: poses from one look at the whole map to the next.
    """

    def __init__(self, view: View, least: float, patience: int = 5, every: int = 4) -> None:
        self.rule = Rule(view, least, patience, every)
        self.watch = Watch.of(np.zeros((0, 2), np.int64))
        self.removed = 0
        """Landmarks that were taken out of the map."""

    def absent(self, ekf: EkfSlam, expected: FloatArray, found: IntArray) -> IntArray:
        """Hear what was seen in a scan.

        Args:
            ekf: the filter, after the scan.
            expected: (n, 2) range and bearing of the landmarks that were in the map before it.
            found: (m,) landmark of each observation, negative where it is of none.

        Returns:
            (k,) landmarks to be removed, of which nothing is kept here any more.
        """
        self.make_room(len(ekf))
        self.watch.expected[: len(expected)], self.watch.before[0] = expected, len(expected)
        look(self.watch, self.rule, len(ekf), found)
        return self.forget()

    def make_room(self, landmarks: int) -> None:
        """For a map of so many."""
        old, more = self.watch, landmarks - len(self.watch.gone)
        if more > 0:
            self.watch = Watch.of(np.concatenate([old.times, np.zeros((more, 2), np.int64)]))
            self.watch.expected[: len(old.gone)], self.watch.before[:] = old.expected, old.before

    def forget(self) -> IntArray:
        """Keep nothing of the landmarks (k,) that are gone."""
        gone = np.flatnonzero(self.watch.gone)
        if len(gone) > 0:
            self.watch = Watch.of(np.delete(self.watch.times, gone, 0))
            self.removed += len(gone)
        return gone


@kernel()
def _in_view(view: View, z: FloatArray) -> bool:
    return bool(z[0] < view.reach and view.right < z[1] < view.left)


@kernel()
def look(w: Watch, rule: Rule, landmarks: int, found: IntArray) -> bool:
    """Count what was `found` (m,) of so many landmarks; gives whether any of them is gone."""
    seen, missed, before = w.times[:, 0], w.times[:, 1], w.before[0]
    for i in range(before):
        missed[i] += _in_view(rule.seen_in, w.expected[i])
    for i in range(len(found)):
        if found[i] >= 0:
            seen[found[i]] += 1
            if found[i] < before:
                missed[found[i]] -= _in_view(rule.seen_in, w.expected[found[i]])
    any_gone = False
    for i in range(landmarks):
        w.gone[i] = missed[i] > rule.patience and seen[i] < rule.least * (seen[i] + missed[i])
        any_gone = any_gone or w.gone[i]
    return any_gone
