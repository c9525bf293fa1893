"""Allocation, growth and read-out of a `FilterState`, and all that is quadratic in the map.

The steps leave low-rank rows beside the covariance between landmarks. Dozens of rows are added in
one pass over the matrix (a blocked symmetric rank-k update), which is limited by arithmetic; a pass
for every row would be limited by memory bandwidth.
"""

from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_void_p
from math import ceil, sqrt
from typing import Literal, TypeAlias

import numpy as np

from saccade._compiler import blas, share
from saccade.slam.filter._kernels import fill_error_factors
from saccade.slam.filter._state_kernels import (
    INVARIANT,
    MAX_HEADING_GROWTH,
    STANDARD,
    FilterState,
    Scalars,
    bind_state,
)
from saccade.slam.filter.robot_models import inverse_observe
from saccade.threads import SERIAL_BLAS
from saccade.types import FloatArray, IntArray

Errors: TypeAlias = Literal["invariant", "standard"]
"""Name of an error parametrization of the state."""
ERRORS: dict[Errors, int] = {"invariant": INVARIANT, "standard": STANDARD}
"""Error parametrizations of the state; `_kernels` has their equations.

"standard", the source's (C.10-C.14), has the errors along the axes of the map. A rotation of the
whole map, which is unobservable, is not linear in those coordinates: Jacobians at successive
estimates make the filter overconfident in its heading. In the right-invariant errors of SE(2)
(Barrau & Bonnabel 2015), xi = (e_p - J p e_theta, e_theta) for the robot and for each landmark with
J a quarter turn, it is linear; a correction moves every point by the exponential of xi.
"""
FIRST_CAPACITY = 32
"""Landmarks for which there is room at first; half as much is added whenever it runs out."""
INFLATED_ROWS = 512
"""Rows of the covariance that `inflate_heading_covariance` changes at once; even."""
COPIED_ROWS = 256
"""Rows of the covariance that are copied at once."""
FLUSHED_ROWS = 128
"""Rows of the covariance to which `flush_rows` adds the delayed rows at once."""

_int, _double = POINTER(c_int), POINTER(c_double)
_dsyrk = blas(
    "dsyrk", c_char_p, c_char_p, _int, _int, _double, c_void_p, _int, _double, c_void_p, _int
)
"""uplo, trans, n, k, alpha, A, lda, beta, C, ldc: C becomes alpha A A^T + beta C."""
_dgemm = blas(
    *("dgemm", c_char_p, c_char_p, _int, _int, _int, _double, c_void_p, _int, c_void_p, _int),
    *(_double, c_void_p, _int),
)
"""transa, transb, m, n, k, alpha, A, lda, B, ldb, beta, C, ldc: C becomes alpha A B^T + beta C."""


def new_state(
    robot: FloatArray,
    covariance: FloatArray,
    capacity: int = FIRST_CAPACITY,
    errors: int = STANDARD,
    huber: float = np.inf,
    *,
    range_errors: int = 0,
    auxiliary: int = 0,
    rank: int = 0,
) -> FilterState:
    """The state of a robot (r,) with its covariance (r, r), and room for `capacity` landmarks."""
    r = len(robot)
    size = r + 2 * (capacity + auxiliary)
    state, P, rank = np.zeros(size), np.zeros((size, size)), max(rank, _num_delayed_rows(size))
    state[:r], P[:r, :r] = robot, covariance
    heading = covariance[2, 2]
    return share(
        FilterState,
        bind_state,
        r,
        errors,
        float(huber),
        range_errors,
        auxiliary,
        np.zeros(capacity, np.int64),
        state,
        np.zeros(size),
        P,
        np.zeros((capacity, 3)),
        *(np.zeros((rank, size)) for _ in range(2)),
        Scalars(heading_variance=heading, lowest_heading_variance=heading),
    )


