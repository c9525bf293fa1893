"""The arithmetic of the filter on plain arrays: each step changes the `FilterState` it is given.

What is stored of the covariance is that of the errors

    eta = e - a e_theta,    a = J (s - f) for the robot's place and every landmark, 0 for all else,

e the errors along the axes of the map, J a quarter turn, s the state, and f where each
point was believed to be first: a landmark when it was augmented, the robot when it last
moved. In these errors a correction of the invariant filter carries no covariance along, an
observation depends on f alone, and moving the robot leaves the landmarks but for the
noise of its heading. The other filters have eta = e; the standard one's a is zero, that
of first estimates says at which f the slopes are to be taken.
"""

from math import sin, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._row_kernels import add_product, mix, mix_two
from saccade.slam.filter.state import (
    CACHED,
    DOWNDATES,
    INVARIANT,
    LANDMARKS,
    STANDARD,
    UPDATES,
    FilterState,
)
from saccade.types import FloatArray

SINGULAR = 1e-13
"""An innovation variance under this share of the terms that it is the sum of counts as zero."""
ROUNDING = 1e-9
"""Share of a variance by which a correction that takes more than all of it is rounding."""
TINY = 1e-100
"""Square metres or radians; variances under it are zero."""


@kernel()
def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return angle if -np.pi < angle <= np.pi else np.pi - (np.pi - angle) % (2 * np.pi)


@kernel()
def sandwich(
    A: FloatArray,
    C: FloatArray,
    noise: FloatArray,
    scale: float,
    out: FloatArray,
    shape: tuple[int, int],
) -> None:
    """Fill out (n, n) = A C A^T + scale noise, C and noise symmetric; A's shape is (n, m)."""
    n, m = shape
    for i in range(n):
        for j in range(i + 1):
            total = scale * noise[i, j]
            for k in range(m):
                part = 0.0
                for o in range(m):
                    part += C[k, o] * A[j, o]
                total += A[i, k] * part
            out[i, j] = out[j, i] = total


@kernel(fastmath=("contract",))
def predict(b: FilterState, kind: int, moved: FloatArray, F: FloatArray, Q: FloatArray) -> None:
    """Move the robot to `moved` (r,), F (r, r) its slope, Q (r, r) its noise (C.5-C.6)."""
    r = len(b.workspace)
    n = r + 2 * b.counts[LANDMARKS]
    P, old, a = b.P, b.workspace, b.heading_lever
    G, Pxx, leak, turn = b.scratch[0], b.scratch[1], b.scratch[2, 0], b.scratch[2, 1]
    for i in range(r):
        leak[i] = 0.0
        for k in range(r):
            G[i, k], Pxx[i, k] = F[i, k], P[i, k]
        G[i, 2] += F[i, 0] * a[0] + F[i, 1] * a[1]  # by eta
    if kind == INVARIANT:  # covariance of the robot, once moved, with the error of the turn
        before = 0.0
        for k in range(r):
            turn[k] = G[2, k] - (1.0 if k == 2 else 0.0)
        for k in range(r):
            with_turn = 0.0
            for i in range(r):
                with_turn += Pxx[k, i] * turn[i]
            before += with_turn if k == 2 else 0.0
            for i in range(r):
                leak[i] += G[i, k] * with_turn
        for i in range(r):
            leak[i] += Q[i, 2]
        _add_heading_noise(b, turn, leak[2] - before)
    sandwich(G, Pxx, Q, 1.0, P, (r, r))  # C.6, Pxx
    for i in range(r):
        mix(old[i, r:n], 0.0, 1.0, P[i, r:n])
    for i in range(r):
        row = P[i, r:n]
        if kind == INVARIANT:
            mix(row, G[i, i], -leak[i], a[r:n])
        elif G[i, i] != 1:
            mix(row, G[i, i], 0.0, row)
        for k in range(r):
            if k != i and G[i, k] != 0:
                mix(row, 1.0, G[i, k], old[k, r:n])  # C.6, Pxm
        b.state[i] = moved[i]  # C.5
    a[0] = a[1] = 0.0


