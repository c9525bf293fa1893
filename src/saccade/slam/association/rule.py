"""The interface of data association."""

from typing import Protocol

from saccade.slam.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray


class Association(Protocol):
    """A data-association rule.

    One that learns from scan to scan has its own `to_arrays` and `from_arrays`, for checkpoints.
    """

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

    def added(self, landmark: int, identity: int) -> None:
        """Called when an observation of `identity` was added to the map as number `landmark`."""
        return

    def to_arrays(self) -> Arrays:
        """Its state as named arrays; none by default."""
        return {}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        return
