"""The compressed filter: steps in a large map at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among the landmarks A of a submap, the changes
of the other landmarks B are linear in their covariance with A at its entry. With J a quarter turn,
E = [d, J d, K, J K] of that time, C_BA = K T^T with C_AA = T T^T, d the differences of the
points of B from their first estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of points that
are never observed; Phi is T at first. The filter on A and on these auxiliary points is therefore
equivalent to the full filter, and the update of B is deferred. T keeps the numbers small: with C_BA
itself, five digits would be lost. T is a block Cholesky root, pivoted in the order in which the
landmarks of A are first observed: a column of T, with its auxiliary point, changes nothing before
the first observation of its landmark, and is added there.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saccade.slam.filter._state_kernels import STANDARD, FilterState, read_block, write_block
from saccade.slam.filter.state import (
    add_rows,
    auxiliary_rows,
    finish_flush,
    landmark_blocks,
    new_state,
    state_rows,
    state_size,
    with_capacity,
)
from saccade.types import BoolArray, FloatArray, IntArray

MIN_SPARE = 8
"""Minimum number of landmarks that can be added to a submap before its arrays grow."""
ROUNDING = 1e-14
"""Relative rounding error of variances: smaller ones count as zero."""
NEGLIGIBLE_REDUCTION = 1e-7
"""Smallest variance reduction that is applied outside of a submap, as a fraction of the smallest
variance there."""
ROBOT_SCALARS = (
    *("heading_variance", "lowest_heading_variance", "nonlinearity", "nonlinear_updates"),
    "next_id",
)
"""Scalars of a state that belong to the robot."""


@dataclass
class Submap:
    """Some landmarks of a map, and the deferred updates of all others."""

    inside: IntArray
    """(k,) rows of its landmarks in the map at its entry, ascending."""
    rest: IntArray
    """(m,) rows of all others."""
    covariance: FloatArray
    """(L, L) C_AA at its entry, of the robot and the landmarks inside."""
    root: FloatArray
    """(L, p) columns of T."""
    factor: FloatArray
    """(L, p) F with T = C_AA F and K = C_BA F."""
    spanned: BoolArray
    """(L,) whether T has its columns for a row of the robot or of an observed landmark."""
    state: FilterState
    """State of the robot, the landmarks inside, added landmarks, and 1 + p auxiliary points."""

    @property
    def added(self) -> int:
        """Number of landmarks that were added to the submap."""
        return int(self.state.now.landmarks) - len(self.inside)

    @property
    def rows(self) -> IntArray:
        """(k + added,) rows in the map of all its landmarks."""
        count = len(self.inside) + len(self.rest)
        return np.concatenate([self.inside, count + np.arange(self.added)])

    def include(self, rows: IntArray) -> None:
        """Prepares for observations of the landmarks in these rows (k,) of `state`."""
        r = self.state.robot_size
        rows = rows[(rows >= 0) & (rows < len(self.inside))]
        new = rows[~self.spanned[r + 2 * rows]]
        if len(new) > 0:
            self.extend(state_rows(np.unique(new), r)[r:])

    def extend(self, rows: IntArray) -> None:
        """Adds the columns of T for these rows (m,): the next block of its Cholesky root."""
        C, T, F, f = self.covariance, self.root, self.factor, self.state
        rest = C[:, rows] - T @ T[rows].T  # (L, m)
        rest[self.spanned] = 0.0
        self.spanned[rows] = True
        deviation = np.sqrt(C.diagonal()[rows])
        scale = np.where(deviation > 0, deviation, 1.0)
        values, vectors = np.linalg.eigh(rest[rows] / scale[:, None] / scale)
        kept = values > ROUNDING
        W = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]  # (m, q)
        columns, factor = rest @ W, -F @ (T[rows].T @ W)
        factor[rows] += W
        self.root, self.factor = np.column_stack([T, columns]), np.column_stack([F, factor])
        end = auxiliary_rows(f).stop
        f.now.auxiliary += columns.shape[1]
        f.P[: len(C), end : auxiliary_rows(f).stop : 2] = columns


def enter(f: FilterState, inside: IntArray) -> Submap:
    """The submap of the landmarks at these rows (k,), ascending, of the state of a whole map."""
    r, N, k = f.robot_size, f.now.landmarks, len(inside)
    rows = state_rows(inside, r)
    C, L = _block(f, rows, rows), len(rows)
    room = k + max(k // 4, MIN_SPARE)
    local = new_state(
        f.state[:r],
        f.P[:r, :r],
        room,
        f.errors,
        f.huber,
        range_errors=f.range_errors,
        auxiliary=L + 1,
    )
    for name in ROBOT_SCALARS:
        setattr(local.now, name, getattr(f.now, name))
    local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
    local.P[:L, :L] = np.triu(C)
    local.P[:r, :r] = f.P[:r, :r]
    local.blocks[:k], local.ids[:k] = f.blocks[inside], f.ids[inside]
    d = auxiliary_rows(local).start
    local.state[d], local.heading_lever[d + 1] = 1.0, float(f.errors != STANDARD)
    local.now.landmarks, local.now.auxiliary = k, 1
    rest, none = np.delete(np.arange(N), inside), np.zeros((L, 0))
    submap = Submap(inside, rest, C, none, none, np.zeros(L, np.bool_), local)
    submap.extend(np.arange(r))
    return submap


def leave(f: FilterState, submap: Submap) -> FilterState:
    """The state of the whole map, with the deferred updates of a submap."""
    finish_flush(f)
    local, r = submap.state, submap.state.robot_size
    landmarks, n = submap.rows, state_size(local)
    rows = state_rows(landmarks, r)
    deferred = _Deferred.of(f, submap) if len(submap.rest) > 0 else None
    f = with_capacity(f, submap.added, 0)
    f.downdates[:, state_size(f) :] = f.updates[:, state_size(f) :] = 0.0
    f.now.landmarks += submap.added
    for name in ROBOT_SCALARS:
        setattr(f.now, name, getattr(local.now, name))
    if deferred is not None:
        deferred.apply(f, submap, rows)
    f.state[rows], f.heading_lever[rows] = local.state[:n], local.heading_lever[:n]
    k = len(landmarks)
    f.blocks[landmarks], f.ids[landmarks] = local.blocks[:k], local.ids[:k]
    block = _block(local, np.arange(n), np.arange(n))
    write_block(f.P, rows, rows, block - _pending(f, rows, rows), 0.0)
    f.P[:r, :r] = local.P[:r, :r]
    return f


def read(f: FilterState, submap: Submap) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 2) and covariances (N, 2, 2) of all landmarks."""
    finish_flush(f)
    N, local = len(submap.inside) + len(submap.rest) + submap.added, submap.state
    xy, C, rest = np.empty((N, 2)), np.empty((N, 2, 2)), submap.rest
    xy[submap.rows] = local.state[local.robot_size : state_size(local)].reshape(-1, 2)
    C[submap.rows] = landmark_blocks(local)
    if len(rest) > 0:
        deferred = _Deferred.of(f, submap)
        xy[rest] = deferred.state.reshape(-1, 2)
        C[rest] = deferred.landmark_blocks(f, submap)
    return xy, C