def _num_delayed_rows(size: int) -> int:
    """Rows of `downdates` and of `updates` that are kept before they are added to P.

    With this number, a pass over P (size, size) takes as long as reading the rows for each
    observation between two passes.
    """
    return 8 * ceil(sqrt(size) / 4)


def like(
    f: FilterState,
    mean: FloatArray,
    covariance: FloatArray,
    ids: IntArray,
    heading_lever: FloatArray | None = None,
) -> FilterState:
    """A state of this mean (n,) and covariance of e (n, n), with the parameters of the state f.

    Without heading levers (n,) these are zero: the estimates are the first ones.
    """
    r, n, N = f.robot_size, len(mean), len(ids)
    a = np.zeros(n) if heading_lever is None else heading_lever
    cross = np.outer(a, covariance[2] - covariance[2, 2] / 2 * a)
    P = covariance - (cross + cross.T)  # of eta = e - a e_theta
    factors = _error_factors(f, mean)
    P[:r] /= factors[:, None]
    P[:, :r] /= factors
    new = new_state(
        *(mean[:r], P[:r, :r], N + FIRST_CAPACITY, f.errors, f.huber), range_errors=f.range_errors
    )
    new.state[:n], new.heading_lever[:n], new.P[:n, :n], new.ids[:N] = mean, a, P, ids
    new.now.next_id = max(int(ids.max(initial=-1)) + 1, f.now.next_id)
    new.now.nonlinearity, new.now.nonlinear_updates = f.now.nonlinearity, f.now.nonlinear_updates
    set_landmarks(new, N)
    return new


def set_landmarks(f: FilterState, landmarks: int) -> None:
    """Sets the number of landmarks, and takes their diagonal blocks from P."""
    i = f.robot_size + 2 * np.arange(landmarks)
    f.blocks[:landmarks] = np.stack([f.P[i, i], f.P[i, i + 1], f.P[i + 1, i + 1]], 1)
    f.now.landmarks = landmarks


def copy_scalars(source: FilterState, target: FilterState) -> None:
    """Copies the numbers that change from step to step."""
    for name, _ in Scalars._fields_:
        setattr(target.now, name, getattr(source.now, name))


def with_capacity(f: FilterState, landmarks: int, rows: int) -> FilterState:
    """The state, or a larger one, with room for new landmarks and delayed rows of this number."""
    now, rank = f.now, len(f.downdates)
    if now.landmarks + landmarks > len(f.blocks) or rows > rank:
        return _grown(f, now.landmarks + landmarks, rows)
    if now.downdates + rows > rank or now.updates == rank:
        flush(f)
    return f


def is_inflation_due(f: FilterState) -> bool:
    """Whether the heading has become so uncertain that `inflate_heading_covariance` is due."""
    growth = f.now.heading_variance - f.now.lowest_heading_variance
    return f.errors == INVARIANT and growth > MAX_HEADING_GROWTH


def state_rows(landmarks: IntArray, r: int) -> IntArray:
    """(r + 2 k,) rows of the robot and of landmarks (k,)."""
    return np.concatenate([np.arange(r), (r + 2 * landmarks[:, None] + [0, 1]).ravel()])


def state_size(f: FilterState) -> int:
    """n: numbers in the state."""
    return int(f.robot_size + 2 * f.now.landmarks)


