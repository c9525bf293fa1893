"""The local map of a large one: steps at a cost that does not grow with the map.

The compressed filter of Guivant & Nebot (2001): while the robot stays among some landmarks A, the
changes of the others B are linear in their covariance with A at its arrival. With J a quarter turn,
E = [K, J K, d, J d] of that time, C_BA = K T^T with C_AA = T T^T, d the differences of the
points of B from their first estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of points that
are never observed; Phi is T at first. Thus the filter of `ekf` on A and on as many of these
auxiliary points as A has coordinates is equivalent to the full filter, and the update of B is
deferred. T keeps the numbers small: by C_BA itself, five digits would be lost.

A local map is entered with every landmark that an observation can be of until the robot has gone
some way: those within a radius of its position, or outside of it by less than twice their gate. It
is left where the range that a scan needs, and the way since then with the gate of its odometry,
exceed the radius, or where a landmark outside is observed by its identity.
"""

from dataclasses import dataclass
from math import hypot, isfinite, sqrt

import numpy as np

from saccade.slam.filter._state_kernels import STANDARD, FilterState, read_block, write_block
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.models import control_bias
from saccade.slam.filter.state import (
    add_rows,
    auxiliary_rows,
    flush,
    new_state,
    room_for_scan,
    state_rows,
    state_size,
    symmetric,
    with_capacity,
)
from saccade.slam.scans import Scan
from saccade.types import BoolArray, FloatArray, IntArray

HEADING_AND_NONLINEARITY = (
    *("heading_variance", "lowest_heading_variance", "nonlinearity", "nonlinear_updates"),
)
"""Scalars of a state that go with the robot."""
SPARE = 8
"""Landmarks, at least, that can be added to a local map before its arrays grow."""
ROUNDING = 1e-15
"""Fraction of a variance below which another one is zero."""
NEGLIGIBLE = 1e-7
"""Fraction of the smallest variance of the landmarks outside of a local map: directions in
which it reduces their variance by less than this are left as they were."""


@dataclass
class LocalMap:
    """Some landmarks, and what is deferred for the others."""

    inside: IntArray
    """(k,) their numbers in the map when it was entered, ascending."""
    rest: IntArray
    """(m,) those of all others."""
    number: IntArray
    """(k + m,) number in the local map of each landmark of that map, -1 for the others."""
    root: FloatArray
    """(L, q) T of C_AA = T T^T at its entry, of the robot and the landmarks inside."""
    observed: BoolArray
    """(k,) whether a landmark was observed since."""
    state: FilterState
    """Of the robot, the landmarks inside, q auxiliary points, and landmarks that were added."""

    def numbers(self, count: int) -> IntArray:
        """(count,) number in the map of its first landmarks, with those added or to be added."""
        added = len(self.number) + np.arange(count - len(self.inside))
        return np.concatenate([self.inside, added])

    def to_local(self, landmark: IntArray) -> IntArray:
        """See `EkfSlam.to_view`."""
        k, N = len(self.inside), len(self.number)
        known = (landmark >= 0) & (landmark < N)
        local = np.where(landmark < N, landmark, landmark - N + k)
        local[known] = self.number[landmark[known]]
        return local

    def to_map(self, local: IntArray) -> IntArray:
        """See `EkfSlam.from_view`."""
        k, N = len(self.inside), len(self.number)
        known = (local >= 0) & (local < k)
        landmark = np.where(local < k, local, local - k + N)
        landmark[known] = self.inside[local[known]]
        return landmark


