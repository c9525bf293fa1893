"""Data association by landmark identities that may be wrong, and by geometry without one."""

from dataclasses import dataclass, field

import numpy as np

from saccade.slam.association._name_kernels import (
    contradicts_uncertain,
    judge_names,
)
from saccade.slam.association._name_table_kernels import (
    ESTABLISHED,
    STALE,
    UNDECIDED,
    UNNAMED,
    NamedScan,
    NameGates,
    NameTable,
    settle_names,
)
from saccade.slam.association.consistent_names import consistent_names
from saccade.slam.association.gating import squared_distances
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association
from saccade.slam.checkpoint import Arrays
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.types import FloatArray, IntArray


@dataclass
class DoubtedIdentity(Association):
    """Association by identity where there is one, if it agrees with the map; else by geometry.

    An identity is refused if the observation is outside the gate of the landmark that it names.
    It is believed all the same where several names agree with one another against the filter.
    Where the pose is so uncertain that it closes a loop, two names of a scan must agree, or one be
    repeated. Several refused ones at one position move the name there: the landmark has moved, or
    its first observation had the wrong name.
    """

    gate: float = 0.99999
    """Probability with which an observation of the landmark that it names is accepted."""
    geometry: NearestNeighbor = field(default_factory=lambda: NearestNeighbor(mutual=True))
    """The rule of observations without a name, and of those whose name is refused."""

    def __post_init__(self) -> None:
        self._number: dict[int, int] = {}  # of each identity in the table
        self.table = _new_table(0)
        """What is known of each name, for kernels; `number` makes room for others."""
        self.refused = np.zeros(0, np.bool_)
        """(m,) whether the name of each observation of the last scan was refused."""
        self.looseness = 1.0
        """Of the last scan: the predicted variance over that of its observations, at most, where
        a name contradicts an uncertain prediction; else 1."""

    def __call__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray, identity: IntArray) -> IntArray:
        """Associate a scan; see `Association`."""
        name, table = self.number(identity), self.table
        association = np.full(len(z), UNDECIDED)
        self.refused, self.looseness = np.zeros(len(z), np.bool_), 1.0
        table.counts[UNNAMED] += (name < 0).sum()
        if (name < 0).all():
            return self.geometry(ekf, z, R, identity)
        seen = _compare_scan(ekf, table, z, R, name)
        state = ekf.filter_state
        if contradicts_uncertain(state, table, self.name_gates.gate, seen, name, self.refused):
            known = np.flatnonzero((name >= 0) & (table.landmark[name] >= 0))
            named = table.landmark[name[known]]
            points = seen.xy[known], seen.covariance[known]
            self.refused[known] = ~consistent_names(ekf, *points, named, self.gate)
            self.looseness = float(seen.looseness[known].max())
        judge_names(state, table, seen, name, association, self.refused)
        rest = np.flatnonzero(association == UNDECIDED)
        if len(rest) > 0:
            taken = association[association >= 0]
            near = self.geometry.associate(ekf, z[rest], R[rest], taken)
            settle_names(state, table, rest, near, name, association, self.refused)
        return association

    def number(self, identity: IntArray) -> IntArray:
        """Rows (k,) of the table for identities (k,), -1 where unknown; adds those that are new."""
        number = self._number
        rows = [
            number.setdefault(name, len(number)) if name >= 0 else -1 for name in identity.tolist()
        ]
        if len(number) > len(self.table.landmark):
            self.table = _grown(self.table, len(number))
        return np.array(rows, np.int64)

    def bind(self, identity: int, landmark: int) -> None:
        """Give an identity that has no landmark the one of another map."""
        row = int(self.number(np.array([identity]))[0])
        if self.table.landmark[row] < 0:
            self.table.landmark[row], self.table.accepted[row] = landmark, ESTABLISHED

    def removed(self, number: IntArray) -> None:
        """Called when landmarks were removed: `number` (n,) is that of each now, -1 for none."""
        landmark, target = self.table.landmark, self.table.target
        landmark[landmark >= 0] = number[landmark[landmark >= 0]]
        near = np.flatnonzero(target >= 0)
        target[near] = number[target[near]]
        gone = near[target[near] < 0]
        target[gone], self.table.votes[gone] = UNDECIDED, 0
        self.table.stale[:] = -1
        self.table.counts[STALE] = 0

    @property
    def stale(self) -> IntArray:
        """(n,) landmarks that are to be removed from the map."""
        if self.table.counts[STALE] == 0:
            return np.empty(0, np.int64)
        return np.unique(self.table.stale[self.table.stale >= 0])

    def identities(self, landmarks: int) -> IntArray:
        """(n,) identity of each landmark of a map of n, -1 where it has none."""
        found = np.full(landmarks, -1)
        for identity, number in self._number.items():
            landmark = self.table.landmark[number]
            if landmark >= 0:
                found[landmark] = identity
        return found

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        return {"identity": np.array(list(self._number), np.int64), **self.table._asdict()}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        identities = arrays["identity"].tolist()
        self._number = {identity: i for i, identity in enumerate(identities)}
        self.table = NameTable(*(arrays[name] for name in NameTable._fields))

    @property
    def name_gates(self) -> NameGates:
        """The gate as a squared Mahalanobis distance."""
        return NameGates(True, chi_square_gate(2, self.gate))


def _compare_scan(
    ekf: EkfSlam, table: NameTable, z: FloatArray, R: FloatArray, name: IntArray
) -> NamedScan:
    """Compare a scan with the landmarks that its names say, by any sensor model."""
    landmark = np.where(name >= 0, table.landmark[name], -1)
    known = np.flatnonzero(landmark >= 0)
    predicted = ekf.predict_observations()
    expected, S = predicted.z[landmark[known]], predicted.covariance[landmark[known]]
    nis, looseness = np.full(len(z), np.inf), np.zeros(len(z))
    v = ekf.sensor.difference(z[known], expected)
    nis[known] = squared_distances(v, S + R[known])
    looseness[known] = (S.diagonal(0, 1, 2) / R[known].diagonal(0, 1, 2)).max(1)
    xy, _, Gz = ekf.sensor.inverse_observe(ekf.pose, z)  # (m, 2), (m, 2, 2)
    return NamedScan(nis, looseness, xy, Gz @ R @ Gz.transpose(0, 2, 1))


def _new_table(names: int) -> NameTable:
    none = np.full(names, -1)
    return NameTable(
        landmark=none,
        accepted=np.zeros(names, np.int64),
        accepted_at=none.copy(),
        xy=np.zeros((names, 2)),
        covariance=np.zeros((names, 2, 2)),
        refused_at=none.copy(),
        votes=np.zeros(names, np.int64),
        since=none.copy(),
        target=np.full(names, UNDECIDED),
        closings=np.zeros(names, np.int64),
        closing_at=none.copy(),
        stale=none.copy(),
        counts=np.array([0, 0, -1, 0, 0]),
    )


def _grown(table: NameTable, names: int) -> NameTable:
    new = _new_table(names)
    for source, target in zip(table, new, strict=True):
        target[: len(source)] = source
    return new
