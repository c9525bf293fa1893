"""The compressed filter: steps in a large map at a cost that does not grow with the map.

After Guivant & Nebot (2001): while the robot stays among the landmarks A of a submap, the changes
of the other landmarks B are linear in their covariance with A at its entry. With J a quarter turn,
E = [K, J K, d, J d] of that time, C_BA = K T^T with C_AA = T T^T, d the differences of the
points of B from their first estimates, at any later time

    C_BA = E Phi,    C_BB <- C_BB + E Psi E^T,    d = E delta.

Phi, Psi and delta change as the covariances with A, the covariance and the state of points that
are never observed; Phi is T at first. The filter on A and on as many of these auxiliary points as A
has coordinates is therefore equivalent to the full filter, and the update of B is deferred. T keeps
the numbers small: with C_BA itself, five digits would be lost.

A submap contains every landmark that may be observed while the robot moves a certain distance:
all landmarks within a radius of its position, widened by twice their gate. The filter leaves it
when the range of a scan plus the distance since the entry, with the gate of its odometry, exceeds
the radius, or when the label of a landmark outside is observed.
"""

from dataclasses import dataclass, field
from math import hypot, isfinite, sqrt
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from saccade.slam.filter._state_kernels import STANDARD, FilterState, read_block, write_block
from saccade.slam.filter.models import control_bias
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
from saccade.slam.scans import Scan
from saccade.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from saccade.slam.filter.ekf import EkfSlam
    from saccade.slam.landmarks import LandmarkTable

LARGE_MAP = 1000
"""Minimum number of landmarks for "auto" to use submaps."""
MAX_FRACTION = 0.25
"""Largest submap that "auto" enters, as a fraction of the map."""
MARGIN = 1.5
"""Distance that a robot can move in a submap, as a fraction of the range of its scans."""
MIN_SPARE = 8
"""Minimum number of landmarks that can be added to a submap before its arrays grow."""
ROUNDING = 1e-15
"""Relative rounding error of variances: smaller ones count as zero."""
NEGLIGIBLE = 1e-7
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
    root: FloatArray
    """(L, q) T of C_AA = T T^T at its entry, of the robot and the landmarks inside."""
    observed: BoolArray
    """(k,) whether a landmark was observed in the submap."""
    state: FilterState
    """State of the robot, the landmarks inside, q auxiliary points, and added landmarks."""

    @property
    def added(self) -> int:
        """Number of landmarks that were added to the submap."""
        return int(self.state.now.landmarks) - len(self.inside)

    @property
    def rows(self) -> IntArray:
        """(k + added,) rows in the map of all its landmarks."""
        count = len(self.inside) + len(self.rest)
        return np.concatenate([self.inside, count + np.arange(self.added)])


