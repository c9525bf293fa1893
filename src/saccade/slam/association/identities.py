"""Data association by landmark identities that may be wrong, and by geometry without one.

An identity is accepted where the observation is inside the gate of its landmark: nearly always.
What follows from one that is not is rare, and plain NumPy.
"""

from dataclasses import dataclass, field, fields

import numpy as np

from saccade.io.checkpoint import (
    Arrays,
    attribute_arrays,
    merge,
    restore_attributes,
    select,
)
from saccade.slam.association._kernels import DROPPED, NEW, Gates, compare_identities
from saccade.slam.association.nearest_neighbor import associate_by_geometry, squared_distances
from saccade.slam.config import EkfConfig
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.models import inverse_observe
from saccade.types import FloatArray, IntArray

UNDECIDED = -3
"""Association of an observation for which geometry is still to be asked."""
ESTABLISHED = 3
"""Accepted observations after which an identity may contradict the filter, along with others."""


@dataclass
class Identity:
    """What is known of an identity. Times count the identified observations before."""

    landmark: int = -1
    """Number in the map, -1 for none."""
    accepted: int = 0
    """Observations that were accepted for that landmark."""
    accepted_at: int = -1
    """Time of the last of them."""
    refused_at: int = -1
    """Time of the last refused observation."""
    votes: int = 0
    """Refused observations, one after the other, at one position."""
    since: int = -1
    """Time of the first of them."""
    target: int = UNDECIDED
    """Landmark that they are near to, `NEW` or `UNDECIDED`."""
    closings: int = 0
    """Recent observations that would close a loop by themselves."""
    closing_at: int = -1
    """Time of the last of them."""
    xy: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,) position in the map of the last refused observation."""
    covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """(2, 2) of its noise."""

    @property
    def is_established(self) -> bool:
        """Whether it may contradict the filter."""
        return self.accepted >= ESTABLISHED


TRUSTED = 10
"""Accepted observations after which an identity alone is believed against the filter, and refused
ones at one position after which it moves there, whatever was accepted."""
JOINT = 3
"""Identities or observations, refused by the filter, that are believed if they agree against it."""
WINDOW = 10
"""Identified observations for which a refused one is remembered."""
FAR = 100.0
"""Normalized innovation squared up to which a wrong filter is likelier than swapped identities; and
the gate before a long loop is closed, where the heading is too uncertain for a linear one."""
LOOSE, LOOP, LONG_LOOP = 4.0, 100.0, 1000.0
"""Ratio of predicted variance to noise from which the identities of a scan are checked in pairs,
and from which one observation of a landmark of few, or of any number, does not close a loop."""
STATE = ("stale", "has_unnamed", "_clock", "_streak", "_believed_until")
"""Attributes of `Association` that change from scan to scan, beside `known`."""
PAIR_GATE = 10.83
"""Squared deviation, in standard deviations, of the distance of two landmarks: 99.9 %."""


class Association:
    """Association by identity where there is one, if it agrees with the map; else by geometry.

    An identity is refused if the observation is outside the gate of its landmark. It is believed
    all the same where several identities agree with one another against the filter. Where the pose
    is so uncertain that it closes a loop, two identities of a scan must agree, or one be repeated.
    Several refused ones at one position move the identity there: the landmark has moved, or its
    first observation had the wrong identity.

    With "known" association no identity is doubted. Observations without one are dropped then, and
    so is a second observation, in one scan, of a landmark that is not in the map yet.
    """

    def __init__(self, config: EkfConfig) -> None:
        self.gates = Gates(
            chi_square_gate(2, config.gate),
            chi_square_gate(2, config.new_gate),
            config.association != "nearest",
        )
        """Of observations without an identity, and of those whose identity is refused."""
        self.known: dict[int, Identity] = {}
        """What is known of each identity."""
        self.stale: list[int] = []
        """Landmarks that have lost their identity, and are to be removed."""
        self.has_unnamed = False
        """Whether there may be a landmark without an identity. The others are not culled: it is an
        identity that tells a landmark that is gone from one that is not detected."""
        self.refused = np.zeros(0, np.bool_)
        """(m,) whether the identity of each observation of the last scan was refused."""
        self._believed = config.association == "known"
        self._clock = self._streak = 0  # identified observations; refused since the last accepted
        self._believed_until = -1
        self._gate = chi_square_gate(2, config.name_gate)

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
        names = identity.tolist()
        if self._believed:
            return self._look_up(len(ekf), names)
        self.refused = np.zeros(len(names), np.bool_)
        self.has_unnamed = self.has_unnamed or min(names) < 0
        if max(names) < 0:
            return associate_by_geometry(ekf, z, R, self.gates)
        association = np.array(self.gate_identities(ekf, z, R, names), np.int64)
        rest = np.flatnonzero(association == UNDECIDED)
        if len(rest) > 0:
            taken = association[association >= 0]
            near = associate_by_geometry(ekf, z[rest], R[rest], self.gates, taken)
            self.resolve_identities(len(ekf), names, rest.tolist(), near.tolist(), association)
        return association

    def _look_up(self, free: int, names: list[int]) -> IntArray:
        """(m,) landmark of each identity, new ones from number `free` on."""
        new: set[int] = set()  # identities first observed in this scan
        association = np.full(len(names), DROPPED)
        for i, name in enumerate(names):
            if name < 0 or name in new:
                continue
            known = self.known.setdefault(name, Identity())
            if known.landmark < 0:
                known.landmark = free + len(new)
                new.add(name)
            association[i] = known.landmark
        return association

    def gate_identities(
        self, ekf: EkfSlam, z: FloatArray, R: FloatArray, names: list[int]
    ) -> list[int]:
        """Accept the observations that agree with the landmarks of their identities.

        Returns:
            The landmark of each of these, `DROPPED`, and `UNDECIDED` for all others. Fills
            `refused`. Where several identities contradict the filter and agree with one another,
            it is the filter that is wrong: they are accepted.
        """
        m, association, number = len(names), [UNDECIDED] * len(names), self.landmarks(names)
        known = {i: self.known[names[i]] for i in range(m) if number[i] >= 0}
        if not known:
            return association
        nis, looseness = _compare(ekf, z, R, np.array(number, np.int64))
        gate = [FAR if each > LOOP else self._gate for each in looseness]
        refused = {i for i in known if not nis[i] <= gate[i]}
        scan = _Positions(ekf, z, R)
        if any(looseness[i] > LOOSE for i in known.keys() - refused):
            self._refuse_inconsistent(scan, known, refused)
        closing = sum(looseness[i] > LOOP for i in known if i not in refused)
        num_accepted, start = 0, self._clock
        for i, name in known.items():
            self._clock += 1
            few = not name.is_established
            self._streak += i in refused and not few
            loose = looseness[i] > (LOOP if few else LONG_LOOP)
            alone = loose and closing <= 1 and i not in refused
            if alone and few and self._is_duplicate(scan, i, name):
                refused.add(i)
            if i in refused:
                self._remember(scan, i, name)
            elif alone and not self._is_repeated(name):
                association[i] = DROPPED
            else:
                num_accepted += 1
                self._streak = 0
        believed = {
            i for i in refused if self._is_believed(ekf, known[i], nis[i], num_accepted, start)
        }
        if believed:
            self._believed_until = self._clock + WINDOW
        elif num_accepted > 0:
            self._believed_until = -1
        for i, name in known.items():
            if (i not in refused or i in believed) and association[i] != DROPPED:
                association[i] = name.landmark
                name.accepted += 1
                name.accepted_at, name.votes = self._clock, 0
        self.refused[list(refused - believed)] = True
        return association

    def resolve_identities(
        self, free: int, names: list[int], rest: list[int], near: list[int], association: IntArray
    ) -> None:
        """Associate the observations `rest`, given the landmark that each is near to.

        A first observation of an identity is of a new landmark, of which `free` is the next number,
        or of one without an identity. A refused one is not used; after several at one position the
        identity moves there.
        """
        for i, landmark in zip(rest, near, strict=True):
            j, association[i] = landmark, DROPPED
            if names[i] < 0:
                association[i] = j
                continue
            name = self.known.setdefault(names[i], Identity())
            if not self.refused[i]:
                if name.landmark < 0:
                    if j < 0 or self._is_named(j):
                        j, free = free, free + 1
                    name.landmark, name.accepted, name.votes = j, 1, 0
                    name.accepted_at = self._clock
                    association[i] = j
                continue
            if not name.is_established and (j == DROPPED or (j >= 0 and self._is_named(j))):
                j = NEW  # the only landmark that the observation may not be near is its own
            if j != DROPPED and name.target not in (UNDECIDED, DROPPED, j):
                name.votes, name.since = 1, self._clock
            name.target = j
            if j != DROPPED and self._moves(name, j):
                if j < 0:
                    j, free = free, free + 1
                self._move(name, j)
                association[i] = j

    def landmarks(self, names: list[int]) -> list[int]:
        """Landmark of the map of each identity, -1 for none."""
        known = self.known
        return [known[name].landmark if name in known else -1 for name in names]

    def bind(self, identity: int, landmark: int) -> None:
        """Give an identity that has no landmark the one of another map."""
        name = self.known.setdefault(identity, Identity())
        if name.landmark < 0:
            name.landmark, name.accepted = landmark, ESTABLISHED

    def forget_from(self, landmarks: int) -> None:
        """Take back identities of landmarks from a number on, which are not added."""
        for name in self.known.values():
            if name.landmark >= landmarks:
                name.landmark = -1

    def removed(self, number: IntArray) -> None:
        """Called when landmarks were removed: `number` (n,) is that of each now, -1 for none."""
        for name in self.known.values():
            if name.landmark >= 0:
                name.landmark = int(number[name.landmark])
            if name.target >= 0:
                name.target = int(number[name.target])
                if name.target < 0:
                    name.target, name.votes = UNDECIDED, 0
        self.stale = []

    def identities(self, landmarks: int) -> IntArray:
        """(n,) identity of each landmark of a map of n, -1 where it has none."""
        found = np.full(landmarks, -1)
        for identity, name in self.known.items():
            if name.landmark >= 0:
                found[name.landmark] = identity
        return found

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        known = self.known or {-1: Identity()}  # for the shapes
        columns = {
            each.name: np.array([getattr(name, each.name) for name in known.values()])
            for each in fields(Identity)
        }
        columns["name"] = np.array(list(known))
        rows = {name: column[: len(self.known)] for name, column in columns.items()}
        return attribute_arrays(self, *STATE) | merge({"known": rows})

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        rows = select(arrays, "known")
        names = rows.pop("name", np.zeros(0)).tolist()  # of a rule of another version
        columns = [each if each.ndim > 1 else each.tolist() for each in rows.values()]
        known = [
            Identity(**dict(zip(rows, row, strict=True))) for row in zip(*columns, strict=True)
        ]
        self.known = dict(zip(names, known, strict=True))
        self.stale = []
        restore_attributes(self, {name: each for name, each in arrays.items() if name in STATE})

    def _is_named(self, landmark: int) -> bool:
        return any(name.landmark == landmark for name in self.known.values())

    def _moves(self, name: Identity, j: int) -> bool:
        """Whether an identity moves to landmark j, or to a new one for `NEW`."""
        if name.votes < min(name.accepted + 1, TRUSTED):
            return False
        others = (each for each in self.known.values() if j >= 0 and each.landmark == j)
        if any(each.accepted_at >= name.since for each in others):
            name.votes = 0
            return False  # the landmark has an identity that is accepted
        return True

    def _move(self, name: Identity, j: int) -> None:
        """Give an identity to landmark j; the one before is removed if few observations made it."""
        old, name.landmark = name.landmark, j
        self.has_unnamed = True
        if old >= 0 and not name.is_established and not self._is_named(old):
            self.stale.append(old)
        name.accepted, name.votes, name.accepted_at = name.votes, 0, self._clock

    def _is_repeated(self, name: Identity) -> bool:
        """Count an observation that closes a loop by itself; whether there are enough."""
        if self._clock - name.closing_at > WINDOW:
            name.closings = 0
        name.closings += 1
        name.closing_at = self._clock
        return name.closings >= JOINT

    def _is_duplicate(self, scan: "_Positions", i: int, name: Identity) -> bool:
        """Whether a landmark with a better known identity is where the one of `name` is.

        The first observation of that identity was wrong then, and i is of another landmark.
        """
        others = [n.landmark for n in self.known.values() if n.landmark >= 0 and n.is_established]
        inside = scan.ekf.to_view(np.array(others, np.int64)) >= 0
        others = [j for j, near in zip(others, inside, strict=True) if near and j != name.landmark]
        xy, C = scan.position(i)
        r, state = scan.ekf.view.robot_size, scan.ekf.view.state
        positions = state[r:].reshape(-1, 2)[scan.ekf.to_view(np.array([name.landmark, *others]))]
        squared = ((positions[1:] - positions[0]) ** 2).sum(1)
        near = (squared < LOOSE * PAIR_GATE * C.trace()).tolist()
        return any(
            _distances_agree(scan.ekf, name.landmark, j, xy, C, xy, C)
            for j, is_near in zip(others, near, strict=True)
            if is_near
        )

    def _remember(self, scan: "_Positions", i: int, name: Identity) -> None:
        """Note a refused observation of an identity."""
        xy, C = scan.position(i)
        if name.votes > 0 and squared_distances(xy - name.xy, C + name.covariance) <= PAIR_GATE:
            name.votes += 1
        else:
            name.votes, name.since, name.target = 1, self._clock, UNDECIDED
        name.xy, name.covariance, name.refused_at = xy, C, self._clock

    def _is_believed(
        self, ekf: EkfSlam, name: Identity, nis: float, num_accepted: int, scan_start: int
    ) -> bool:
        """Whether a refused identity and others that agree with it are believed, not the filter.

        Either there are more of them than of those that were accepted or that contradict it, or
        none was accepted since, and none contradicts it. Once identities are believed, one is
        enough until one is accepted: the filter is corrected step by step.
        """
        if not name.is_established:
            return False
        recovering = self._clock <= self._believed_until
        first = scan_start if recovering else self._clock - WINDOW
        supporting, contradicting = 1, 0
        for other in self.known.values():
            recent = other.votes > 0 and other.refused_at > first and other.landmark >= 0
            if other is name or not recent or not other.is_established:
                continue
            landmarks, position = (name.landmark, other.landmark), (name.xy, name.covariance)
            if _distances_agree(ekf, *landmarks, *position, other.xy, other.covariance):
                supporting += 1
            else:
                contradicting += 1
        if (recovering or supporting >= JOINT) and supporting > max(num_accepted, contradicting):
            return True
        if supporting == 1:
            swapped = name.votes > 1 and name.target >= 0 and nis > FAR
            if swapped or name.accepted < TRUSTED:
                return False
        enough = JOINT if nis > FAR else JOINT - 1
        return self._streak >= enough and contradicting == 0

    def _refuse_inconsistent(
        self, scan: "_Positions", known: dict[int, Identity], refused: set[int]
    ) -> None:
        """Refuse identities whose landmarks are not as far from one another as the observations.

        An uncertain prediction, as before a loop is closed, accepts many landmarks; the distances
        between landmarks are certain all the same.
        """
        names = [i for i in known if i not in refused]
        conflicts = np.zeros((len(names), len(names)), np.bool_)
        for p, i in enumerate(names):
            for q, j in enumerate(names[:p]):
                a, b = known[i].landmark, known[j].landmark
                if a != b:
                    agree = _distances_agree(scan.ekf, a, b, *scan.position(i), *scan.position(j))
                    conflicts[p, q] = conflicts[q, p] = not agree
        while conflicts.any():
            count = conflicts.sum(1)
            for p in np.flatnonzero(count == count.max()).tolist():
                refused.add(names[p])
                conflicts[p] = conflicts[:, p] = False


class _Positions:
    """Positions in the map of the observations of a scan, computed where they are asked for."""

    def __init__(self, ekf: EkfSlam, z: FloatArray, R: FloatArray) -> None:
        self.ekf, self._z, self._R = ekf, z, R
        self._positions: tuple[FloatArray, FloatArray] | None = None

    def position(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Position (2,) of observation i, and the covariance (2, 2) of its noise."""
        if self._positions is None:
            xy, _, Gz = inverse_observe(self.ekf.pose, self._z)  # C.15
            self._positions = xy, Gz @ self._R @ Gz.transpose(0, 2, 1)
        return self._positions[0][i], self._positions[1][i]


