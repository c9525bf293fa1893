"""The map while it grows, for a film or for someone who watches."""

from collections.abc import Callable, Sequence

import numpy as np

from saccade.errors import require
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray, MapSnapshot


class Recorder:
    """Takes a snapshot of the map every so many poses.

    Args:
        frames: how many snapshots there will be, at most.
        heard: told after each of them, with all there are.
    """

    def __init__(
        self, frames: int = 240, on_snapshot: Callable[[Sequence[MapSnapshot]], None] | None = None
    ) -> None:
        require(frames >= 1, "frames", "at least 1", frames)
        self.snapshots: list[MapSnapshot] = []
        self._frames = frames
        self._on_snapshot = on_snapshot
        self._path: list[FloatArray] = []
        self._seen: set[int] = set()

    def add(self, step: int, steps: int, ekf: EkfSlam, seen: IntArray) -> None:
        """Hear of a pose.

        Args:
            step: its number.
            steps: how many poses the log has.
            ekf: the filter, after all observations of this pose.
            seen: numbers of the landmarks that were observed from here, negative where one
                was not used.
        """
        self._path.append(ekf.pose)
        self._seen.update(seen[seen >= 0].tolist())
        if (steps - 1 - step) % -(-steps // self._frames) != 0:  # the last one is always taken
            return
        self.snapshots.append(
            MapSnapshot(
                step=step,
                path=np.array(self._path),
                covariance=ekf.pose_covariance,
                landmarks=ekf.landmarks,
                landmark_covariance=ekf.landmark_covariances,
                ids=ekf.ids,
                observed=np.array(sorted(n for n in self._seen if n < len(ekf)), np.int64),
            )
        )
        self._path, self._seen = [], set()
        if self._on_snapshot is not None:
            self._on_snapshot(self.snapshots)