def enter(f: FilterState, inside: IntArray) -> Submap:
    """The submap of the landmarks at these rows (k,), ascending, of the state of a whole map."""
    r, N, k = f.robot_size, f.now.landmarks, len(inside)
    rows = state_rows(inside, r)
    C, L = _block(f, rows, rows), len(rows)
    root = _root(C)
    q, room = root.shape[1], k + max(k // 4, MIN_SPARE)
    local = new_state(f.state[:r], f.P[:r, :r], room, f.error_state, f.huber, auxiliary=q + 1)
    for name in ROBOT_SCALARS:
        setattr(local.now, name, getattr(f.now, name))
    local.state[:L], local.heading_lever[:L] = f.state[rows], f.heading_lever[rows]
    local.P[:L, :L] = np.triu(C)
    local.P[:r, :r] = f.P[:r, :r]
    local.blocks[:k], local.ids[:k] = f.blocks[inside], f.ids[inside]
    local.P[:L, auxiliary_rows(local).start : -2 : 2] = root
    local.state[-2] = 1.0
    local.heading_lever[-1] = 0.0 if f.error_state == STANDARD else 1.0
    local.now.landmarks = k
    rest = np.delete(np.arange(N), inside)
    return Submap(inside, rest, root, np.zeros(k, np.bool_), local)


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
    f.cached_pair[:] = -1
    f.now.cached = 0
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
    """Deferred updates of the landmarks outside of a submap.

    All are in the space of the rows of C_AA that were observed, and of d.
    """

    basis: FloatArray
    """(2 m, p + 1) E."""
    Phi: FloatArray
    """(n, 2 p + 2) of the robot and the landmarks of the submap; changes, where these are older."""
    state: FloatArray
    """(2 m,) positions."""
    lever: FloatArray
    """(2 m,) heading levers."""
    products: tuple[tuple[float, FloatArray], ...]
    """Signs, and rows Y (k, 2 m) of which sign Y^T Y is added to the covariance."""

    @classmethod
    def of(cls, f: FilterState, submap: Submap) -> "_Deferred":
        """The deferred updates of the state of a whole map."""
        local, r, root = submap.state, f.robot_size, submap.root
        old, rest = len(root), state_rows(submap.rest, r)[r:]
        observed = state_rows(np.flatnonzero(submap.observed), r)
        space, factor = _row_space(root[observed])  # (q, p), (o, p)
        E = np.empty((len(rest), space.shape[1] + 1))
        E[:, :-1] = _block(f, rest, state_rows(submap.inside, r)[observed]) @ factor
        E[:, -1] = _quarter_turn(-f.heading_lever[rest])  # d = -J a

        size = len(local.state)
        points = np.arange(size)[auxiliary_rows(local)]
        both = _point_space(space)
        Phi = _block(local, np.arange(state_size(local)), points) @ both
        Phi[r:old, :-2:2] -= root[r:old] @ space  # what has changed

        delta = local.state[points][None] @ both
        lever = f.heading_lever[rest]
        if f.error_state != STANDARD:
            lever = _quarter_turn(_combined(E, delta)[:, 0])
        delta[0, -2] -= 1.0
        state = f.state[rest] + _combined(E, delta)[:, 0]

        values, vectors = np.linalg.eigh(both.T @ _block(local, points, points) @ both)  # Psi
        least = NEGLIGIBLE * f.blocks[submap.rest][:, ::2].min()
        products = []
        for sign in (-1.0, 1.0):
            kept = sign * values > ROUNDING
            half = _combined(E, (vectors[:, kept] * np.sqrt(np.abs(values[kept]))).T)
            sizes, directions = np.linalg.eigh(half.T @ half)
            products.append((sign, (half @ directions[:, sizes > least]).T))
        return cls(E, Phi, state, lever, tuple(products))

    def apply(self, f: FilterState, submap: Submap, rows: IntArray) -> None:
        """Applies the updates to the whole map, in which the submap has rows (n,)."""
        r, old = f.robot_size, len(submap.root)
        rest = state_rows(submap.rest, r)[r:]
        E, Phi = self.basis, self.Phi
        changed, new = rows[r:old], np.concatenate([rows[:r], rows[old:]])
        write_block(f.P, rest, changed, _combined(E, Phi[r:old]), 1.0)  # C_BA
        write_block(f.P, rest, new, _combined(E, np.concatenate([Phi[:r], Phi[old:]])), 0.0)
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
        heading = _combined(self.basis, self.Phi[2:3])[:, 0].reshape(-1, 2)
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


def _row_space(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis (q, p) of the rows T (o, q), and F (o, p) with basis = T^T F."""
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


@dataclass
class _Excursion:
    """The motion since the entry into a submap, with its uncertainty."""

    bias: FloatArray
    """(r - 3,) odometry biases at the entry."""
    bias_sigma: FloatArray
    """(r - 3,) their standard deviations."""
    length: float = 0.0
    """Distance in meters."""
    position: float = 0.0
    """Variance of the position by the noise, in square meters."""
    heading: float = 0.0
    """Variance of the heading by the noise, in square radians."""
    biased: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,) bounds of the errors of position and heading by the biases."""

    def add(self, control: tuple[FloatArray, FloatArray] | None) -> None:
        """Adds a motion."""
        if control is None:
            return
        u, U = control
        c = len(u) - 1  # the heading's
        if len(self.bias) > 0:
            D = control_bias(u, 3 + len(self.bias))
            u, bias = u + D @ self.bias, np.abs(D) @ self.bias_sigma
            self.biased += float(np.hypot.reduce(bias[:c])), float(bias[c])
        length = hypot(u[0], u[1]) if c == 2 else abs(float(u[0]))
        heading = float(U[c, c])
        self.length += length
        self.position += float(U[0, 0] + (U[1, 1] if c == 2 else 0.0)) + length**2 * heading
        self.heading += heading

    def reach(self, gate: float) -> float:
        """Largest distance that the robot may have moved, with `gate` standard deviations."""
        position, heading = map(float, self.biased)
        sigma = sqrt(self.position) + position + self.length * (sqrt(self.heading) + heading)
        return float(self.length + gate * sigma)


class SubmapChoice:
    """Chooses the submap in which the next step is taken.

    Args:
        submaps: whether submaps are used "always", "never", or in large maps ("auto").
        gate: squared Mahalanobis distance within which an observation may be of a landmark.
    """

    def __init__(self, submaps: Literal["auto", "always", "never"], gate: float) -> None:
        self._enabled, self._always = submaps != "never", submaps == "always"
        self._gate = sqrt(gate) if isfinite(gate) else 0.0
        self._radius = -1.0
        self._in_whole = False
        self._needed = 0.0
        self._excursion = _Excursion(np.zeros(0), np.zeros(0))

    def update(self, ekf: "EkfSlam", table: "LandmarkTable", scan: Scan, max_range: float) -> None:
        """Enters or leaves a submap for a step, if the present one does not suffice.

        Args:
            ekf: the filter, before the motion.
            table: its landmarks.
            scan: the step.
            max_range: meters within which landmarks are expected.
        """
        if not self._enabled:
            return
        z, R = scan.complete.z, scan.complete.R
        if not self._always and len(ekf) + (ekf.submap is None) * len(z) < LARGE_MAP:
            self._radius = -1.0
            ekf.leave()
            return
        labeled = table.landmarks_of(scan.labels)
        labeled = labeled[labeled >= 0]
        if len(z) > 0:
            max_range = max(max_range, float((z[:, 0] + self._gate * np.sqrt(R[:, 0, 0])).max()))
        if self._radius < 0 or (ekf.submap is None and not self._in_whole):
            self._enter(ekf, scan, labeled, max_range)
            return
        self._excursion.add(scan.control)
        outside = ekf.submap is not None and bool((ekf.rows(labeled) < 0).any())
        if outside or self._excursion.reach(self._gate) + max_range > self._radius:
            self._enter(ekf, scan, labeled, max_range)
        else:
            ekf.flush_early()
        self._needed = max(self._needed, max_range)

    def _enter(self, ekf: "EkfSlam", scan: Scan, labeled: IntArray, needed: float) -> None:
        """Enters the submap around the robot for this step and later ones."""
        ekf.leave()
        f, r = ekf.active, ekf.active.robot_size
        sigma = np.sqrt(np.abs(f.P[range(3, r), range(3, r)]))
        self._excursion = _Excursion(f.state[3:r].copy(), sigma)
        self._excursion.add(scan.control)
        distance = self._excursion.reach(self._gate)
        self._radius = max(needed, self._needed) * (1 + MARGIN) + distance
        self._needed = needed
        predicted, S = ekf.predict_observations()
        q = predicted[:, 0]
        sigma = np.sqrt(np.abs(S[:, 0, 0]) + q * q * np.abs(S[:, 1, 1]))
        near = q - 2 * self._gate * sigma <= self._radius
        near[ekf.rows(labeled)] = True
        self._in_whole = not self._always and near.mean() > MAX_FRACTION
        if not self._in_whole:
            ekf.enter(np.flatnonzero(near))
