"""A `FilterState` and its buffers: made, grown, read, and all that is quadratic in the map.

The steps leave thin rows beside the covariance between landmarks. Some dozens of them are
added up at once, in one pass over the matrix: at the speed of the arithmetic, where adding
each by itself goes at the speed of the memory.
"""

from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_void_p
from typing import NamedTuple

import numpy as np

from saccade._jit import blas, kernel
from saccade.types import FloatArray, IntArray

STANDARD, INVARIANT, FIRST_ESTIMATES = 0, 1, 2
"""The filters: how errors are measured."""
LANDMARKS, DOWNDATES, UPDATES, CACHED = 0, 1, 2, 3
"""Places in `FilterState.counts`."""
FIRST_CAPACITY = 32
"""Landmarks for which there is room at first; doubled whenever it runs out."""
RANK = 64
"""Rows of either kind that are kept beside the covariance before they are added up."""
SCRATCH_MATRICES = 7
"""Small matrices that steps and the steps they call need at once."""

_int, _double = POINTER(c_int), POINTER(c_double)
_dsyrk = blas(
    "dsyrk", c_char_p, c_char_p, _int, _int, _double, c_void_p, _int, _double, c_void_p, _int
)
"""uplo, trans, n, k, alpha, A, lda, beta, C, ldc: C becomes alpha A A^T + beta C."""


class FilterState(NamedTuple):
    """A Gaussian over the robot, r numbers of which three are its pose, and N landmarks."""

    state: FloatArray
    """(size,) x, y, theta, other states of the robot, m1x, m1y, ... (C.3); n = r + 2 N in use."""
    heading_lever: FloatArray
    """(size,) a."""
    P: FloatArray
    """(size, size) of eta (C.4): the robot's r rows, and the base's upper triangle."""
    blocks: FloatArray
    """(size, 3) of eta: xx, xy, yy of landmark after landmark, up to date."""
    downdates: FloatArray
    """(rank, size)."""
    updates: FloatArray
    """(rank, size)."""
    workspace: FloatArray
    """(r, size)."""
    mergeable_variance: FloatArray
    """(1,) heading variance of the last row given if no swing has changed since, else 0."""
    cached_rows: FloatArray
    """(rank, size) pairs of rows of what is added up, of landmarks that were observed since."""
    cached_pair: IntArray
    """(N,) pair of each landmark, negative if there is none."""
    scratch: FloatArray
    """(SMALL, r + 2, r + 2) for the small matrices of a step."""
    counts: IntArray
    """(4,) of landmarks, of rows taken and given, and of pairs."""


def new_state(robot: FloatArray, covariance: FloatArray, landmarks: int) -> FilterState:
    """The state of a robot (r,) with its covariance (r, r), and room for `landmarks`."""
    r = len(robot)
    size = r + 2 * landmarks
    b = FilterState(
        state=np.zeros(size),
        heading_lever=np.zeros(size),
        P=np.zeros((size, size)),
        blocks=np.zeros((landmarks, 3)),
        downdates=np.zeros((RANK, size)),
        updates=np.zeros((RANK, size)),
        workspace=np.zeros((r, size)),
        mergeable_variance=np.zeros(1),
        cached_rows=np.zeros((RANK, size)),
        cached_pair=np.full(landmarks, -1),
        scratch=np.zeros((SCRATCH_MATRICES, r + 2, r + 2)),
        counts=np.zeros(4, np.int64),
    )
    b.state[:r], b.P[:r, :r] = robot, covariance
    return b


def grown(b: FilterState) -> FilterState:
    """The same belief with twice the room."""
    flush(b)
    r, n, N = len(b.workspace), size_of(b), len(b.blocks)
    new = new_state(b.state[:r], b.P[:r, :r], 2 * N)
    new.state[:n], new.heading_lever[:n] = b.state[:n], b.heading_lever[:n]
    new.P[:n, :n], new.blocks[:N] = b.P[:n, :n], b.blocks
    new.counts[LANDMARKS] = b.counts[LANDMARKS]
    return new


def without(b: FilterState, landmarks: IntArray) -> None:
    """Forget landmarks; those behind them move up."""
    flush(b)
    r, N = len(b.workspace), int(b.counts[LANDMARKS])
    kept = np.setdiff1d(np.arange(N), landmarks)
    rows = np.concatenate([np.arange(r), (r + 2 * kept[:, None] + [0, 1]).ravel()])
    m = len(rows)
    _gather(b.P, rows)
    b.state[:m], b.heading_lever[:m], b.blocks[: len(kept)] = (
        b.state[rows],
        b.heading_lever[rows],
        b.blocks[kept],
    )
    b.counts[LANDMARKS] = len(kept)


