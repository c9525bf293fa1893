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

import numpy as np

from saccade.slam.filter._state_kernels import STANDARD, FilterState, read_block, write_block
from saccade.slam.filter.state import (
    add_rows,
    auxiliary_rows,
    flush,
    new_state,
    state_rows,
    state_size,
    symmetric,
    with_capacity,
)
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


def enter(f: FilterState, inside: IntArray) -> LocalMap:
    """The local map of these landmarks (k,), ascending, of the state of a whole map."""
    r, N, k = f.robot_size, f.now.landmarks, len(inside)
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
    local.P[:L, auxiliary_rows(local).start : -2 : 2] = root
    local.state[-2] = 1.0
    local.heading_lever[-1] = 0.0 if f.error_state == STANDARD else 1.0
    local.now.landmarks = k
    rest, observed = np.flatnonzero(number < 0), np.zeros(k, np.bool_)
    return LocalMap(inside, rest, number, root, observed, local)


def leave(f: FilterState, place: LocalMap) -> FilterState:
    """The state of the whole map, with what a stay in a local map changed."""
    local, r = place.state, place.state.robot_size
    numbers = place.numbers(local.now.landmarks)
    flush(local)
    added = len(numbers) - len(place.inside)
    f = with_capacity(f, added, 0)
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
    return f


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
