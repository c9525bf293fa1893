"""Times of frames: their order, and images of several cameras associated by time."""

from dataclasses import dataclass

import numpy as np

from saccade.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The n frames of a drive among the m frames that were recorded."""

    recorded: FloatArray
    """(m,) seconds of all frames, in the order of the files."""
    index: IntArray
    """(n,) indices of the frames of the drive among them, in the order of their times."""
    remarks: tuple[str, ...] = ()
    """What was wrong with the times, one line each."""

    @property
    def time(self) -> FloatArray:
        """(n,) seconds, strictly ascending."""
        return self.recorded[self.index]

    @classmethod
    def sort(
        cls, recorded: FloatArray, name: str, available: IntArray | None = None
    ) -> "FrameTimes":
        """Frames sorted by time; of several at the same time the first is kept.

        Args:
            recorded: (m,) seconds of all frames.
            name: of the file with the times, for the remarks.
            available: indices of the frames that have images; None for all.
        """
        if available is None:
            available = np.arange(len(recorded))
        time = recorded[available]
        order = np.argsort(time, kind="stable")
        is_new = np.diff(time[order], prepend=-np.inf) > 0
        backwards = np.flatnonzero(np.diff(time) < 0)
        remarks = []
        if len(backwards):
            remarks.append(
                f"{name}: time goes back {len(backwards)} times, first at frame "
                f"{backwards[0] + 1}; the frames are sorted by it"
            )
        if not is_new.all():
            remarks.append(
                f"{name}: duplicate times: {int((~is_new).sum())}, first at frame "
                f"{order[~is_new].min()}; only the first frame of each is kept"
            )
        index = available[order[is_new]]
        return cls(recorded, np.asarray(index, np.int64), tuple(remarks))


def associate(time: FloatArray, others: FloatArray, tolerance: float) -> IntArray:
    """Mutual nearest neighbors in time.

    Args:
        time: (n,) seconds.
        others: (m,) seconds.
        tolerance: largest difference, in seconds.

    Returns:
        (n,) index of the associated time in `others`, or -1.
    """
    if len(others) == 0:
        return np.full(len(time), -1)
    forward, distance = _nearest(time, others)
    backward, _ = _nearest(others, time)
    mutual = time[backward[forward]] == time
    return np.asarray(np.where(mutual & (distance <= tolerance), forward, -1), np.int64)


def _nearest(time: FloatArray, others: FloatArray) -> tuple[IntArray, FloatArray]:
    """For each time (n,) the index of the nearest of the others (m,), and its distance."""
    order = np.argsort(others, kind="stable")
    after = np.searchsorted(others[order], time)
    neighbors = order[np.stack([after - 1, after]).clip(0, len(others) - 1)]  # (2, n)
    distance = np.abs(others[neighbors] - time)
    nearest = distance.argmin(0), np.arange(len(time))
    return np.asarray(neighbors[nearest], np.int64), np.asarray(distance[nearest])
