"""Compressed EKF-SLAM: steps at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among some landmarks A, the changes of the
others B are linear in their covariance with A at its arrival. With J a quarter turn,
E = [K, J K, d, J d] of that time, C_BA = K T^T with C_AA = T T^T, d the differences of the
points of B from their first estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of points that
are never observed; Phi is T at first. Thus the filter of `ekf` on A and on as many of these
auxiliary points as A has coordinates is equivalent to the full filter, and the update of B is
deferred. T keeps the numbers small: by C_BA itself, five digits would be lost.
"""

from dataclasses import dataclass

import numpy as np

from saccade.slam.filter._compressed_kernels import read_block, write_block
from saccade.slam.filter._state_kernels import (
    DOWNDATES,
    LANDMARKS,
    STANDARD,
    UPDATES,
    FilterState,
    Scratch,
    invalidate_cache,
    is_full,
)
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import (
    add_rows,
    auxiliary_rows,
    flush,
    grown,
    new_scratch,
    new_state,
    state_rows,
    state_size,
    symmetric,
)
from saccade.types import BoolArray, FloatArray, IntArray

SPARE = 8
"""Landmarks, at least, that can be added to a neighborhood before its arrays grow."""
ROUNDING = 1e-15
"""Fraction of a variance below which another one is zero."""
NEGLIGIBLE = 1e-7
"""Fraction of the smallest variance of the landmarks outside of a neighborhood: directions in
which it reduces their variance by less than this are left as they were."""


@dataclass
class Neighborhood:
    """Some landmarks, and what is deferred for the others."""

    inside: IntArray
    """(k,) their numbers in the map when it was entered, ascending."""
    rest: IntArray
    """(m,) those of all others."""
    number: IntArray
    """(k + m,) number in the neighborhood of each landmark of that map, -1 for the others."""
    root: FloatArray
    """(L, q) T of C_AA = T T^T at its entry, of the robot and the landmarks inside."""
    observed: BoolArray
    """(k,) whether a landmark was observed since, see `mark`."""
    filter_state: FilterState
    """Of the robot, the neighborhood and q auxiliary points, and landmarks that were added."""
    scratch: Scratch

    def __len__(self) -> int:
        return int(self.filter_state.counts[LANDMARKS])

    @property
    def mapped(self) -> int:
        """Landmarks of the map."""
        return len(self) + len(self.rest)

    def numbers(self, count: int) -> IntArray:
        """(count,) number in the map of its first landmarks, with those added or to be added."""
        added = len(self.number) + np.arange(count - len(self.inside))
        return np.concatenate([self.inside, added])

    def from_map(self, landmark: IntArray) -> IntArray:
        """Numbers in the neighborhood of landmarks of the map, -1 for those outside.

        Negative numbers stay, and so do the places of those that are yet to be added.
        """
        k, N = len(self.inside), len(self.number)
        known = (landmark >= 0) & (landmark < N)
        local = np.where(landmark < N, landmark, landmark - N + k)
        local[known] = self.number[landmark[known]]
        return local

    def to_map(self, local: IntArray) -> IntArray:
        """Numbers in the map of landmarks of the neighborhood; negative ones stay."""
        k, N = len(self.inside), len(self.number)
        known = (local >= 0) & (local < k)
        landmark = np.where(local < k, local, local - k + N)
        landmark[known] = self.inside[local[known]]
        return landmark

    def mark(self, local: IntArray) -> None:
        """Note that these of its landmarks were observed, or may be; negative ones are none."""
        self.observed[local[(local >= 0) & (local < len(self.observed))]] = True

    def reserve(self, landmarks: int) -> None:
        """Make room for another step and so many more landmarks."""
        while len(self) + landmarks > len(self.filter_state.blocks):
            self.filter_state = grown(self.filter_state)
            self.scratch = new_scratch(self.filter_state)
        self.flush_if_full()

    def flush_if_full(self) -> bool:
        """Make room for another step if landmarks are not what there is no room for."""
        f = self.filter_state
        if len(self) == len(f.blocks) or not is_full(f):
            return False
        flush(f)
        return True


