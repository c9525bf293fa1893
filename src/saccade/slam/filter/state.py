"""Allocation, growth and read-out of a `FilterState`, and all that is quadratic in the map.

The steps leave low-rank rows beside the covariance between landmarks. Some dozens of them are
added in one pass over the matrix (a blocked symmetric rank-k update), which is limited by
arithmetic; adding each by itself would be limited by memory bandwidth.
"""

from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_void_p
from typing import Any

import numpy as np

from saccade._jit import blas
from saccade.slam.checkpoint import Arrays
from saccade.slam.filter._state_kernels import (
    CACHED,
    DOWNDATES,
    INVARIANT,
    LANDMARKS,
    UPDATES,
    FilterState,
    Scratch,
    gather,
    num_rows,
)
from saccade.types import FloatArray, IntArray

FIRST_CAPACITY = 32
"""Landmarks for which there is room at first; doubled whenever it runs out."""
SPREAD_ROWS = 512
"""Rows of the covariance that `spread` changes at once; even."""
RANK = 64
"""Rows of `downdates` and of `updates` that are kept before they are added to P."""

_int, _double = POINTER(c_int), POINTER(c_double)
_dsyrk = blas(
    "dsyrk", c_char_p, c_char_p, _int, _int, _double, c_void_p, _int, _double, c_void_p, _int
)
"""uplo, trans, n, k, alpha, A, lda, beta, C, ldc: C becomes alpha A A^T + beta C."""


def new_state(
    robot: FloatArray,
    covariance: FloatArray,
    capacity: int,
    error_state: int,
    huber: float,
    auxiliary: int = 0,
) -> FilterState:
    """The state of a robot (r,) with its covariance (r, r), and room for `capacity` landmarks."""
    r = len(robot)
    size = r + 2 * (capacity + auxiliary)
    f = FilterState(
        robot_size=r,
        error_state=error_state,
        huber=float(huber),
        auxiliary=auxiliary,
        state=np.zeros(size),
        heading_lever=np.zeros(size),
        P=np.zeros((size, size)),
        blocks=np.zeros((capacity, 3)),
        downdates=np.zeros((RANK, size)),
        updates=np.zeros((RANK, size)),
        mergeable_variance=np.zeros(1),
        cached_rows=np.zeros((RANK, size)),
        nonlinearity=np.zeros(2),
        heading_variance=np.full(2, covariance[2, 2]),
        cached_pair=np.full(capacity, -1),
        counts=np.zeros(4, np.int64),
    )
    f.state[:r], f.P[:r, :r] = robot, covariance
    return f


def new_scratch(f: FilterState) -> Scratch:
    """Memory for the steps of a filter with this state."""
    r, size = f.robot_size, len(f.state)
    return Scratch(
        control=np.zeros(3),
        pose=np.zeros(r),
        Fx=np.zeros((r, r)),
        Fu=np.zeros((r, 3)),
        Q=np.zeros((r, r)),
        G=np.zeros((r, r)),
        Pxx=np.zeros((r, r)),
        rows=np.zeros((r, size)),
        heading_row=np.zeros(r),
        heading_covariance=np.zeros(r),
        H=np.zeros((2, r + 2)),
        R=np.zeros((2, 2)),
        Gz=np.zeros((2, 2)),
        Gx=np.zeros((2, r)),
        xy=np.zeros(2),
        row=np.zeros(r),
        C=np.zeros((r + 2, r + 2)),
        D=np.zeros((2, r + 2)),
        A=np.zeros((2, 2)),
        S=np.zeros((2, 2)),
        second_order=np.zeros((3, 3)),
    )


def saved(f: FilterState) -> Arrays:
    """The arrays of a state, for a checkpoint."""
    return {name: array for name, array in f._asdict().items() if isinstance(array, np.ndarray)}


def compact(f: FilterState) -> Arrays:
    """The arrays of a state without room for more, for a file."""
    flush(f)
    n = state_size(f)
    return {
        "state": f.state[:n],
        "heading_lever": f.heading_lever[:n],
        "P": f.P[:n, :n][np.triu_indices(n)],
        "blocks": f.blocks[: f.counts[LANDMARKS]],
        "heading_variance": f.heading_variance,
        "nonlinearity": f.nonlinearity,
    }


def expanded(f: FilterState, arrays: Arrays) -> FilterState:
    """A state with `compact` arrays, and the parameters of another one."""
    r, n, N = f.robot_size, len(arrays["state"]), len(arrays["blocks"])
    capacity = max(N, FIRST_CAPACITY)
    new = new_state(np.zeros(r), np.zeros((r, r)), capacity, f.error_state, f.huber)
    new.state[:n], new.heading_lever[:n] = arrays["state"], arrays["heading_lever"]
    new.P[:n, :n][np.triu_indices(n)] = arrays["P"]
    new.P[:r, :r] = symmetric(new.P[:r, :r])
    new.blocks[:N], new.counts[LANDMARKS] = arrays["blocks"], N
    new.heading_variance[:] = arrays["heading_variance"]
    new.nonlinearity[:] = arrays["nonlinearity"]
    return new