class LargeMapSlam(EkfSlam):
    """`EkfSlam` that can defer what steps among some landmarks change about the others.

    `filter_state`, and with it every method that needs the landmarks, brings all of the map up to
    date, and ends the stay in the local map; the pose and its covariance do not need it.
    """

    local_map: LocalMap | None = None
    """Where the filter works at present."""

    @property
    def filter_state(self) -> FilterState:
        """The arrays of the filter of the whole map, up to date."""
        self.leave()
        return self._whole

    @filter_state.setter
    def filter_state(self, filter_state: FilterState) -> None:
        self._whole = filter_state
        self.local_map = None

    @property
    def robot(self) -> FilterState:
        """See `EkfSlam.robot`."""
        return self._whole if self.local_map is None else self.local_map.state

    @property
    def view(self) -> FilterState:
        """See `EkfSlam.view`."""
        return self.robot

    def to_view(self, landmarks: IntArray) -> IntArray:
        """See `EkfSlam.to_view`."""
        return landmarks if self.local_map is None else self.local_map.to_local(landmarks)

    def from_view(self, landmarks: IntArray) -> IntArray:
        """See `EkfSlam.from_view`."""
        return landmarks if self.local_map is None else self.local_map.to_map(landmarks)

    def mark_observed(self, landmarks: IntArray) -> None:
        """See `EkfSlam.mark_observed`."""
        if self.local_map is not None:
            observed = self.local_map.observed
            observed[landmarks[(landmarks >= 0) & (landmarks < len(observed))]] = True

    def reserve(self, observations: int = 1) -> None:
        """See `EkfSlam.reserve`."""
        if self.local_map is None:
            self._whole = room_for_scan(self._whole, observations)
        else:
            self.local_map.state = room_for_scan(self.local_map.state, observations)

    def __len__(self) -> int:
        if self.local_map is None:
            return int(self._whole.now.landmarks)
        return int(self.local_map.state.now.landmarks) + len(self.local_map.rest)

    def enter(self, inside: IntArray) -> LocalMap:
        """Work among these landmarks (k,), ascending, until `leave`."""
        f, r, N, k = self.filter_state, self.robot.robot_size, len(self), len(inside)
        number = np.full(N, -1)
        number[inside] = np.arange(k)
        rows = state_rows(inside, r)
        C, L = _block(f, rows, rows), len(rows)
        root = _root(C)
        q, room = root.shape[1], k + max(k // 4, SPARE)
        local = new_state(f.state[:r], f.P[:r, :r], room, f.error_state, f.huber, auxiliary=q + 1)
        for name in HEADING_AND_NONLINEARITY:
            setattr(local.now, name, getattr(f.now, name))
        local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
        local.P[:L, :L] = np.triu(C)
        local.P[:r, :r] = f.P[:r, :r]
        local.blocks[:k] = f.blocks[inside]
        first = auxiliary_rows(local).start
        local.P[:L, first:-2:2] = root
        local.state[-2] = 1.0
        local.heading_lever[-1] = 0.0 if f.error_state == STANDARD else 1.0
        local.now.landmarks = k
        rest, observed = np.flatnonzero(number < 0), np.zeros(k, np.bool_)
        self.local_map = LocalMap(inside, rest, number, root, observed, local)
        return self.local_map

    def leave(self) -> None:
        """Bring the filter of the whole map up to date."""
        place, self.local_map = self.local_map, None
        if place is None:
            return
        local, r = place.state, place.state.robot_size
        numbers = place.numbers(local.now.landmarks)
        flush(local)
        added = len(numbers) - len(place.inside)
        f = self._whole = with_capacity(self._whole, added, 0)
        n = state_size(local)
        f.downdates[:, state_size(f) :] = f.updates[:, state_size(f) :] = 0.0
        f.now.landmarks = len(place.number) + added
        for name in HEADING_AND_NONLINEARITY:
            setattr(f.now, name, getattr(local.now, name))
        rows = state_rows(numbers, r)
        if len(place.rest) > 0:
            _apply_deferred(f, place, rows)
        f.state[rows], f.heading_lever[rows] = local.state[:n], local.heading_lever[:n]
        f.blocks[numbers] = local.blocks[: len(numbers)]
        write_block(f.P, rows, rows, symmetric(local.P[:n, :n]) - _pending(f, rows, rows), 0.0)
        f.P[:r, :r] = local.P[:r, :r]
        f.cached_pair[:] = -1
        f.now.cached = 0


def _apply_deferred(f: FilterState, place: LocalMap, rows: IntArray) -> None:
    """Apply the deferred updates to the landmarks outside the local map.

    All of them are in the space of the rows of C_AA that were observed, and of d.
    """
    local, r, root = place.state, f.robot_size, place.root
    old, rest = len(root), state_rows(place.rest, r)[r:]
    observed = state_rows(np.flatnonzero(place.observed), r)
    space, factor = _row_space(root[observed])  # (q, p), (o, p)
    E = np.empty((len(rest), space.shape[1] + 1))
    E[:, :-1] = _block(f, rest, state_rows(place.inside, r)[observed]) @ factor
    E[:, -1] = _quarter_turn(-f.heading_lever[rest])  # d = -J a

    points = auxiliary_rows(local)
    both = _point_space(space)
    Phi = local.P[: len(rows), points] @ both
    Phi[r:old, :-2:2] -= root[r:old] @ space  # what has changed
    changed, new = rows[r:old], np.concatenate([rows[:r], rows[old:]])
    write_block(f.P, rest, changed, _combined(E, Phi[r:old]), 1.0)  # C_BA
    write_block(f.P, rest, new, _combined(E, np.concatenate([Phi[:r], Phi[old:]])), 0.0)

    delta = local.state[points][None] @ both
    if f.error_state != STANDARD:
        f.heading_lever[rest] = _quarter_turn(_combined(E, delta)[:, 0])
    delta[0, -2] -= 1.0
    f.state[rest] += _combined(E, delta)[:, 0]

    Psi = both.T @ symmetric(local.P[points, points]) @ both
    values, vectors = np.linalg.eigh(Psi)
    least = NEGLIGIBLE * f.blocks[place.rest][:, ::2].min()
    for sign in (-1.0, 1.0):
        kept = sign * values > ROUNDING
        half = _combined(E, (vectors[:, kept] * np.sqrt(np.abs(values[kept]))).T)
        sizes, directions = np.linalg.eigh(half.T @ half)
        Y = np.zeros((int((sizes > least).sum()), state_size(f)))
        Y[:, rest] = (half @ directions[:, sizes > least]).T
        add_rows(f, sign, Y)


def _block(f: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    """The covariance of eta at these rows and columns."""
    block = np.empty((len(rows), len(columns)))
    read_block(f.P, rows, columns, block)
    return block + _pending(f, rows, columns)


def _pending(f: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    """What is still to be added to P at these rows and columns."""
    total = np.zeros((len(rows), len(columns)))
    for sign, pending, used in (
        (-1.0, f.downdates, f.now.downdates),
        (1.0, f.updates, f.now.updates),
    ):
        left, right = (pending[:used, each] for each in (rows, columns))
        left[:, rows < f.robot_size] = right[:, columns < f.robot_size] = 0.0
        total += sign * left.T @ right
    return total


def _row_space(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns (q, p) that span the rows T (o, q), and F (o, p): they are T^T F."""
    size = np.linalg.norm(rows, axis=1)
    scale = np.where(size > 0, size, 1.0)
    left, values, right = np.linalg.svd(rows / scale[:, None], full_matrices=False)
    kept = values > np.sqrt(ROUNDING)
    return right[kept].T, left[:, kept] / values[kept] / scale[:, None]


def _point_space(space: FloatArray) -> FloatArray:
    """(2 q + 2, 2 p + 2): the space (q, p) for both coordinates of the points, and d as it is."""
    q, p = space.shape
    both = np.zeros((2 * q + 2, 2 * p + 2))
    both[:-2:2, :-2:2] = both[1:-2:2, 1:-2:2] = space
    both[-2, -2] = both[-1, -1] = 1.0
    return both


def _root(C: FloatArray) -> FloatArray:
    """Root T (L, q) of a covariance C = T T^T, without its null directions."""
    deviation = np.sqrt(C.diagonal())
    scale = np.where(deviation > 0, deviation, 1.0)
    values, vectors = np.linalg.eigh(C / scale[:, None] / scale)
    kept = values > ROUNDING
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def _combined(basis: FloatArray, weights: FloatArray) -> FloatArray:
    """E w (2 m, p) of weights (p, 2 q): of each column of the basis, and of its quarter turn."""
    product = basis @ weights[:, ::2].T
    if weights[:, 1::2].any():
        product += _quarter_turn(basis @ weights[:, 1::2].T)
    return np.asarray(product)


def _quarter_turn(points: FloatArray) -> FloatArray:
    """J x of points x, whose coordinates alternate along the first axis."""
    turned = np.empty_like(points)
    turned[::2], turned[1::2] = -points[1::2], points[::2]
    return turned


LARGE = 1000
"""Landmarks in a map from which "auto" uses local maps."""
MAX_FRACTION = 0.25
"""Of the map; with "auto", a larger local map is not entered."""
MARGIN = 1.0
"""Distance that a robot goes in a local map, as a fraction of the range that its scans need."""


class LocalMapChoice:
    """Decides in which local map of a large map the next step is taken.

    Args:
        always: whether local maps are used in every map, or only in large ones.
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, always: bool, gate: float) -> None:
        self._always = always
        self._gate = sqrt(gate) if isfinite(gate) else 0.0
        self._radius = -1.0
        self._in_whole = False
        self._way = self._needed = 0.0
        self._position = self._heading = self._position_bias = self._heading_bias = 0.0
        self._bias = self._bias_sigma = np.zeros(0)

    def choose_view(self, ekf: EkfSlam, scan: Scan, named: IntArray, reach: float) -> None:
        """Choose the part of the map in which a step works, and make room for the step.

        Args:
            ekf: the filter, before the motion.
            scan: the step.
            named: (k,) landmarks that the scan names, -1 for none.
            reach: metres within which landmarks are expected in view, whatever is observed.
        """
        ekf.inflate_heading_covariance()
        if isinstance(ekf, LargeMapSlam):
            self._choose(ekf, scan.control, scan.z, scan.R, named, reach)
        ekf.reserve(len(scan.z))

    def _choose(
        self,
        ekf: LargeMapSlam,
        control: tuple[FloatArray, FloatArray] | None,
        z: FloatArray,
        R: FloatArray,
        named: IntArray,
        reach: float,
    ) -> None:
        """Enter a local map for a step, or leave it; most often the one of the last step serves."""
        if not self._always and len(ekf) + (ekf.local_map is None) * len(z) < LARGE:
            self._radius = -1.0
            ekf.leave()
            return
        if len(z) > 0:
            reach = max(reach, float((z[:, 0] + self._gate * np.sqrt(R[:, 0, 0])).max()))
        left = ekf.local_map is None and not self._in_whole
        if self._radius < 0 or left:
            self._enter(ekf, control, named, reach)
            return
        self._add_motion(control, ekf.robot.robot_size)
        outside = ekf.local_map is not None and bool((ekf.to_view(named[named >= 0]) < 0).any())
        if outside or self._way_needed() + reach > self._radius:
            self._enter(ekf, control, named, reach)
        self._needed = max(self._needed, reach)

    def _enter(
        self,
        ekf: LargeMapSlam,
        control: tuple[FloatArray, FloatArray] | None,
        named: IntArray,
        needed: float,
    ) -> None:
        """Enter the local map of the robot for the next step and some that may follow."""
        f, r = ekf.robot, ekf.robot.robot_size
        self._bias = f.state[3:r].copy()
        self._bias_sigma = np.sqrt(np.abs(f.P[range(3, r), range(3, r)]))
        self._way = 0.0
        self._position = self._heading = self._position_bias = self._heading_bias = 0.0
        self._add_motion(control, r)
        self._radius = max(needed, self._needed) * (1 + MARGIN) + self._way_needed()
        self._needed = needed
        predicted, S = ekf.predict_observations()
        q = predicted[:, 0]
        sigma = np.sqrt(np.abs(S[:, 0, 0]) + q * q * np.abs(S[:, 1, 1]))
        near = q - 2 * self._gate * sigma <= self._radius
        near[named[(named >= 0) & (named < len(near))]] = True
        self._in_whole = not self._always and near.mean() > MAX_FRACTION
        if not self._in_whole:
            ekf.enter(np.flatnonzero(near))

    def _add_motion(self, control: tuple[FloatArray, FloatArray] | None, robot_size: int) -> None:
        """Add a step to the way since the local map was entered, with its uncertainty."""
        if control is None:
            return
        u, U = control
        c = len(u) - 1  # the heading's
        if robot_size > 3:
            D = control_bias(u, robot_size)
            u, bias = u + D @ self._bias, np.abs(D) @ self._bias_sigma
            self._position_bias += float(np.hypot.reduce(bias[:c]))
            self._heading_bias += float(bias[c])
        length = hypot(u[0], u[1]) if c == 2 else abs(float(u[0]))
        heading = float(U[c, c])
        self._way += length
        self._position += float(U[0, 0] + (U[1, 1] if c == 2 else 0.0)) + length**2 * heading
        self._heading += heading

    def _way_needed(self) -> float:
        """Metres that the robot may have gone, by a bound of its standard deviation."""
        heading = sqrt(self._heading) + self._heading_bias
        sigma = sqrt(self._position) + self._position_bias + self._way * heading
        return self._way + self._gate * sigma
