"""Compressed EKF-SLAM: steps at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among some landmarks A, the changes of the
others B are linear in their covariance with A at its arrival. With J a quarter turn,
E = [C_BA, J C_BA, d, J d] of that time, d the differences of the points of B from their first
estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of points that
are never observed. Thus the filter of `ekf` on A and on as many of these auxiliary points as A
has coordinates is equivalent to the full filter, and the update of B is deferred.
"""

from dataclasses import dataclass

import numpy as np

from saccade.slam.filter._compressed_kernels import read_block, write_block
from saccade.slam.filter._state_kernels import (
    LANDMARKS,
    STANDARD,
    FilterState,
    Scratch,
    is_full,
)
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import (
    RANK,
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
from saccade.types import FloatArray, IntArray

SPARE = 8
"""Landmarks, at least, that can be added to a neighborhood before its arrays grow."""
ROUNDING = 1e-15
"""Fraction of a variance below which another one is zero."""
NEGLIGIBLE = 1e-9
"""Fraction of the smallest variance of the landmarks outside of a neighborhood: directions in
which it reduces their variance by less than this are left as they were."""


@dataclass
class Neighborhood:
    """Some landmarks, and what is deferred for the others."""

    inside: IntArray
    """(k,) their numbers in the map when it was entered, ascending."""
    rest: IntArray
    """(m,) those of all others."""
    local: IntArray
    """(k + m,) number in the neighborhood of each landmark of that map, -1 for the others."""
    basis: FloatArray
    """(2 m, q) C_BA and d; the other half of E is a quarter turn of it."""
    filter_state: FilterState
    """Of the robot, the neighborhood and q auxiliary points, and landmarks that were added."""
    scratch: Scratch

    def __len__(self) -> int:
        return int(self.filter_state.counts[LANDMARKS])

    def numbers(self, count: int) -> IntArray:
        """(count,) number in the map of its first landmarks, with those added or to be added."""
        added = len(self.local) + np.arange(count - len(self.inside))
        return np.concatenate([self.inside, added])

    def from_map(self, landmark: IntArray) -> IntArray:
        """Numbers in the neighborhood of landmarks of the map, -1 for those outside.

        Negative numbers stay, and so do the places of those that are yet to be added.
        """
        k, N = len(self.inside), len(self.local)
        known = (landmark >= 0) & (landmark < N)
        local = np.where(landmark < N, landmark, landmark - N + k)
        local[known] = self.local[landmark[known]]
        return local

    def to_map(self, local: IntArray) -> IntArray:
        """Numbers in the map of landmarks of the neighborhood; negative ones stay."""
        k, N = len(self.inside), len(self.local)
        known = (local >= 0) & (local < k)
        landmark = np.where(local < k, local, local - k + N)
        landmark[known] = self.inside[local[known]]
        return landmark

    def reserve(self, landmarks: int) -> None:
        """Make room for another step and so many more landmarks."""
        while len(self) + landmarks > len(self.filter_state.blocks):
            self.filter_state = grown(self.filter_state)
            self.scratch = new_scratch(self.filter_state)
        if is_full(self.filter_state):
            flush(self.filter_state)


class CompressedSlam(EkfSlam):
    """`EkfSlam` that can defer what steps among some landmarks change about the others.

    `filter_state`, and with it every method that needs the landmarks, brings all of the map up to
    date, and ends the stay in the neighborhood; the pose and its covariance do not need it.
    """

    neighborhood: Neighborhood | None = None
    """Where the filter works at present."""

    @property
    def filter_state(self) -> FilterState:  # type: ignore[override]
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
        return len(self.neighborhood) + len(self.neighborhood.rest)

    def enter(self, inside: IntArray) -> Neighborhood:
        """Work among these landmarks (k,), ascending, until `leave`."""
        f, r = self.filter_state, self.robot_filter.robot_size
        flush(f)
        N, k = len(self), len(inside)
        local_number = np.full(N, -1)
        local_number[inside] = np.arange(k)
        rest = np.flatnonzero(local_number < 0)
        rows, rest_rows = state_rows(inside, r), _rows(rest, r)
        L = len(rows)
        block, between = np.empty((L, L)), np.empty((len(rest_rows), L))
        read_block(f.P, rows, rows, block)
        read_block(f.P, rest_rows, rows, between)
        root, inverse = _root(block)  # (L, q)
        q = root.shape[1]
        basis = np.empty((len(rest_rows), q + 1))
        np.matmul(between, inverse, out=basis[:, :q])
        basis[:, q] = _quarter_turn(-f.heading_lever[rest_rows])  # d = -J a

        room = k + max(k // 4, SPARE)
        local = new_state(f.state[:r], f.P[:r, :r], room, f.error_state, f.huber, q + 1)
        local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
        local.P[:L, :L] = np.triu(block)
        local.P[:r, :r] = f.P[:r, :r]
        local.blocks[:k] = f.blocks[inside]
        first = auxiliary_rows(local).start
        local.P[:L, first : first + 2 * q : 2] = root
        local.state[first + 2 * q] = 1.0
        local.heading_lever[first + 2 * q + 1] = 0.0 if f.error_state == STANDARD else 1.0
        local.counts[LANDMARKS] = k
        self.neighborhood = Neighborhood(
            inside, rest, local_number, basis, local, new_scratch(local)
        )
        return self.neighborhood

    def leave(self) -> None:
        """Bring the filter of the whole map up to date."""
        place, self.neighborhood = self.neighborhood, None
        if place is None:
            return
        local, r, numbers = place.filter_state, place.filter_state.robot_size, place.numbers(len(place))
        flush(local)
        self.reserve(len(numbers) - len(place.inside))
        f, n = self._whole, state_size(local)
        f.counts[LANDMARKS] = len(place.local) + len(numbers) - len(place.inside)
        rows = state_rows(numbers, r)
        f.state[rows], f.heading_lever[rows] = local.state[:n], local.heading_lever[:n]
        f.blocks[numbers] = local.blocks[: len(numbers)]
        write_block(f.P, rows, rows, symmetric(local.P[:n, :n]))
        if len(place.rest) > 0:
            _apply_deferred(f, place, rows)
        f.P[:r, :r] = local.P[:r, :r]


def _apply_deferred(f: FilterState, place: Neighborhood, rows: IntArray) -> None:
    """Apply the deferred updates to the landmarks outside the neighborhood."""
    local, E, rest = place.filter_state, place.basis, _rows(place.rest, f.robot_size)
    points = auxiliary_rows(local)
    Phi, delta = local.P[: len(rows), points], local.state[points].copy()
    write_block(f.P, rest, rows, _combined(E, Phi))  # C_BA
    f.heading_lever[rest] = (
        _quarter_turn(_combined(E, delta[None])[:, 0]) if f.error_state != STANDARD else 0.0
    )
    delta[-2] -= 1.0
    f.state[rest] += _combined(E, delta[None])[:, 0]
    values, vectors = np.linalg.eigh(local.P[points, points], UPLO="U")  # Psi
    least = NEGLIGIBLE * f.blocks[place.rest][:, ::2].min()
    for sign in (-1.0, 1.0):
        kept = sign * values > 0
        roots = np.sqrt(np.abs(values[kept]))
        half = _combined(E, (vectors[:, kept] * roots).T)  # (2 m, p)
        sizes, directions = np.linalg.eigh(half.T @ half)
        Y = np.zeros((int((sizes > least).sum()), state_size(f)))
        Y[:, rest] = (half @ directions[:, sizes > least]).T
        add_rows(f, sign, Y)


def _root(C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Root T (L, q) of a covariance C = T T^T, and M (L, q), M^T T = 1, without null directions."""
    deviation = np.sqrt(C.diagonal())
    scale = np.where(deviation > 0, deviation, 1.0)
    values, vectors = np.linalg.eigh(C / scale[:, None] / scale)
    kept = values > ROUNDING
    root = np.sqrt(values[kept])
    return scale[:, None] * vectors[:, kept] * root, vectors[:, kept] / root / scale[:, None]


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