@kernel(fastmath=("contract",))
def _add_heading_noise(b: FilterState, turn: FloatArray, variance: float) -> None:
    """Change the landmarks' eta by -a e, e the error of a turn, `variance` in all.

    It is turn . eta of the robot before the step, and noise.
    """
    r = len(b.workspace)
    n = r + 2 * b.counts[LANDMARKS]
    a, y, x = (
        b.heading_lever[r:n],
        b.updates[b.counts[UPDATES], r:n],
        b.downdates[b.counts[DOWNDATES], r:n],
    )
    if variance <= 0:
        return
    root, coupled = sqrt(variance), False
    mix(y, 0.0, root, a)
    for k in range(r):
        if turn[k] != 0:
            mix(x, 1.0 if coupled else 0.0, turn[k] / root, b.P[k, r:n])
            coupled = True
    if coupled:
        mix(y, 1.0, -1.0, x)
        _add_to_blocks(b, x, -1.0)
        b.counts[DOWNDATES] += 1
        b.mergeable_variance[0] = 0.0
    _add_to_blocks(b, y, 1.0)
    if b.mergeable_variance[0] > 0:
        mix(
            b.updates[b.counts[UPDATES] - 1, r:n],
            sqrt(1 + variance / b.mergeable_variance[0]),
            0.0,
            a,
        )
    else:
        b.counts[UPDATES] += 1
    b.mergeable_variance[0] += 0.0 if coupled else variance