class _Deferred(NamedTuple):
    """Deferred updates of the landmarks outside of a submap."""

    E: FloatArray
    """(2 m, 2 + 2 p), the columns of a point and its quarter turn in turn."""
    Phi: FloatArray
    """(n, 2 + 2 p) of the robot and the landmarks of the submap; changes, where these are older."""
    state: FloatArray
    """(2 m,) positions."""
    lever: FloatArray
    """(2 m,) heading levers."""
    products: tuple[tuple[float, FloatArray], ...]
    """Signs, and rows Y (k, 2 m) of which sign Y^T Y is added to the covariance."""

    @classmethod
    def of(cls, f: FilterState, submap: Submap) -> "_Deferred":
        """The deferred updates of the state of a whole map."""
        local, r, old = submap.state, f.robot_size, len(submap.root)
        rest, observed = state_rows(submap.rest, r)[r:], np.flatnonzero(submap.spanned)
        C = _block(f, rest, state_rows(submap.inside, r)[observed])
        d = _quarter_turn(-f.heading_lever[rest])  # -J a
        E = np.empty((len(rest), 2 + 2 * submap.root.shape[1]))
        E[:, ::2] = np.column_stack([d, C @ submap.factor[observed]])
        E[:, 1::2] = _quarter_turn(E[:, ::2])

        points = np.arange(len(local.state))[auxiliary_rows(local)]
        Phi = _block(local, np.arange(state_size(local)), points)
        Phi[r:old, 2::2] -= submap.root[r:]  # what has changed

        delta = local.state[points].copy()
        lever = f.heading_lever[rest]
        if f.errors != STANDARD:
            lever = _quarter_turn(E @ delta)
        delta[0] -= 1.0
        state = f.state[rest] + E @ delta

        values, vectors = np.linalg.eigh(_block(local, points, points))  # Psi
        least = NEGLIGIBLE_REDUCTION * f.blocks[submap.rest][:, ::2].min()
        products = []
        for sign in (-1.0, 1.0):
            kept = sign * values > ROUNDING
            half = E @ (vectors[:, kept] * np.sqrt(np.abs(values[kept])))
            sizes, directions = np.linalg.eigh(half.T @ half)
            products.append((sign, (half @ directions[:, sizes > least]).T))
        return cls(E, Phi, state, lever, tuple(products))

    def apply(self, f: FilterState, submap: Submap, rows: IntArray) -> None:
        """Applies the updates to the whole map, in which the submap has rows (n,)."""
        r, old = f.robot_size, len(submap.root)
        rest = state_rows(submap.rest, r)[r:]
        E, Phi = self.E, self.Phi
        changed, new = rows[r:old], np.concatenate([rows[:r], rows[old:]])
        write_block(f.P, rest, changed, E @ Phi[r:old].T, 1.0)  # C_BA
        write_block(f.P, rest, new, E @ np.concatenate([Phi[:r], Phi[old:]]).T, 0.0)
        f.state[rest], f.heading_lever[rest] = self.state, self.lever
        for sign, products in self.products:
            Y = np.zeros((len(products), state_size(f)))
            Y[:, rest] = products
            add_rows(f, sign, Y)

    def landmark_blocks(self, f: FilterState, submap: Submap) -> FloatArray:
        """(m, 2, 2) covariances of the landmarks outside of the submap."""
        blocks = f.blocks[submap.rest][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        for sign, products in self.products:
            Y = products.T.reshape(len(blocks), 2, -1)
            blocks = blocks + sign * Y @ Y.transpose(0, 2, 1)
        a = self.lever.reshape(-1, 2)
        heading = (self.E @ self.Phi[2]).reshape(-1, 2)
        half = a[:, :, None] * (heading + submap.state.P[2, 2] / 2 * a)[:, None, :]
        return np.asarray(blocks + half + half.transpose(0, 2, 1))


def _block(f: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    """The covariance of eta at these rows and columns."""
    block = np.empty((len(rows), len(columns)))
    read_block(f.P, rows, columns, block)
    return block + _pending(f, rows, columns)


def _pending(f: FilterState, rows: IntArray, columns: IntArray) -> FloatArray:
    """The delayed rows' part of the covariance at these rows and columns."""
    total = np.zeros((len(rows), len(columns)))
    parts = ((-1.0, f.downdates, f.now.downdates), (1.0, f.updates, f.now.updates))
    for sign, pending, used in parts:
        left, right = (pending[:used, each] for each in (rows, columns))
        left[:, rows < f.robot_size] = right[:, columns < f.robot_size] = 0.0
        total += sign * left.T @ right
    return total


def _quarter_turn(points: FloatArray) -> FloatArray:
    """J x of points x, whose coordinates alternate along the first axis."""
    turned = np.empty_like(points)
    turned[::2], turned[1::2] = -points[1::2], points[::2]
    return turned
