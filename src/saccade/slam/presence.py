"""Landmarks that should have been seen and were not are no landmarks for long."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.ekf import EkfSlam
from saccade.types import FloatArray, IntArray, LandmarkLog


@dataclass(frozen=True)
class View:
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


@dataclass
class Presence:
    """Counts how often each landmark was seen, and how often it was not but should have been."""

    view: View
    least: float
    """Share of the times at which a landmark should have been seen that it must be."""
    patience: int = 5
    """Times for which a landmark may hide before that counts."""
    every: int = 4
    """Poses from one look at the whole map to the next."""
    seen: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,)."""
    missed: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,)."""
    removed: int = 0
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
        new = np.zeros(len(ekf) - len(self.seen), np.int64)
        self.seen, self.missed = np.append(self.seen, new), np.append(self.missed, new)
        found = found[found >= 0]
        self.seen[found] += 1
        distance, bearing = expected.T
        there = (distance < self.view.reach) & (bearing < self.view.left)
        there &= bearing > self.view.right
        there[found[found < len(there)]] = False
        self.missed[: len(there)] += there
        gone = (self.missed > self.patience) & (self.seen < self.least * (self.seen + self.missed))
        if not gone.any():
            return np.zeros(0, np.int64)
        self.seen, self.missed = self.seen[~gone], self.missed[~gone]
        self.removed += int(gone.sum())
        return np.flatnonzero(gone)
