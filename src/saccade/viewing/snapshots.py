"""Snapshots of the map while it grows, for a film or a live view."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from saccade.errors import require
from saccade.slam import PoseHypotheses, Slam
from saccade.types import FloatArray, IntArray, MapSnapshot


class SnapshotRecorder:
    """Records snapshots of the map at regular intervals: a `slam.Recorder`.

    Args:
        frames: largest number of snapshots.
        on_snapshot: called after each snapshot, with all snapshots so far.
    """

    def __init__(
        self,
        frames: int = 240,
        on_snapshot: Callable[[Sequence[MapSnapshot]], object] | None = None,
    ) -> None:
        require(frames >= 1, "frames", "at least 1", frames)
        self.snapshots: list[MapSnapshot] = []
        self._frames = frames
        self._on_snapshot = on_snapshot
        self._path: list[FloatArray] = []
        self._observed: set[int] = set()

    def is_due(self, step: int, steps: int) -> bool:
        """Whether a snapshot is due at pose `step` of `steps`; it always is at the last pose."""
        return (steps - 1 - step) % -(-steps // self._frames) == 0

    def add(
        self,
        step: int,
        steps: int,
        slam: Slam,
        observed: IntArray,
        hypotheses: PoseHypotheses | None = None,
        covariance: FloatArray | None = None,
    ) -> None:
        """Records the pose `step` of `steps` after its observations.

        Args:
            step: number of the pose.
            steps: number of poses.
            slam: SLAM at this pose.
            observed: (k,) ids of observed landmarks, negative for unused observations.
            hypotheses: hypotheses of the pose of a lost robot.
            covariance: (3, 3) of the pose; by default from the filter.
        """
        self._path.append(slam.filter.pose)
        self._observed.update(observed[observed >= 0].tolist())
        if not self.is_due(step, steps):
            return
        shown, rows = slam.map, np.empty((0, 4))
        if hypotheses is not None:
            rows = np.column_stack([hypotheses.pose, hypotheses.probability])
        self.snapshots.append(
            MapSnapshot(
                step=step,
                path=np.array(self._path),
                covariance=slam.filter.pose_covariance if covariance is None else covariance,
                landmarks=shown.xy,
                landmark_covariance=shown.covariance,
                ids=shown.id,
                observed=np.flatnonzero(np.isin(shown.id, list(self._observed))),
                hypotheses=rows,
            )
        )
        self._path, self._observed = [], set()
        if self._on_snapshot is not None:
            self._on_snapshot(self.snapshots)


def at_end(snapshots: Sequence[MapSnapshot], ids: IntArray) -> list[MapSnapshot]:
    """The snapshots, the last without landmarks that are not among those of the result."""
    if not snapshots:
        return []
    *others, last = snapshots
    kept = np.isin(last.ids, ids)
    row = np.cumsum(kept) - 1
    last = replace(
        last,
        landmarks=last.landmarks[kept],
        landmark_covariance=last.landmark_covariance[kept],
        ids=last.ids[kept],
        observed=row[last.observed[kept[last.observed]]],
    )
    return [*others, last]
