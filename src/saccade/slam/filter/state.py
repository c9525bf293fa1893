"""A `Belief` and its buffers: made, grown, read, and all that is quadratic in the map.

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
LANDMARKS, TAKEN, GIVEN, KEPT = 0, 1, 2, 3
"""Places in `Belief.used`."""
FIRST_CAPACITY = 32
"""Landmarks for which there is room at first; doubled whenever it runs out."""
RANK = 64
"""Rows of either kind that are kept beside the covariance before they are added up."""
SMALL = 7
"""Small matrices that steps and the steps they call need at once."""

_int, _double = POINTER(c_int), POINTER(c_double)
_dsyrk = blas(
    "dsyrk", c_char_p, c_char_p, _int, _int, _double, c_void_p, _int, _double, c_void_p, _int
)
"""uplo, trans, n, k, alpha, A, lda, beta, C, ldc: C becomes alpha A A^T + beta C."""


class Belief(NamedTuple):
    """A Gaussian over the robot, r numbers of which three are its pose, and N landmarks."""

    state: FloatArray
    """(size,) x, y, theta, other states of the robot, m1x, m1y, ... (C.3); n = r + 2 N in use."""
    swing: FloatArray
    """(size,) a."""
    P: FloatArray
    """(size, size) of eta (C.4): the robot's r rows, and the base's upper triangle."""
    own: FloatArray
    """(size, 3) of eta: xx, xy, yy of landmark after landmark, up to date."""
    taken: FloatArray
    """(rank, size)."""
    given: FloatArray
    """(rank, size)."""
    work: FloatArray
    """(r, size)."""
    fresh: FloatArray
    """(1,) heading variance of the last row given if no swing has changed since, else 0."""
    base: FloatArray
    """(rank, size) pairs of rows of what is added up, of landmarks that were observed since."""
    which: IntArray
    """(N,) pair of each landmark, negative if there is none."""
    small: FloatArray
    """(SMALL, r + 2, r + 2) for the small matrices of a step."""
    used: IntArray
    """(4,) of landmarks, of rows taken and given, and of pairs."""


def new_belief(robot: FloatArray, covariance: FloatArray, landmarks: int) -> Belief:
    """A belief about a robot (r,) with its covariance (r, r), and room for `landmarks`."""
    r = len(robot)
    size = r + 2 * landmarks
    b = Belief(
        state=np.zeros(size),
        swing=np.zeros(size),
        P=np.zeros((size, size)),
        own=np.zeros((landmarks, 3)),
        taken=np.zeros((RANK, size)),
        given=np.zeros((RANK, size)),
        work=np.zeros((r, size)),
        fresh=np.zeros(1),
        base=np.zeros((RANK, size)),
        which=np.full(landmarks, -1),
        small=np.zeros((SMALL, r + 2, r + 2)),
        used=np.zeros(4, np.int64),
    )
    b.state[:r], b.P[:r, :r] = robot, covariance
    return b


def grown(b: Belief) -> Belief:
    """The same belief with twice the room."""
    flush(b)
    r, n, N = len(b.work), size_of(b), len(b.own)
    new = new_belief(b.state[:r], b.P[:r, :r], 2 * N)
    new.state[:n], new.swing[:n] = b.state[:n], b.swing[:n]
    new.P[:n, :n], new.own[:N] = b.P[:n, :n], b.own
    new.used[LANDMARKS] = b.used[LANDMARKS]
    return new


def without(b: Belief, landmarks: IntArray) -> None:
    """Forget landmarks; those behind them move up."""
    flush(b)
    r, N = len(b.work), int(b.used[LANDMARKS])
    kept = np.setdiff1d(np.arange(N), landmarks)
    rows = np.concatenate([np.arange(r), (r + 2 * kept[:, None] + [0, 1]).ravel()])
    m = len(rows)
    _gather(b.P, rows)
    b.state[:m], b.swing[:m], b.own[: len(kept)] = b.state[rows], b.swing[rows], b.own[kept]
    b.used[LANDMARKS] = len(kept)


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


def size_of(b: Belief) -> int:
    """n: numbers in the state."""
    return len(b.work) + 2 * int(b.used[LANDMARKS])


def flush(b: Belief) -> None:
    """Add up the rows that were taken and given."""
    r, n = len(b.work), size_of(b)
    for sign, rows, which in ((-1.0, b.taken, TAKEN), (1.0, b.given, GIVEN)):
        if b.used[which] > 0:
            size = byref(c_int(len(b.state)))
            _dsyrk(
                b"L",  # Fortran's lower triangle is our upper one
                b"N",
                byref(c_int(n - r)),
                byref(c_int(int(b.used[which]))),
                byref(c_double(sign)),
                rows[:, r:].ctypes.data,
                size,
                byref(c_double(1.0)),
                b.P[r:, r:].ctypes.data,
                size,
            )
        b.used[which] = 0
    b.which[:] = -1
    b.used[KEPT] = 0
    b.fresh[0] = 0.0


def add_rows(b: Belief, sign: float, Y: FloatArray) -> None:
    """Add sign Y^T Y, Y (k, n) zero for the robot, to the covariance."""
    r, n = len(b.work), size_of(b)
    for start in range(0, len(Y), RANK):
        rows = Y[start : start + RANK]
        which, kept = (GIVEN, b.given) if sign > 0 else (TAKEN, b.taken)
        kept[: len(rows), :n] = rows
        b.used[which] = len(rows)
        flush(b)
    x, y = Y[:, r::2], Y[:, r + 1 :: 2]
    N = b.used[LANDMARKS]
    for i, product in enumerate((x * x, x * y, y * y)):
        b.own[:N, i] += sign * product.sum(0)


def marginal(b: Belief, kind: int, landmarks: IntArray) -> FloatArray:
    """The covariance of e of the robot and of some landmarks (k,): (r + 2 k, r + 2 k)."""
    r = len(b.work)
    at = np.concatenate([np.arange(r), (r + 2 * landmarks[:, None] + [0, 1]).ravel()])
    C = b.P[np.minimum(at[:, None], at), np.maximum(at[:, None], at)]
    taken, given = b.taken[: b.used[TAKEN], at[r:]], b.given[: b.used[GIVEN], at[r:]]
    C[r:, r:] += given.T @ given - taken.T @ taken
    return _by_map(C, _swing(b, kind)[at])


def dense(b: Belief, kind: int) -> FloatArray:
    """The covariance of e of all (n, n)."""
    flush(b)
    n = size_of(b)
    return _by_map(symmetric(b.P[:n, :n]), _swing(b, kind)[:n])


def symmetric(upper: FloatArray) -> FloatArray:
    """The matrix whose upper triangle this is."""
    triangle = np.triu(upper)
    return triangle + np.triu(triangle, 1).T


def robot_rows(b: Belief, kind: int) -> FloatArray:
    """The covariance of e of the robot with all (r, n)."""
    r, n, a = len(b.work), size_of(b), _swing(b, kind)
    half = b.P[:r, :n] + np.outer(b.P[:r, 2], a[:n])
    return np.asarray(half + np.outer(a[:r], half[2]))


def landmark_blocks(b: Belief, kind: int) -> FloatArray:
    """The covariance of e of each landmark (N, 2, 2)."""
    r, n = len(b.work), size_of(b)
    own = b.own[: b.used[LANDMARKS]][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    a = _swing(b, kind)[r:n].reshape(-1, 2)
    half = a[:, :, None] * (b.P[2, r:n].reshape(-1, 2) + b.P[2, 2] / 2 * a)[:, None, :]
    return np.asarray(own + half + half.transpose(0, 2, 1))


def _swing(b: Belief, kind: int) -> FloatArray:
    """(size,) a of e = eta + a e_theta."""
    return b.swing if kind == INVARIANT else np.zeros(len(b.swing))


def _by_map(C: FloatArray, a: FloatArray) -> FloatArray:
    """The covariance of e from that of eta."""
    half = np.outer(a, C[2] + C[2, 2] / 2 * a)
    return np.asarray(C + (half + half.T))
