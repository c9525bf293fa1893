"""What is known of landmarks beside their place: how they look, and how often they were met."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray, IntArray


@dataclass
class Landmarks:
    """Landmarks of the map in the order of their rows in the filter."""

    id: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(n,) number for good, ascending."""
    height: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(n,) metres above the robot's origin."""
    descriptor: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 128), np.uint8))
    """(n, 128) when it was seen first."""
    observations: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(n,) frames in which it was met."""
    missed: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(n,) times that it was looked for in vain."""
    last_observed: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(n,) frame in which it was met last."""
    _next_id: int = field(default=0, init=False)

    def __len__(self) -> int:
        return len(self.id)

    def add(self, height: FloatArray, descriptor: npt.NDArray[np.uint8], frame: int) -> IntArray:
        """Take in new ones; returns their numbers (k,)."""
        k = len(height)
        new = np.arange(self._next_id, self._next_id + k)
        self._next_id += k
        self.id = np.append(self.id, new)
        self.height = np.append(self.height, height)
        self.descriptor = np.concatenate([self.descriptor, descriptor])
        self.observations = np.append(self.observations, np.ones(k, np.int64))
        self.missed = np.append(self.missed, np.zeros(k, np.int64))
        self.last_observed = np.append(self.last_observed, np.full(k, frame))
        return new

    def rows(self, numbers: IntArray) -> IntArray:
        """(k,) rows of landmarks, -1 for those that are gone."""
        if len(self.id) == 0:
            return np.full(len(numbers), -1)
        at = np.searchsorted(self.id, numbers).clip(0, len(self.id) - 1)
        return np.where(self.id[at] == numbers, at, -1)

    def count_observed(self, rows: IntArray, frame: int) -> None:
        """Count that landmarks were seen."""
        self.observations[rows] += 1
        self.last_observed[rows] = frame

    def keep(self, kept: npt.NDArray[np.bool_]) -> None:
        """Forget the others; `kept` is (n,)."""
        for name in ("id", "height", "descriptor", "observations", "missed", "last_observed"):
            setattr(self, name, getattr(self, name)[kept])

    def least_useful(self, count: int, followed: IntArray, frame: int) -> IntArray:
        """Which landmarks to give up.

        Those that were looked for in vain most often for each time that they were met, of
        equal ones those that were met longest ago.

        Args:
            count: how many.
            followed: numbers of those that are in view: they stay.
            frame: the present one.

        Returns:
            (count,) rows, ascending.
        """
        failing = (self.missed + 1) / (self.observations + self.missed + 2)
        age = (frame - self.last_observed) / (frame + 1)
        unwanted = failing + 1e-3 * age
        in_view = self.rows(followed)
        unwanted[in_view[in_view >= 0]] = -1.0
        return np.sort(np.argsort(-unwanted, kind="stable")[:count])