def gaussian_state(f: FilterState, mean: FloatArray, covariance: FloatArray) -> FilterState:
    """A state of this mean (n,) and covariance of e (n, n), with the parameters of another one.

    Its estimates are the first ones, so that eta = e.
    """
    r, N = f.robot_size, (len(mean) - f.robot_size) // 2
    new = new_state(mean[:r], covariance[:r, :r], max(N, FIRST_CAPACITY), f.error_state, f.huber)
    new.state[: len(mean)], new.P[: len(mean), : len(mean)] = mean, covariance
    diagonal = covariance[r:, r:].reshape(N, 2, N, 2)[np.arange(N), :, np.arange(N)]  # (N, 2, 2)
    new.blocks[:N], new.counts[LANDMARKS] = diagonal.reshape(N, 4)[:, [0, 1, 3]], N
    return new


def restored(f: FilterState, arrays: Arrays) -> FilterState:
    """A state with `saved` arrays, and the parameters of another one."""
    fields: dict[str, Any] = {name: arrays[name] for name in saved(f)}
    return f._replace(**fields)


def state_rows(landmarks: IntArray, r: int) -> IntArray:
    """(r + 2 k,) rows of the robot and of landmarks (k,)."""
    return np.concatenate([np.arange(r), (r + 2 * landmarks[:, None] + [0, 1]).ravel()])


def state_size(f: FilterState) -> int:
    """n: numbers in the state."""
    return f.robot_size + 2 * int(f.counts[LANDMARKS])


def grown(f: FilterState) -> FilterState:
    """The same state with twice the capacity."""
    flush(f)
    r, n, N = f.robot_size, state_size(f), len(f.blocks)
    new = new_state(f.state[:r], f.P[:r, :r], 2 * N, f.error_state, f.huber, f.auxiliary)
    for rows, old in ((slice(n), slice(n)), (auxiliary_rows(new), auxiliary_rows(f))):
        new.state[rows], new.heading_lever[rows] = f.state[old], f.heading_lever[old]
        new.P[:n, rows] = f.P[:n, old]
    new.P[auxiliary_rows(new), auxiliary_rows(new)] = f.P[auxiliary_rows(f), auxiliary_rows(f)]
    new.blocks[:N] = f.blocks
    new.heading_variance[:] = f.heading_variance
    new.nonlinearity[:] = f.nonlinearity
    new.counts[LANDMARKS] = f.counts[LANDMARKS]
    return new


def auxiliary_rows(f: FilterState) -> slice:
    """Rows of the auxiliary points."""
    return slice(len(f.state) - 2 * f.auxiliary, len(f.state))


def remove_landmarks(f: FilterState, landmarks: IntArray) -> None:
    """Marginalize landmarks out; those behind them move up."""
    flush(f)
    kept = np.setdiff1d(np.arange(f.counts[LANDMARKS]), landmarks)
    rows = state_rows(kept, f.robot_size)
    gather(f.P, rows)
    f.state[: len(rows)], f.heading_lever[: len(rows)] = f.state[rows], f.heading_lever[rows]
    f.blocks[: len(kept)] = f.blocks[kept]
    f.counts[LANDMARKS] = len(kept)


def replace_pose(f: FilterState, pose: FloatArray, covariance: FloatArray) -> None:
    """Replace the pose by another one, independent of all else.

    The invariant error of a landmark depends on that of the heading: of the new one not, if the
    landmarks' present estimates are their first.
    """
    n, N = state_size(f), int(f.counts[LANDMARKS])
    P = dense(f)
    P[:3], P[:, :3] = 0.0, 0.0
    P[:3, :3] = covariance
    f.state[:3], f.P[:n, :n] = pose, P
    f.heading_lever[: n if f.error_state == INVARIANT else 3] = 0.0
    diagonal = P[f.robot_size :, f.robot_size :].reshape(N, 2, N, 2)
    blocks = diagonal[np.arange(N), :, np.arange(N)]  # (N, 2, 2)
    f.blocks[:N] = blocks.reshape(N, 4)[:, [0, 1, 3]]


def flush(f: FilterState) -> None:
    """Add `updates` to P and subtract `downdates`."""
    r, n = f.robot_size, num_rows(f)
    for sign, rows, which in ((-1.0, f.downdates, DOWNDATES), (1.0, f.updates, UPDATES)):
        if f.counts[which] > 0:
            size = byref(c_int(len(f.state)))
            _dsyrk(
                b"L",  # Fortran's lower triangle is our upper one
                b"N",
                byref(c_int(n - r)),
                byref(c_int(int(f.counts[which]))),
                byref(c_double(sign)),
                rows[:, r:].ctypes.data,
                size,
                byref(c_double(1.0)),
                f.P[r:, r:].ctypes.data,
                size,
            )
        f.counts[which] = 0
    f.cached_pair[:] = -1
    f.counts[CACHED] = 0
    f.mergeable_variance[0] = 0.0