@kernel(fastmath=("contract",))
def _add_to_blocks(b: FilterState, y: FloatArray, sign: float) -> None:
    """Add sign y^T y, y (2N,), to the landmarks' own blocks."""
    blocks, xy = b.blocks, y.reshape((len(y) // 2, 2))
    for i in range(len(xy)):
        first, second = xy[i, 0], xy[i, 1]
        blocks[i, 0] += sign * first * first
        blocks[i, 1] += sign * first * second
        blocks[i, 2] += sign * second * second


@kernel()
def update(
    b: FilterState,
    kind: int,
    m: int,
    v: FloatArray,
    H: FloatArray,
    noise: FloatArray,
    huber: float,
    S: FloatArray,
) -> float:
    """Correct by an innovation v (2,) of the landmark at row m; gives v^T S^-1 v, and fills S.

    An innovation whose root of that is over `huber` has its noise as many times larger.
    H (2, r + 2) is by eta of the robot and the landmark, `noise` (2, 2) the covariance of the
    observation. Only their columns take part in the gain (C.10-C.13).
    """
    r, P = len(b.workspace), b.P
    n = r + 2 * b.counts[LANDMARKS]
    D, A = b.scratch[0], b.scratch[1]
    prepare_update(b, m, H, noise, 1.0, S, D, A)
    first, second = A[0, 0] * v[0] + A[0, 1] * v[1], A[1, 0] * v[0] + A[1, 1] * v[1]
    nis = first * first + second * second
    if nis > huber * huber:
        prepare_update(b, m, H, noise, sqrt(nis) / huber, b.scratch[2], D, A)
        first, second = A[0, 0] * v[0] + A[0, 1] * v[1], A[1, 0] * v[0] + A[1, 1] * v[1]
    V = b.downdates[b.counts[DOWNDATES] : b.counts[DOWNDATES] + 2]
    _observed_rows(b, m, D, V)
    for i in range(r):
        if V[0, i] ** 2 + V[1, i] ** 2 > P[i, i] * (1 + ROUNDING):
            V[0, i] = V[1, i] = 0.0
    _downdate_blocks(b, V)
    x, y = V[0, :n], V[1, :n]
    for i in range(r):
        mix_two(P[i, :n], -V[0, i], x, -V[1, i], y)  # C.11: W S W^T = V^T V
    b.counts[DOWNDATES] += 2
    _retract(b, kind, first, second, V)
    return float(nis)


@kernel()
def prepare_update(
    b: FilterState,
    m: int,
    H: FloatArray,
    noise: FloatArray,
    scale: float,
    S: FloatArray,
    D: FloatArray,
    A: FloatArray,
) -> None:
    """Fill S (C.12) of an observation as in `update`; D = A H; and A.

    A (2, 2) is the inverse root of S: A S A^T = 1 on the directions in which S has a
    variance. What rounding leaves of one that is much smaller than its terms is none.
    """
    r, P, C = len(b.workspace), b.P, b.scratch[3]
    q, blocks = r + 2, b.blocks[(m - r) // 2]
    for i in range(r):
        for j in range(r):
            C[i, j] = P[i, j]
        C[i, r] = C[r, i] = P[i, m]
        C[i, r + 1] = C[r + 1, i] = P[i, m + 1]
    C[r, r], C[r, r + 1], C[r + 1, r], C[r + 1, r + 1] = blocks[0], blocks[1], blocks[1], blocks[2]
    sandwich(H, C, noise, scale, S, (2, q))
    s0, s1 = 0.0, 0.0
    for i in range(q):
        deviation = sqrt(abs(C[i, i]))
        s0 += abs(H[0, i]) * deviation
        s1 += abs(H[1, i]) * deviation
    s0, s1 = s0 * s0 + scale * noise[0, 0], s1 * s1 + scale * noise[1, 1]
    i = 0 if S[0, 0] * s1 >= S[1, 1] * s0 else 1
    j, si, sj = 1 - i, s0 if i == 0 else s1, s1 if i == 0 else s0
    A[0, 0] = A[0, 1] = A[1, 0] = A[1, 1] = 0.0
    if S[i, i] > SINGULAR * si + TINY:
        slope = S[i, j] / S[i, i]
        rest = S[j, j] - slope * S[i, j]
        A[i, i] = 1 / sqrt(S[i, i])
        if rest > SINGULAR * sj + TINY:
            A[j, j] = 1 / sqrt(rest)
            A[j, i] = -slope * A[j, j]
    for i in range(q):
        D[0, i] = A[0, 0] * H[0, i] + A[0, 1] * H[1, i]
        D[1, i] = A[1, 0] * H[0, i] + A[1, 1] * H[1, i]


@kernel(fastmath=("contract",))
def _observed_rows(b: FilterState, m: int, D: FloatArray, V: FloatArray) -> None:
    """Fill V (2, n) with D's product with the covariance of eta, D as `prepare_update` gives it."""
    r, P = len(b.workspace), b.P
    n = r + 2 * b.counts[LANDMARKS]
    base = 2 * _cached_rows(b, m)
    for k in range(2):
        v, first, second = V[k, :n], D[k, r], D[k, r + 1]
        mix(v, 0.0, D[k, 0], P[0, :n])
        mix_two(v, D[k, 1], P[1, :n], D[k, 2], P[2, :n])
        for i in range(3, r):
            if D[k, i] != 0:
                mix(v, 1.0, D[k, i], P[i, :n])
        for i in range(r):
            v[i] += first * P[i, m] + second * P[i, m + 1]
        mix_two(v[r:], first, b.cached_rows[base, r:n], second, b.cached_rows[base + 1, r:n])
    add_product(V, D, r, m, -1.0, b.downdates, b.counts[DOWNDATES], n)
    add_product(V, D, r, m, 1.0, b.updates, b.counts[UPDATES], n)


@kernel()
def _cached_rows(b: FilterState, m: int) -> int:
    """Which pair of `FilterState.cached_rows` holds the two rows from row m of what is added up.

    Half of each is a column of the upper triangle, far apart in memory; a landmark that is in
    view is observed again and again until the next rows are added up.
    """
    r, i = len(b.workspace), (m - len(b.workspace)) // 2
    n = r + 2 * b.counts[LANDMARKS]
    if b.cached_pair[i] < 0:
        first, second, P = (
            b.cached_rows[2 * b.counts[CACHED]],
            b.cached_rows[2 * b.counts[CACHED] + 1],
            b.P,
        )
        for j in range(r, m):
            first[j], second[j] = P[j, m], P[j, m + 1]
        first[m], first[m + 1] = P[m, m], P[m, m + 1]
        second[m], second[m + 1] = P[m, m + 1], P[m + 1, m + 1]
        mix(first[m + 2 : n], 0.0, 1.0, P[m, m + 2 : n])
        mix(second[m + 2 : n], 0.0, 1.0, P[m + 1, m + 2 : n])
        b.cached_pair[i] = b.counts[CACHED]
        b.counts[CACHED] += 1
    return int(b.cached_pair[i])


@kernel()
def _invalidate_cache(b: FilterState) -> None:
    """What is added up has changed."""
    for i in range(b.counts[LANDMARKS]):
        b.cached_pair[i] = -1
    b.counts[CACHED] = 0


@kernel(fastmath=("contract",))
def _downdate_blocks(b: FilterState, V: FloatArray) -> None:
    """Take V^T V, V (2, n), from the landmarks' own blocks, but no more than is there."""
    r, blocks = len(b.workspace), b.blocks
    n = r + 2 * b.counts[LANDMARKS]
    x, y = V[0, r:n].reshape((n - r) // 2, 2), V[1, r:n].reshape((n - r) // 2, 2)
    for i in range(len(x)):
        if x[i, 0] ** 2 + y[i, 0] ** 2 > blocks[i, 0] * (1 + ROUNDING):
            x[i, 0] = y[i, 0] = 0.0
        if x[i, 1] ** 2 + y[i, 1] ** 2 > blocks[i, 2] * (1 + ROUNDING):
            x[i, 1] = y[i, 1] = 0.0
        blocks[i, 0] -= x[i, 0] ** 2 + y[i, 0] ** 2
        blocks[i, 1] -= x[i, 0] * x[i, 1] + y[i, 0] * y[i, 1]
        blocks[i, 2] -= x[i, 1] ** 2 + y[i, 1] ** 2


@kernel(fastmath=("contract",))
def _retract(b: FilterState, kind: int, first: float, second: float, V: FloatArray) -> None:
    """Correct the state by first V[0] + second V[1], errors of eta (C.10).

    The invariant filter's state is corrected by an exponential.
    """
    s, a, r, sine, lost, p, q = b.state, b.heading_lever, len(b.workspace), 0.0, 0.0, 1.0, 0.0
    turn = first * V[0, 2] + second * V[1, 2]
    if kind == INVARIANT and turn != 0:
        sine, lost = sin(turn), 2 * sin(turn / 2) ** 2
        p, q = sine / turn, lost / turn
    for i in range(2, r):
        s[i] += first * V[0, i] + second * V[1, i]
    s[2] = wrapped(s[2])
    n, by = r + 2 * b.counts[LANDMARKS], (first, second, p, q, sine, lost)
    _retract_points(s[:2], a[:2], V[0, :2], V[1, :2], by, kind)
    _retract_points(s[r:n], a[r:n], V[0, r:n], V[1, r:n], by, kind)
    b.mergeable_variance[0] = 0.0


@kernel(fastmath=("contract",))
def _retract_points(
    s: FloatArray, a: FloatArray, v: FloatArray, w: FloatArray, by: tuple[float, ...], kind: int
) -> None:
    """Correct points s (2 k,) and their swing by rows v and w of V, see `_retract`."""
    first, second, p, q, sine, lost = by
    shape = (len(s) // 2, 2)
    points, swings, x0, x1 = s.reshape(shape), a.reshape(shape), v.reshape(shape), w.reshape(shape)
    for i in range(len(points)):
        e, f = first * x0[i, 0] + second * x1[i, 0], first * x0[i, 1] + second * x1[i, 1]
        x = p * e - q * f + sine * swings[i, 0] - lost * swings[i, 1]
        y = q * e + p * f + lost * swings[i, 0] + sine * swings[i, 1]
        points[i, 0] += x
        points[i, 1] += y
        if kind != STANDARD:
            swings[i, 0] -= y
            swings[i, 1] += x


@kernel(fastmath=("contract",))
def augment(b: FilterState, xy: FloatArray, G: FloatArray, noise: FloatArray) -> None:
    """Take in a landmark at xy (2,), its slope G (2, r) by the robot, and noise (C.16-C.17)."""
    r, P, D = len(b.workspace), b.P, b.scratch[0, 0]
    n = r + 2 * b.counts[LANDMARKS]
    for k in range(2):
        for i in range(r):
            D[i] = G[k, i]
        D[2] += D[0] * b.heading_lever[0] + D[1] * b.heading_lever[1]
        for j in range(n):
            P[j, n + k] = 0.0
            for i in range(r):
                P[j, n + k] += D[i] * P[i, j]  # C.17, Gx Pxx and Gx Pxm
        for m in range(k + 1):
            total = (noise[k, m] + noise[m, k]) / 2
            for i in range(r):
                total += D[i] * P[i, n + m]
            P[n + m, n + k] = total  # C.17, Gx Pxx Gx^T + Gz R Gz^T
            b.blocks[b.counts[LANDMARKS], k + m] = total
        b.state[n + k], b.heading_lever[n + k] = xy[k], 0.0
        for i in range(len(b.downdates)):
            b.downdates[i, n + k] = b.updates[i, n + k] = 0.0
    _invalidate_cache(b)
    b.cached_pair[b.counts[LANDMARKS]] = -1
    b.counts[LANDMARKS] += 1


@kernel()
def is_full(b: FilterState) -> bool:
    """Whether there is no room for another step and another landmark."""
    full = len(b.downdates) - b.counts[DOWNDATES] < 3 or b.counts[UPDATES] == len(b.updates)
    return bool(full or b.counts[LANDMARKS] == len(b.blocks))
