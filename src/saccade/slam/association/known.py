"""Known data association: the log identifies its landmarks."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.association._kernels import DROPPED
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
        """Look each identity up; see `Association`. New landmarks get the next free numbers."""
        return self.number_ahead(identity, np.zeros(len(identity), np.int64), len(ekf))

    def number_ahead(self, identity: IntArray, scan: IntArray, mapped: int) -> IntArray:
        """Associate consecutive scans of which every new landmark is added to the map.

        Args:
            identity: (k,) of the landmarks, -1 where it is unknown.
            scan: (k,) in which each was observed, ascending.
            mapped: landmarks in the map before.

        Returns:
            (k,) number of the landmark in the map, in the order of first observation, or `DROPPED`.
        """
        first: dict[int, int] = {}  # scan of each new landmark
        association = []
        for name, i in zip(identity.tolist(), scan.tolist(), strict=True):
            if name < 0 or first.get(name) == i:
                association.append(DROPPED)
                continue
            if name not in self.number:
                self.number[name], first[name] = mapped + len(first), i
            association.append(self.number[name])
        return np.array(association, np.int64)

    def identities(self, landmarks: int) -> IntArray:
        """(n,) identity of each landmark of a map of n, -1 where it has none."""
        found = np.full(landmarks, -1)
        for identity, number in self.number.items():
            if number < landmarks:
                found[number] = identity
        return found

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return {
            "identity": np.array(list(self.number), np.int64),
            "number": np.array(list(self.number.values()), np.int64),
        }

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.number = dict(zip(arrays["identity"].tolist(), arrays["number"].tolist(), strict=True))