def _grown(f: FilterState, landmarks: int, rows: int) -> FilterState:
    """A copy of the state with room for landmarks and delayed rows of this number."""
    flush(f)
    capacity, rank = len(f.blocks), len(f.downdates)
    while capacity < landmarks:
        capacity += capacity // 2
    while rank < rows:
        rank *= 2
    r, n, now = f.robot_size, state_size(f), f.now
    new = new_state(
        *(f.state[:r], f.P[:r, :r], capacity, f.errors, f.huber),
        range_errors=f.range_errors,
        auxiliary=f.auxiliary,
        rank=rank,
    )
    copy_scalars(f, new)
    points, new_points = auxiliary_rows(f), auxiliary_rows(new)
    for target, source in ((new.state, f.state), (new.heading_lever, f.heading_lever)):
        target[:n], target[new_points] = source[:n], source[points]
    for start in range(0, n, COPIED_ROWS):  # memory that is never written is never allocated
        end = min(start + COPIED_ROWS, n)
        new.P[start:end, start:n] = f.P[start:end, start:n]
    new.P[:n, new_points] = f.P[:n, points]
    new.P[new_points, new_points] = f.P[points, points]
    new.blocks[: now.landmarks] = f.blocks[: now.landmarks]
    new.ids[: now.landmarks] = f.ids[: now.landmarks]
    return new


def augment(f: FilterState, z: FloatArray, R: FloatArray) -> None:
    """Adds a landmark observed at z (2,) with covariance R (2, 2) (C.15-C.18)."""
    e = f.range_errors
    scale, offset = (1 + f.state[e], f.state[e + 1]) if e > 0 else (1.0, 0.0)
    z = np.array([(z[0] - offset) / scale, z[1]])
    xy, Gx, Gz = inverse_observe(f.state[:3], z)  # C.15, C.18
    Gz[:, 0] /= scale
    by_error = -Gz[:, :1] * [z[0] * (scale if f.errors == INVARIANT else 1.0), 1.0]
    noise = Gz @ R @ Gz.T
    if f.errors == INVARIANT:
        mean, covariance = _second_order_point(f.state[2] + z[1], z[0], R)
        xy, noise = xy + mean, noise + covariance
        Gx[:, 2] = f.state[1] - xy[1], xy[0] - f.state[0]
    r, n, N, P = f.robot_size, state_size(f), f.now.landmarks, f.P
    new, points, a = slice(n, n + 2), auxiliary_rows(f), f.heading_lever
    G = np.zeros((2, r))
    G[:, :3] = Gx
    if e > 0:
        G[:, e : e + 2] = by_error
        G[:, e] += [-f.heading_lever[1], f.heading_lever[0]]  # of the robot's first estimate
    G[:, 2] += Gx[:, :2] @ a[:2]  # by eta
    P[:n, new] = (G @ P[:r, :n]).T  # C.17, Gx Pxx and Gx Pxm
    P[new, points] = G @ P[:r, points]
    P[new, new] = symmetric(G @ P[:r, new] + noise)  # C.17, Gx Pxx Gx^T + Gz R Gz^T
    f.blocks[N] = P[n, n], P[n, n + 1], P[n + 1, n + 1]
    f.state[new], a[new], f.ids[N] = xy, 0.0, f.now.next_id  # C.16
    f.downdates[:, new] = f.updates[:, new] = 0.0
    f.now.heading_variance = P[2, 2]
    f.now.next_id, f.now.landmarks = f.now.next_id + 1, N + 1