@kernel()
def _gather(P: FloatArray, rows: IntArray) -> None:
    """Move these rows (m,), ascending, and their columns to the beginning of the upper triangle."""
    first = 0
    while first < len(rows) and rows[first] == first:
        first += 1
    for i in range(len(rows)):
        to, whence = P[i], P[rows[i]]
        for j in range(max(first, i), len(rows)):
            to[j] = whence[rows[j]]


def size_of(b: FilterState) -> int:
    """n: numbers in the state."""
    return len(b.workspace) + 2 * int(b.counts[LANDMARKS])


def flush(b: FilterState) -> None:
    """Add up the rows that were taken and given."""
    r, n = len(b.workspace), size_of(b)
    for sign, rows, which in ((-1.0, b.downdates, DOWNDATES), (1.0, b.updates, UPDATES)):
        if b.counts[which] > 0:
            size = byref(c_int(len(b.state)))
            _dsyrk(
                b"L",  # Fortran's lower triangle is our upper one
                b"N",
                byref(c_int(n - r)),
                byref(c_int(int(b.counts[which]))),
                byref(c_double(sign)),
                rows[:, r:].ctypes.data,
                size,
                byref(c_double(1.0)),
                b.P[r:, r:].ctypes.data,
                size,
            )
        b.counts[which] = 0
    b.cached_pair[:] = -1
    b.counts[CACHED] = 0
    b.mergeable_variance[0] = 0.0


def add_rows(b: FilterState, sign: float, Y: FloatArray) -> None:
    """Add sign Y^T Y, Y (k, n) zero for the robot, to the covariance."""
    r, n = len(b.workspace), size_of(b)
    for start in range(0, len(Y), RANK):
        rows = Y[start : start + RANK]
        which, kept = (UPDATES, b.updates) if sign > 0 else (DOWNDATES, b.downdates)
        kept[: len(rows), :n] = rows
        b.counts[which] = len(rows)
        flush(b)
    x, y = Y[:, r::2], Y[:, r + 1 :: 2]
    N = b.counts[LANDMARKS]
    for i, product in enumerate((x * x, x * y, y * y)):
        b.blocks[:N, i] += sign * product.sum(0)


def marginal(b: FilterState, kind: int, landmarks: IntArray) -> FloatArray:
    """The covariance of e of the robot and of some landmarks (k,): (r + 2 k, r + 2 k)."""
    r = len(b.workspace)
    at = np.concatenate([np.arange(r), (r + 2 * landmarks[:, None] + [0, 1]).ravel()])
    C = b.P[np.minimum(at[:, None], at), np.maximum(at[:, None], at)]
    downdates, updates = (
        b.downdates[: b.counts[DOWNDATES], at[r:]],
        b.updates[: b.counts[UPDATES], at[r:]],
    )
    C[r:, r:] += updates.T @ updates - downdates.T @ downdates
    return _by_map(C, _heading_lever(b, kind)[at])


def dense(b: FilterState, kind: int) -> FloatArray:
    """The covariance of e of all (n, n)."""
    flush(b)
    n = size_of(b)
    return _by_map(symmetric(b.P[:n, :n]), _heading_lever(b, kind)[:n])


def symmetric(upper: FloatArray) -> FloatArray:
    """The matrix whose upper triangle this is."""
    triangle = np.triu(upper)
    return triangle + np.triu(triangle, 1).T


def robot_rows(b: FilterState, kind: int) -> FloatArray:
    """The covariance of e of the robot with all (r, n)."""
    r, n, a = len(b.workspace), size_of(b), _heading_lever(b, kind)
    half = b.P[:r, :n] + np.outer(b.P[:r, 2], a[:n])
    return np.asarray(half + np.outer(a[:r], half[2]))


def landmark_blocks(b: FilterState, kind: int) -> FloatArray:
    """The covariance of e of each landmark (N, 2, 2)."""
    r, n = len(b.workspace), size_of(b)
    blocks = b.blocks[: b.counts[LANDMARKS]][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    a = _heading_lever(b, kind)[r:n].reshape(-1, 2)
    half = a[:, :, None] * (b.P[2, r:n].reshape(-1, 2) + b.P[2, 2] / 2 * a)[:, None, :]
    return np.asarray(blocks + half + half.transpose(0, 2, 1))


def _heading_lever(b: FilterState, kind: int) -> FloatArray:
    """(size,) a of e = eta + a e_theta."""
    return b.heading_lever if kind == INVARIANT else np.zeros(len(b.heading_lever))


def _by_map(C: FloatArray, a: FloatArray) -> FloatArray:
    """The covariance of e from that of eta."""
    half = np.outer(a, C[2] + C[2, 2] / 2 * a)
    return np.asarray(C + (half + half.T))
