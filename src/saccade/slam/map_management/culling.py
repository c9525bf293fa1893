"""Culls landmarks that are repeatedly missed while in view."""

import numpy as np

from saccade.slam.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.map_management._kernels import (
    CullingRule,
    FieldOfView,
    VisibilityCounts,
    check_visibility,
)
from saccade.types import FloatArray, IntArray, LandmarkLog


def field_of_view(log: LandmarkLog) -> FieldOfView:
    """The field of view of a log's sensor: ranges up to the median, and 90 % of the bearings.

    These quantiles are those of the whole log: with culling, a filtered pose depends, through
    these three numbers, on observations that come after it.
    """
    if len(log.observation) == 0:
        return FieldOfView(0.0, 0.0, 0.0)
    right, left = np.quantile(log.observation[:, 1], [0.05, 0.95]).tolist()
    return FieldOfView(float(np.median(log.observation[:, 0])), left, right)


class Culling:
    """Counts how often each landmark was observed, and how often missed while in view.

    Args:
        view: where a landmark is reliably detected; `field_of_view` takes it from the whole log.
        min_ratio: fraction of the checks in which a landmark was in view that it must have been
            observed; None culls none.
        max_missed: misses that are tolerated before that fraction counts.
        interval: poses from one check of the whole map to the next.
    """

    def __init__(
        self, view: FieldOfView, min_ratio: float | None, max_missed: int = 5, interval: int = 4
    ) -> None:
        enabled = min_ratio is not None
        self.rule = CullingRule(enabled, view, min_ratio or 0.0, max_missed, interval)
        self.counts = _new_counts(0)
        self.removed = 0
        """Landmarks that were culled."""

    def is_due(self, step: int) -> bool:
        """Whether the map is checked at this pose."""
        return self.rule.enabled and step % self.rule.interval == 0

    def update(self, ekf: EkfSlam, expected: FloatArray, association: IntArray) -> None:
        """Count the observed and the missed landmarks of a scan; marks those that are culled.

        Args:
            ekf: the filter, after the scan.
            expected: (n, 2) range and bearing, predicted before it, of the landmarks in the map.
            association: (m,) landmark of each observation, negative for none.
        """
        self.reserve(len(ekf))
        self.counts.expected[: len(expected)] = expected
        self.counts.mapped_before[0] = len(expected)
        check_visibility(self.counts, self.rule, len(ekf), association)

    def reserve(self, landmarks: int) -> None:
        """Make room for a map of so many landmarks."""
        if landmarks > len(self.counts.culled):
            old, self.counts = self.counts, _new_counts(landmarks)
            for source, target in zip(old, self.counts, strict=True):
                target[: len(source)] = source

    def remove_culled(self, others: IntArray) -> IntArray:
        """Remove the counts of the landmarks that are to be culled, and of others.

        Args:
            others: (n,) landmarks that are removed for other reasons.

        Returns:
            (k,) all of them.
        """
        culled = np.union1d(np.flatnonzero(self.counts.culled), others)
        if len(culled) > 0:
            kept = np.ones(len(self.counts.culled), np.bool_)
            kept[culled[culled < len(kept)]] = False
            old, self.counts = self.counts, _new_counts(int(kept.sum()))
            self.counts.observed[:], self.counts.missed[:] = old.observed[kept], old.missed[kept]
            self.removed += len(culled)
        return culled

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return {**self.counts._asdict(), "removed": np.array(self.removed)}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.removed = int(arrays["removed"])
        self.counts = VisibilityCounts(*(arrays[name] for name in VisibilityCounts._fields))


def _new_counts(capacity: int) -> VisibilityCounts:
    return VisibilityCounts(
        observed=np.zeros(capacity, np.int64),
        missed=np.zeros(capacity, np.int64),
        expected=np.zeros((capacity, 2)),
        mapped_before=np.zeros(1, np.int64),
        culled=np.zeros(capacity, np.bool_),
    )