def spread(f: FilterState) -> None:
    """Add to the covariance what a heading that has become less certain does to the errors xi.

    Noise of the heading moves no point. In the exponential coordinates of SE(2), a point's error e
    along the axes of the map stands for the displacement V(theta) e, V = 1 + J theta / 2 + ..., so
    that more error of the heading turns e by minus half of it: to second order, a growth g of its
    variance adds J P J^T g / 4, P the covariance of all e.

    Source: Barfoot & Furgale (2014): the fourth-order terms of the covariance of a compound pose.
    """
    flush(f)
    n, r, P = state_size(f), f.robot_size, f.P
    quarter = (f.heading_variance[1] - f.heading_variance[0]) / 4
    i = np.arange(r, n, 2)
    P[i + 1, i] = P[i, i + 1]
    for start in range(r, n, SPREAD_ROWS):
        _add_turned(P[start : min(start + SPREAD_ROWS, n), start:n], quarter)
    for columns in (slice(2), slice(r, n)):
        _add_turned(P[:2, columns], quarter)
    f.blocks[: len(i)] = np.stack([P[i, i], P[i, i + 1], P[i + 1, i + 1]], 1)
    f.heading_variance[0] = f.heading_variance[1]


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
    r, n = f.robot_size, state_size(f)
    which, pending = (UPDATES, f.updates) if sign > 0 else (DOWNDATES, f.downdates)
    for row in Y:
        if f.counts[which] == len(pending):
            flush(f)
        pending[f.counts[which], :n] = row
        f.counts[which] += 1
    x, y = Y[:, r::2], Y[:, r + 1 :: 2]
    N = f.counts[LANDMARKS]
    for i, product in enumerate((x * x, x * y, y * y)):
        f.blocks[:N, i] += sign * product.sum(0)
    f.mergeable_variance[0] = 0.0


def marginal(f: FilterState, landmarks: IntArray) -> FloatArray:
    """The covariance of e of the robot and of some landmarks (k,): (r + 2 k, r + 2 k)."""
    r = f.robot_size
    rows = state_rows(landmarks, r)
    C = f.P[np.minimum(rows[:, None], rows), np.maximum(rows[:, None], rows)]
    downdates = f.downdates[: f.counts[DOWNDATES], rows[r:]]
    updates = f.updates[: f.counts[UPDATES], rows[r:]]
    C[r:, r:] += updates.T @ updates - downdates.T @ downdates
    return _by_map(C, _heading_lever(f)[rows])


def dense(f: FilterState) -> FloatArray:
    """The covariance of e of the whole state (n, n)."""
    flush(f)
    n = state_size(f)
    return _by_map(symmetric(f.P[:n, :n]), _heading_lever(f)[:n])


def symmetric(upper: FloatArray) -> FloatArray:
    """The symmetric matrix with this upper triangle."""
    triangle = np.triu(upper)
    return triangle + np.triu(triangle, 1).T


def robot_rows(f: FilterState) -> FloatArray:
    """The covariance of e of the robot with the whole state (r, n)."""
    r, n, a = f.robot_size, state_size(f), _heading_lever(f)
    half = f.P[:r, :n] + np.outer(f.P[:r, 2], a[:n])
    return np.asarray(half + np.outer(a[:r], half[2]))


def landmark_blocks(f: FilterState) -> FloatArray:
    """The covariance of e of each landmark (N, 2, 2)."""
    r, n = f.robot_size, state_size(f)
    blocks = f.blocks[: f.counts[LANDMARKS]][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    a = _heading_lever(f)[r:n].reshape(-1, 2)
    half = a[:, :, None] * (f.P[2, r:n].reshape(-1, 2) + f.P[2, 2] / 2 * a)[:, None, :]
    return np.asarray(blocks + half + half.transpose(0, 2, 1))


def _heading_lever(f: FilterState) -> FloatArray:
    """(size,) a of e = eta + a e_theta."""
    if f.error_state == INVARIANT:
        return f.heading_lever
    return np.zeros(len(f.heading_lever))


def _by_map(C: FloatArray, a: FloatArray) -> FloatArray:
    """The covariance of e from that of eta."""
    half = np.outer(a, C[2] + C[2, 2] / 2 * a)
    return np.asarray(C + (half + half.T))


def rescale(f: FilterState, factor: float, about: FloatArray) -> None:
    """See `EkfSlam.rescale`."""
    flush(f)
    n, r = state_size(f), f.robot_size
    scale = np.full(n, factor)
    scale[2:r] = 1.0
    for i in (0, 1):
        rows = np.append(i, np.arange(r + i, n, 2))
        f.state[rows] = about[i] + factor * (f.state[rows] - about[i])
    f.heading_lever[:n] *= scale
    f.P[:n, :n] *= scale[:, None] * scale
    f.blocks[: f.counts[LANDMARKS]] *= factor**2
