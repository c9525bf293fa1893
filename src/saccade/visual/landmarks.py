"""Landmarks of the map beside their positions: descriptors and counts."""

from dataclasses import dataclass

import numpy as np

from saccade.types import FloatArray, IntArray
from saccade.visual.optical_flow import ByteArray
from saccade.visual.table import Table, column

AGE_WEIGHT = 1e-3
"""Of the relative age beside the miss rate: it decides between equal ones."""


@dataclass(frozen=True, eq=False)
class Landmarks(Table):
    """n landmarks in the order of their rows in the filter."""

    id: IntArray = column(dtype=np.int64)
    """(n,) ascending; an id is never given twice."""
    height: FloatArray = column()
    """(n,) metres above the robot's origin."""
    descriptor: ByteArray = column(128, dtype=np.uint8)
    """(n, 128) at the first observation."""
    observations: IntArray = column(dtype=np.int64)
    """(n,) frames in which it was observed."""
    missed: IntArray = column(dtype=np.int64)
    """(n,) frames in which it was expected and not re-identified."""
    last_observed: IntArray = column(dtype=np.int64)
    """(n,) number of the frame."""

    def rows(self, ids: IntArray) -> IntArray:
        """(k,) rows of landmarks, -1 for those that were removed."""
        if len(self) == 0:
            return np.full(len(ids), -1)
        rows = np.searchsorted(self.id, ids).clip(0, len(self) - 1)
        return np.where(self.id[rows] == ids, rows, -1)

    def least_useful(self, count: int, tracked: IntArray, frame: int) -> IntArray:
        """Landmarks to be removed: those with the highest miss rate, of equal ones the oldest.

        Args:
            count: how many.
            tracked: ids of landmarks that are tracked, and stay.
            frame: number of the present one.

        Returns:
            (count,) rows, ascending.
        """
        miss_rate = (self.missed + 1) / (self.observations + self.missed + 2)
        score = miss_rate + AGE_WEIGHT * ((frame - self.last_observed) / (frame + 1))
        rows = self.rows(tracked)
        score[rows[rows >= 0]] = -1.0
        return np.sort(np.argsort(-score, kind="stable")[:count])