def _second_order_point(
    direction: float, distance: float, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (2,) and covariance (2, 2) of the second-order terms of an observed point.

    Along its direction and across it, they are -distance n^2 / 2 and d n, d and n the errors of
    range and bearing.
    """
    c, s, q, k = np.cos(direction), np.sin(direction), R[1, 1], R[0, 1]
    turn = np.array([[c, -s], [s, c]])
    cross = -distance * k * q
    C = np.array([[(distance * q) ** 2 / 2, cross], [cross, R[0, 0] * q + k * k]])
    return turn @ [-distance * q / 2, k], turn @ C @ turn.T


def auxiliary_rows(f: FilterState) -> slice:
    """Rows of the auxiliary points in use."""
    start = len(f.state) - 2 * f.auxiliary
    return slice(start, start + 2 * f.now.auxiliary)


def remove_landmarks(f: FilterState, removed: IntArray) -> None:
    """Marginalizes out the landmarks in these rows."""
    flush(f)
    kept = np.delete(np.arange(f.now.landmarks), removed)
    rows = state_rows(kept, f.robot_size)
    for target, row in enumerate(rows.tolist()):  # rows and columns move towards the beginning
        f.P[target, target : len(rows)] = f.P[row, rows[target:]]
    f.state[: len(rows)], f.heading_lever[: len(rows)] = f.state[rows], f.heading_lever[rows]
    f.blocks[: len(kept)], f.ids[: len(kept)] = f.blocks[kept], f.ids[kept]
    f.now.landmarks = len(kept)


def flush(f: FilterState) -> None:
    """Add `updates` to P and subtract `downdates`."""
    finish_flush(f)
    r, n, now = f.robot_size, state_size(f), f.now
    n = auxiliary_rows(f).stop if f.auxiliary > 0 else n
    parts = ((-1.0, f.downdates, now.downdates), (1.0, f.updates, now.updates))
    with SERIAL_BLAS:
        for sign, rows, used in parts:
            if used > 0:
                size = byref(c_int(len(f.state)))
                _dsyrk(
                    b"L",  # Fortran's lower triangle is our upper one
                    b"N",
                    byref(c_int(n - r)),
                    byref(c_int(used)),
                    byref(c_double(sign)),
                    rows[:, r:].ctypes.data,
                    size,
                    byref(c_double(1.0)),
                    f.P[r:, r:].ctypes.data,
                    size,
                )
    now.downdates = now.updates = 0
    now.mergeable_variance = 0.0


def finish_flush(f: FilterState) -> None:
    """Ends a flush that `flush_rows` has begun."""
    while f.now.flushed > 0:
        flush_rows(f)


def flush_rows(f: FilterState) -> None:
    """`flush` for the next rows of P only, so that its time can be spread over steps.

    Until all have had their turn, `Scalars.flushed` is positive and P must not be read.
    """
    now, end = f.now, state_size(f)
    start = max(now.flushed, f.robot_size)
    now.flushed = start + FLUSHED_ROWS
    with SERIAL_BLAS:
        for sign, rows, used in (-1, f.downdates, now.downdates), (1, f.updates, now.updates):
            if used > 0:
                size, height = byref(c_int(len(f.state))), min(FLUSHED_ROWS, end - start)
                _dgemm(
                    b"N",
                    b"T",
                    byref(c_int(end - start)),
                    byref(c_int(height)),
                    byref(c_int(used)),
                    byref(c_double(sign)),
                    rows[:, start:].ctypes.data,
                    size,
                    rows[:, start:].ctypes.data,
                    size,
                    byref(c_double(1.0)),
                    f.P[start:, start:].ctypes.data,
                    size,
                )
    if now.flushed >= end:
        now.downdates = now.updates = now.flushed = 0
        now.mergeable_variance = 0.0


def inflate_heading_covariance(f: FilterState) -> None:
    """Adds the effect of a heading that has become less certain on the errors xi.

    Noise of the heading moves no point. In the exponential coordinates of SE(2), a point's error e
    along the axes of the map stands for the displacement V(theta) e, V = 1 + J theta / 2 + ..., so
    that more error of the heading turns e by minus half of it: to second order, a growth g of its
    variance adds J P J^T g / 4, P the covariance of all e.

    Source: Barfoot & Furgale (2014): the fourth-order terms of the covariance of a compound pose.
    """
    flush(f)
    n, r, P = state_size(f), f.robot_size, f.P
    quarter = (f.now.heading_variance - f.now.lowest_heading_variance) / 4
    i = np.arange(r, n, 2)
    P[i + 1, i] = P[i, i + 1]
    for start in range(r, n, INFLATED_ROWS):
        _add_turned(P[start : min(start + INFLATED_ROWS, n), start:n], quarter)
    for columns in (slice(2), slice(r, n)):
        _add_turned(P[:2, columns], quarter)
    f.blocks[: len(i)] = np.stack([P[i, i], P[i, i + 1], P[i + 1, i + 1]], 1)
    f.now.lowest_heading_variance = f.now.heading_variance


def _add_turned(block: FloatArray, factor: float) -> None:
    """Add factor J B J^T to the covariances B (2k, 2m) of points, J a quarter turn, in place."""
    xx, xy = block[::2, ::2].copy(), block[::2, 1::2].copy()
    yx, yy = block[1::2, ::2].copy(), block[1::2, 1::2].copy()
    block[::2, ::2] += factor * yy
    block[::2, 1::2] -= factor * yx
    block[1::2, ::2] -= factor * xy
    block[1::2, 1::2] += factor * xx


def add_rows(f: FilterState, sign: float, Y: FloatArray) -> None:
    """Add sign Y^T Y, Y (k, n) zero for the robot, to the covariance."""
    r, n, now = f.robot_size, state_size(f), f.now
    pending, used = (f.updates, "updates") if sign > 0 else (f.downdates, "downdates")
    for row in Y:
        if getattr(now, used) == len(pending):
            flush(f)
        pending[getattr(now, used), :n] = row
        setattr(now, used, getattr(now, used) + 1)
    x, y = Y[:, r::2], Y[:, r + 1 :: 2]
    for i, product in enumerate((x * x, x * y, y * y)):
        f.blocks[: now.landmarks, i] += sign * product.sum(0)
    now.mergeable_variance = 0.0


def marginal(f: FilterState, landmarks: IntArray) -> FloatArray:
    """The covariance of e of the robot and of some landmarks (k,): (r + 2 k, r + 2 k)."""
    rows = state_rows(landmarks, f.robot_size)
    P = f.P[np.minimum(rows[:, None], rows), np.maximum(rows[:, None], rows)]
    return _up_to_date(f, P, f.downdates[:, rows], f.updates[:, rows], f.heading_lever[rows])


def dense(f: FilterState) -> FloatArray:
    """The covariance of e of the whole state (n, n)."""
    n = state_size(f)
    P = symmetric(f.P[:n, :n])
    return _up_to_date(f, P, f.downdates[:, :n], f.updates[:, :n], f.heading_lever[:n])


def _up_to_date(
    f: FilterState, C: FloatArray, downdates: FloatArray, updates: FloatArray, a: FloatArray
) -> FloatArray:
    """Covariance of e by the covariance C of eta without delayed rows, and heading levers a."""
    r = f.robot_size
    plus, minus = updates[: f.now.updates, r:], downdates[: f.now.downdates, r:]
    C[r:, r:] += plus.T @ plus - minus.T @ minus
    C, factors = _by_map(C, a), _error_factors(f, f.state)
    C[:r] *= factors[:, None]
    C[:, :r] *= factors
    return C


def _error_factors(f: FilterState, mean: FloatArray) -> FloatArray:
    """(r,) factors of the robot's errors at this mean (n,)."""
    factors = np.empty(f.robot_size)
    fill_error_factors(f, mean, factors)
    return factors


def symmetric(upper: FloatArray) -> FloatArray:
    """The symmetric matrix with this upper triangle."""
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)


def landmark_blocks(f: FilterState) -> FloatArray:
    """The covariance of e of each landmark (N, 2, 2)."""
    r, n = f.robot_size, state_size(f)
    blocks = f.blocks[: f.now.landmarks][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    a = f.heading_lever[r:n].reshape(-1, 2)
    half = a[:, :, None] * (f.P[2, r:n].reshape(-1, 2) + f.P[2, 2] / 2 * a)[:, None, :]
    return np.asarray(blocks + half + half.transpose(0, 2, 1))


def _by_map(C: FloatArray, a: FloatArray) -> FloatArray:
    """Covariance of e by the covariance C of eta and heading levers a."""
    half = np.outer(a, C[2] + C[2, 2] / 2 * a)
    return np.asarray(C + (half + half.T))