def _compare(
    ekf: EkfSlam, z: FloatArray, R: FloatArray, landmark: IntArray
) -> tuple[list[float], list[float]]:
    """Compare observations with landmarks, -1 for none.

    Returns:
        Normalized innovations squared, infinite without a landmark, and the variance of each
        prediction over that of the observation, the larger of the two.
    """
    nis, looseness = np.full(len(z), np.inf), np.zeros(len(z))
    compare_identities(ekf.view, z, R, ekf.to_view(landmark), nis, looseness)
    return nis.tolist(), looseness.tolist()


def _distances_agree(
    ekf: EkfSlam,
    a: int,
    b: int,
    xy: FloatArray,
    C: FloatArray,
    other_xy: FloatArray,
    other_C: FloatArray,
) -> bool:
    """Whether two observed points are as far from each other as landmarks a and b of the map."""
    mean, joint = ekf.relative_position(a, b)
    observed, mapped = float(np.hypot(*(xy - other_xy))), float(np.hypot(*mean))
    variance = 0.0
    if observed > 0:
        along = (xy - other_xy) / observed
        variance += float(along @ (C + other_C) @ along)
    if mapped > 0:
        along = mean / mapped
        variance += max(float(along @ joint @ along), 0.0)
    return (observed - mapped) ** 2 <= PAIR_GATE * variance
