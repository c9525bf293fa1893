"""The interface of data association."""

from collections.abc import Sequence

import numpy as np

from saccade.io.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import BoolArray, FloatArray, IntArray


class Association:
    """A data-association rule.

    One that learns from scan to scan has its own `to_arrays` and `from_arrays`, for checkpoints;
    one that uses identities, the methods that are about them.
    """

    has_unnamed: bool = True
    """Whether there may be a landmark without an identity. The others are not culled: it is an
    identity that tells a landmark that is gone from one that is not detected."""
    stale: Sequence[int] = ()
    """Landmarks that are to be removed."""
    refused: BoolArray = np.zeros(0, np.bool_)
    """(m,) whether the identity of each observation of the last scan was refused; empty for a rule
    that refuses none."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate a scan.

        Args:
            ekf: the filter, predicted to the pose of the scan.
            z: (m, 2) range in metres, bearing in radians.
            R: (m, 2, 2) their covariances.
            identity: (m,) of the landmarks as given by the log, -1 where it is unknown.

        Returns:
            (m,) the number of the landmark in the map, `NEW` or `DROPPED`. The next free numbers
            add landmarks without waiting for more observations.
        """
        raise NotImplementedError

    def added(self, landmark: int, identity: int) -> None:
        """Called when an observation of `identity` was added to the map as number `landmark`."""
        return

    def landmarks(self, names: list[int]) -> list[int]:
        """Landmark of the map of each identity, -1 for none."""
        return [-1] * len(names)

    def identities(self, landmarks: int) -> IntArray:
        """(n,) identity of each landmark of a map of n, -1 where it has none."""
        return np.full(landmarks, -1)

    def bind(self, identity: int, landmark: int) -> None:
        """Give an identity that has no landmark the one of another map."""
        return

    def removed(self, number: IntArray) -> None:
        """Called when landmarks were removed: `number` (n,) is that of each now, -1 for none."""
        return

    def forget_from(self, landmarks: int) -> None:
        """Take back identities of landmarks from a number on, which are not added."""
        return

    def to_arrays(self) -> Arrays:
        """Its state as named arrays; none by default."""
        return {}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        return
