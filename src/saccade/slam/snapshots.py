"""Snapshots of the map while it grows, for a film or a live view."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from saccade.errors import require
from saccade.io.checkpoint import Arrays, merge, select
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.results import PoseHypotheses
from saccade.types import BoolArray, FloatArray, IntArray, MapSnapshot


class Recorder:
    """Records snapshots of the map at regular intervals.

    Args:
        frames: largest number of snapshots.
        on_snapshot: called after each of them, with all there are.
    """

    def __init__(
        self, frames: int = 240, on_snapshot: Callable[[Sequence[MapSnapshot]], None] | None = None
    ) -> None:
        require(frames >= 1, "frames", "at least 1", frames)
        self.snapshots: list[MapSnapshot] = []
        self._frames = frames
        self._on_snapshot = on_snapshot
        self._path: list[FloatArray] = []
        self._observed: set[int] = set()

    def is_due(self, step: int, steps: int) -> bool:
        """Whether a snapshot is taken at this pose of so many; at the last one always."""
        return (steps - 1 - step) % -(-steps // self._frames) == 0

    def add(
        self,
        step: int,
        steps: int,
        ekf: EkfSlam,
        observed: IntArray,
        confirmed: BoolArray | None = None,
        hypotheses: PoseHypotheses | None = None,
        covariance: FloatArray | None = None,
    ) -> None:
        """Record a pose.

        Args:
            step: its number.
            steps: how many poses the log has.
            ekf: the filter, after all observations of this pose.
            observed: numbers of the landmarks that were observed from this pose, negative for
                unused observations.
            confirmed: (N,) the landmarks of the filter that are shown, where a snapshot is due; all
                by default.
            hypotheses: of the pose of a lost robot.
            covariance: (3, 3) of the pose; by default that of the filter.
        """
        self._path.append(ekf.pose)
        self._observed.update(observed[observed >= 0].tolist())
        if not self.is_due(step, steps):
            return
        shown = np.ones(len(ekf), np.bool_) if confirmed is None else confirmed
        was_observed = np.isin(np.arange(len(ekf)), list(self._observed))
        rows = np.empty((0, 4))
        if hypotheses is not None:
            rows = np.column_stack([hypotheses.pose, hypotheses.probability])
        self.snapshots.append(
            MapSnapshot(
                step=step,
                path=np.array(self._path),
                covariance=ekf.pose_covariance if covariance is None else covariance,
                landmarks=ekf.landmarks[shown],
                landmark_covariance=ekf.landmark_covariances[shown],
                ids=ekf.ids[shown],
                observed=np.flatnonzero(was_observed[shown]),
                hypotheses=rows,
            )
        )
        self._path, self._observed = [], set()
        if self._on_snapshot is not None:
            self._on_snapshot(self.snapshots)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        snapshots = {
            str(i): {name: np.asarray(value) for name, value in asdict(snapshot).items()}
            for i, snapshot in enumerate(self.snapshots)
        }
        return {
            **merge(snapshots),
            "count": np.array(len(self.snapshots)),
            "path": np.array(self._path).reshape(-1, 3),
            "observed": np.array(sorted(self._observed), np.int64),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        saved: list[dict[str, Any]] = [select(arrays, str(i)) for i in range(int(arrays["count"]))]
        self.snapshots = [MapSnapshot(**{**each, "step": int(each["step"])}) for each in saved]
        self._path, self._observed = list(arrays["path"]), set(arrays["observed"].tolist())
