"""Known data association: the log identifies its landmarks."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.association._kernels import DROPPED, NEW
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Arrays
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray


@dataclass
class KnownIdentity(Association):
    """Known data association.

    Observations without an identity are dropped, and so is a second observation, in one scan,
    of a landmark that is not in the map yet.
    """

    number: dict[int, int] = field(default_factory=dict)
    """Landmark in the map of each identity observed so far."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Look each identity up; see `Association`."""
        names = identity.tolist()
        number = [self.number.get(name, NEW) if name >= 0 else DROPPED for name in names]
        for i, name in enumerate(names):
            if number[i] == NEW and name in names[:i]:
                number[i] = DROPPED
        return np.array(number, np.int64)

    def added(self, landmark: int, identity: int) -> None:
        """Remember which landmark it became."""
        self.number[identity] = landmark

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return {
            "identity": np.array(list(self.number), np.int64),
            "number": np.array(list(self.number.values()), np.int64),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.number = dict(zip(arrays["identity"].tolist(), arrays["number"].tolist(), strict=True))


def number_by_first_observation(identity: IntArray, pose: IntArray) -> IntArray:
    """The association by `KnownIdentity` of a whole log.

    Args:
        identity: (k,) of the landmarks, -1 where it is unknown.
        pose: (k,) from which each was observed, ascending.

    Returns:
        (k,) number of the landmark in the map, in the order of first observation; `DROPPED` for
        observations without an identity, and for repeated ones from the first pose.
    """
    _, first, which = np.unique(identity, return_index=True, return_inverse=True)
    repeated = (pose == pose[first[which]]) & (np.arange(len(pose)) != first[which])
    named = np.flatnonzero(identity[first] >= 0)
    number = np.full(len(first), DROPPED, np.int64)
    number[named[np.argsort(first[named])]] = np.arange(len(named))
    return np.where(repeated, DROPPED, number[which])