class CompressedSlam(EkfSlam):
    """`EkfSlam` that can defer what steps among some landmarks change about the others.

    `filter_state`, and with it every method that needs the landmarks, brings all of the map up to
    date, and ends the stay in the neighborhood; the pose and its covariance do not need it.
    """

    neighborhood: Neighborhood | None = None
    """Where the filter works at present."""

    @property
    def filter_state(self) -> FilterState:
        """The arrays of the filter of the whole map, up to date."""
        self.leave()
        return self._whole

    @filter_state.setter
    def filter_state(self, filter_state: FilterState) -> None:
        self._whole = filter_state
        self.neighborhood = None

    @property
    def robot_filter(self) -> FilterState:
        """See `EkfSlam.robot_filter`."""
        return self._whole if self.neighborhood is None else self.neighborhood.filter_state

    def __len__(self) -> int:
        if self.neighborhood is None:
            return int(self._whole.counts[LANDMARKS])
        return self.neighborhood.mapped

    def enter(self, inside: IntArray) -> Neighborhood:
        """Work among these landmarks (k,), ascending, until `leave`."""
        f, r, N, k = self.filter_state, self.robot_filter.robot_size, len(self), len(inside)
        number = np.full(N, -1)
        number[inside] = np.arange(k)
        rows = state_rows(inside, r)
        C, L = _block(f, rows, rows), len(rows)
        root = _root(C)
        q, room = root.shape[1], k + max(k // 4, SPARE)
        local = new_state(f.state[:r], f.P[:r, :r], room, f.error_state, f.huber, q + 1)
        local = local._replace(heading_variance=f.heading_variance, nonlinearity=f.nonlinearity)
        local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
        local.P[:L, :L] = np.triu(C)
        local.P[:r, :r] = f.P[:r, :r]
        local.blocks[:k] = f.blocks[inside]
        first = auxiliary_rows(local).start
        local.P[:L, first:-2:2] = root
        local.state[-2] = 1.0
        local.heading_lever[-1] = 0.0 if f.error_state == STANDARD else 1.0
        local.counts[LANDMARKS] = k
        rest, observed = np.flatnonzero(number < 0), np.zeros(k, np.bool_)
        scratch = new_scratch(local)
        self.neighborhood = Neighborhood(inside, rest, number, root, observed, local, scratch)
        return self.neighborhood

    def leave(self) -> None:
        """Bring the filter of the whole map up to date."""
        place, self.neighborhood = self.neighborhood, None
        if place is None:
            return
        local, r, numbers = (
            place.filter_state,
            place.filter_state.robot_size,
            place.numbers(len(place)),
        )
        flush(local)
        self.reserve(len(numbers) - len(place.inside))
        f, n = self._whole, state_size(local)
        f.downdates[:, state_size(f) :] = f.updates[:, state_size(f) :] = 0.0
        f.counts[LANDMARKS] = len(place.number) + len(numbers) - len(place.inside)
        rows = state_rows(numbers, r)
        if len(place.rest) > 0:
            _apply_deferred(f, place, rows)
        f.state[rows], f.heading_lever[rows] = local.state[:n], local.heading_lever[:n]
        f.blocks[numbers] = local.blocks[: len(numbers)]
        write_block(f.P, rows, rows, symmetric(local.P[:n, :n]) - _pending(f, rows, rows), 0.0)
        f.P[:r, :r] = local.P[:r, :r]
        invalidate_cache(f)


def _apply_deferred(f: FilterState, place: Neighborhood, rows: IntArray) -> None:
    """Apply the deferred updates to the landmarks outside the neighborhood.

    All of them are in the space of the rows of C_AA that were observed, and of d.
    """
    local, r, root = place.filter_state, f.robot_size, place.root
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
    for sign, pending, which in ((-1.0, f.downdates, DOWNDATES), (1.0, f.updates, UPDATES)):
        left, right = (pending[: f.counts[which], each] for each in (rows, columns))
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


def _rows(landmarks: IntArray, r: int) -> IntArray:
    """(2 k,) rows of landmarks."""
    return state_rows(landmarks, r)[r:]
