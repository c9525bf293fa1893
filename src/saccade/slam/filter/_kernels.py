"""EKF prediction, update and augmentation, in place on a `FilterState`.

What is stored of the covariance is that of the errors

    eta = e - a e_theta,    a = J (s - f) for the robot's position and every landmark, else 0,

e the errors along the axes of the map, J a quarter turn, s the state, and f the first estimate
of each point: of a landmark when it was augmented, of the robot after its last motion; a is
called the heading lever. In these errors an update of the invariant filter needs no change of
coordinates of the covariance, the observation Jacobian depends on f alone, and a motion changes
the landmarks' covariance by the noise of the heading only. In the standard filter a is zero.

No kernel runs out of room: `state.with_capacity` is called before a scan.
"""

from math import sin, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._state_kernels import INVARIANT, STANDARD, FilterState, num_rows
from saccade.types import FloatArray


@kernel(fastmath=("contract",))
def _scale_and_add(row: FloatArray, keep: float, factor: float, other: FloatArray) -> None:
    """Set row = keep row + factor other."""
    for j in range(len(row)):
        row[j] = keep * row[j] + factor * other[j]


@kernel(fastmath=("contract",))
def _add_two_rows(row: FloatArray, a: float, x: FloatArray, b: float, y: FloatArray) -> None:
    """Add a x + b y to row."""
    for j in range(len(row)):
        row[j] += a * x[j] + b * y[j]


@kernel(fastmath=("contract",))
def _add_eight_rows(
    row: FloatArray, w: FloatArray, rows: FloatArray, i: int, r: int, n: int
) -> None:
    """Add w (8,) rows[i : i + 8] from r to n to row."""
    a, b, c, d, e, f, g, h = w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7]
    s, t, u, v = rows[i, r:n], rows[i + 1, r:n], rows[i + 2, r:n], rows[i + 3, r:n]
    x, y, p, q = rows[i + 4, r:n], rows[i + 5, r:n], rows[i + 6, r:n], rows[i + 7, r:n]
    for j in range(len(row)):
        one = (a * s[j] + b * t[j]) + (c * u[j] + d * v[j])
        row[j] += one + ((e * x[j] + f * y[j]) + (g * p[j] + h * q[j]))


@kernel()
def _add_product(
    V: FloatArray, D: FloatArray, r: int, m: int, sign: float, Y: FloatArray, used: int, n: int
) -> None:
    """Add the product of D and sign Y^T Y, of the first `used` rows of Y, to V (2, n)."""
    w = np.empty((2, used))
    for k in range(2):
        for i in range(used):
            w[k, i] = sign * (D[k, r] * Y[i, m] + D[k, r + 1] * Y[i, m + 1])
    x, y, eights = V[0, r:n], V[1, r:n], used // 8 * 8
    for i in range(0, eights, 8):
        _add_eight_rows(x, w[0, i : i + 8], Y, i, r, n)
        _add_eight_rows(y, w[1, i : i + 8], Y, i, r, n)
    for i in range(eights, used - 1, 2):
        _add_two_rows(x, w[0, i], Y[i, r:n], w[0, i + 1], Y[i + 1, r:n])
        _add_two_rows(y, w[1, i], Y[i, r:n], w[1, i + 1], Y[i + 1, r:n])
    if used % 2 == 1:
        _scale_and_add(x, 1.0, w[0, used - 1], Y[used - 1, r:n])
        _scale_and_add(y, 1.0, w[1, used - 1], Y[used - 1, r:n])


SINGULAR = 1e-13
"""An innovation variance below this fraction of the terms that it is the sum of counts as zero."""
ROUNDING = 1e-9
"""Fraction of a variance by which rounding may make an update subtract more than all of it."""
TINY = 1e-100
"""Square meters or radians; variances below it are zero."""


@kernel()
def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return angle if -np.pi < angle <= np.pi else np.pi - (np.pi - angle) % (2 * np.pi)


@kernel()
def _squared_norm(x: float, y: float) -> float:
    """x^2 + y^2; Numba compiles `x ** 2` with the flags of whichever kernel comes first."""
    return x * x + y * y


@kernel()
def _sandwich(
    A: FloatArray, C: FloatArray, noise: FloatArray, scale: float, out: FloatArray, n: int, m: int
) -> None:
    """Fill out (n, n) = A C A^T + scale noise, C and noise symmetric; A's shape is (n, m)."""
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
def predict(f: FilterState, moved: FloatArray, F: FloatArray, Q: FloatArray) -> None:
    """Move the robot to `moved` (r,) with Jacobian F (r, r) and noise Q (r, r) (C.5-C.6)."""
    r, n, now = f.robot_size, num_rows(f), f.now
    P, old, a, state = f.P, f.robot_rows, f.heading_lever, f.state
    G, Pxx, covariance = np.empty((r, r)), np.empty((r, r)), np.zeros(r)
    now.lowest_heading_variance = min(now.lowest_heading_variance, now.heading_variance)
    for i in range(r):
        for k in range(r):
            G[i, k], Pxx[i, k] = F[i, k], P[i, k]
        G[i, 2] += F[i, 0] * a[0] + F[i, 1] * a[1]  # by eta
    if f.error_state == INVARIANT:  # covariance of the moved robot with the turn's error
        before, turn = 0.0, np.empty(r)
        for k in range(r):
            turn[k] = G[2, k] - (1.0 if k == 2 else 0.0)
        for k in range(r):
            with_turn = 0.0
            for i in range(r):
                with_turn += Pxx[k, i] * turn[i]
            before += with_turn if k == 2 else 0.0
            for i in range(r):
                covariance[i] += G[i, k] * with_turn
        for i in range(r):
            covariance[i] += Q[i, 2]
        _add_heading_noise(f, turn, covariance[2] - before)
    _sandwich(G, Pxx, Q, 1.0, P, r, r)  # C.6, Pxx
    for i in range(r):
        _scale_and_add(old[i, r:n], 0.0, 1.0, P[i, r:n])
    for i in range(r):
        row = P[i, r:n]
        if f.error_state == INVARIANT:
            _scale_and_add(row, G[i, i], -covariance[i], a[r:n])
        elif G[i, i] != 1:
            _scale_and_add(row, G[i, i], 0.0, row)
        for k in range(r):
            if k != i and G[i, k] != 0:
                _scale_and_add(row, 1.0, G[i, k], old[k, r:n])  # C.6, Pxm
        state[i] = moved[i]  # C.5
    a[0] = a[1] = 0.0


@kernel(fastmath=("contract",))
def _add_heading_noise(f: FilterState, turn: FloatArray, variance: float) -> None:
    """Change the landmarks' eta by -a e, e the error of a turn with this variance.

    It is turn . eta of the robot before the motion, plus noise.
    """
    if variance <= 0:
        return
    r, n, now, P, updates = f.robot_size, num_rows(f), f.now, f.P, f.updates
    a = f.heading_lever[r:n]
    y, x = updates[now.updates, r:n], f.downdates[now.downdates, r:n]
    root, coupled = sqrt(variance), False
    _scale_and_add(y, 0.0, root, a)
    for k in range(r):
        if turn[k] != 0:
            _scale_and_add(x, 1.0 if coupled else 0.0, turn[k] / root, P[k, r:n])
            coupled = True
    if coupled:
        _scale_and_add(y, 1.0, -1.0, x)
        _add_to_blocks(f, x, -1.0)
        now.downdates += 1
        now.mergeable_variance = 0.0
    _add_to_blocks(f, y, 1.0)
    if now.mergeable_variance > 0:
        last = updates[now.updates - 1, r:n]
        _scale_and_add(last, sqrt(1 + variance / now.mergeable_variance), 0.0, a)
    else:
        now.updates += 1
    now.mergeable_variance += 0.0 if coupled else variance


@kernel(fastmath=("contract",))
def _add_to_blocks(f: FilterState, y: FloatArray, sign: float) -> None:
    """Add sign y^T y, y (2N,), to the diagonal blocks of the landmarks."""
    blocks, xy = f.blocks, y.reshape((len(y) // 2, 2))
    for i in range(f.now.landmarks):
        first, second = xy[i, 0], xy[i, 1]
        blocks[i, 0] += sign * first * first
        blocks[i, 1] += sign * first * second
        blocks[i, 2] += sign * second * second


@kernel()
def update(
    f: FilterState, m: int, v: FloatArray, H: FloatArray, noise: FloatArray, S: FloatArray
) -> float:
    """Update by an innovation v (2,) of the landmark at row m; returns the NIS and fills S.

    With A the inverse root of S and V = A H P, the gain W = P H^T S^-1 (C.13) is V^T A: W v is V^T
    (A v), and W S W^T is V^T V.

    Where the root of the NIS exceeds `huber`, the noise is multiplied by their ratio.
    H (2, r + 2) is by eta of the robot and the landmark, `noise` (2, 2) the covariance of the
    observation. Only the columns of these two take part in the gain (C.10-C.13).
    """
    r, n, P, now = f.robot_size, num_rows(f), f.P, f.now
    D, A = np.empty((2, r + 2)), np.empty((2, 2))
    _whiten(f, m, H, noise, 1.0, S, D, A)  # C.12
    first, second = A[0, 0] * v[0] + A[0, 1] * v[1], A[1, 0] * v[0] + A[1, 1] * v[1]
    nis = first * first + second * second
    if nis > f.huber * f.huber:
        _whiten(f, m, H, noise, sqrt(nis) / f.huber, np.empty((2, 2)), D, A)
        first, second = A[0, 0] * v[0] + A[0, 1] * v[1], A[1, 0] * v[0] + A[1, 1] * v[1]
    V = f.downdates[now.downdates : now.downdates + 2]
    _observed_rows(f, m, D, V)  # C.13
    for i in range(r):
        if _squared_norm(V[0, i], V[1, i]) > P[i, i] * (1 + ROUNDING):
            V[0, i] = V[1, i] = 0.0
    _downdate_blocks(f, V)  # C.11
    x, y = V[0, :n], V[1, :n]
    for i in range(r):
        _add_two_rows(P[i, :n], -V[0, i], x, -V[1, i], y)  # C.11: W S W^T = V^T V
    now.downdates += 2
    retract(f, first, second, V)  # C.10
    now.heading_variance = P[2, 2]
    return float(nis)


@kernel()
def _whiten(
    f: FilterState,
    m: int,
    H: FloatArray,
    noise: FloatArray,
    scale: float,
    S: FloatArray,
    D: FloatArray,
    A: FloatArray,
) -> None:
    """Fill S (C.12) of an observation as in `update`, its inverse root A (2, 2), and D = A H.

    A S A^T = 1 on the directions in which S has a variance. One that is much smaller than the
    terms that it is the sum of is rounding.
    """
    q = f.robot_size + 2
    C = np.empty((q, q))
    _joint_covariance(f, m, C)
    _sandwich(H, C, noise, scale, S, 2, q)
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
        ratio = S[i, j] / S[i, i]
        rest = S[j, j] - ratio * S[i, j]
        A[i, i] = 1 / sqrt(S[i, i])
        if rest > SINGULAR * sj + TINY:
            A[j, j] = 1 / sqrt(rest)
            A[j, i] = -ratio * A[j, j]
    for i in range(q):
        D[0, i] = A[0, 0] * H[0, i] + A[0, 1] * H[1, i]
        D[1, i] = A[1, 0] * H[0, i] + A[1, 1] * H[1, i]


@kernel()
def _joint_covariance(f: FilterState, m: int, C: FloatArray) -> None:
    """Fill the covariance (r + 2, r + 2) of eta of the robot and of the landmark at row m."""
    r, P, blocks = f.robot_size, f.P, f.blocks[(m - f.robot_size) // 2]
    for i in range(r):
        for j in range(r):
            C[i, j] = P[i, j]
        C[i, r] = C[r, i] = P[i, m]
        C[i, r + 1] = C[r + 1, i] = P[i, m + 1]
    C[r, r], C[r, r + 1], C[r + 1, r], C[r + 1, r + 1] = blocks[0], blocks[1], blocks[1], blocks[2]


@kernel(fastmath=("contract",))
def _observed_rows(f: FilterState, m: int, D: FloatArray, V: FloatArray) -> None:
    """Fill V (2, n) with the product of D (see `_whiten`) and the covariance of eta."""
    r, n, P = f.robot_size, num_rows(f), f.P
    base, cached = 2 * _cached_rows(f, m), f.cached_rows
    for k in range(2):
        v, first, second = V[k, :n], D[k, r], D[k, r + 1]
        _scale_and_add(v, 0.0, D[k, 0], P[0, :n])
        _add_two_rows(v, D[k, 1], P[1, :n], D[k, 2], P[2, :n])
        for i in range(3, r):
            if D[k, i] != 0:
                _scale_and_add(v, 1.0, D[k, i], P[i, :n])
        for i in range(r):
            v[i] += first * P[i, m] + second * P[i, m + 1]
        _add_two_rows(v[r:], first, cached[base, r:n], second, cached[base + 1, r:n])
    _add_product(V, D, r, m, -1.0, f.downdates, f.now.downdates, n)
    _add_product(V, D, r, m, 1.0, f.updates, f.now.updates, n)


@kernel()
def _cached_rows(f: FilterState, m: int) -> int:
    """Index of the pair of `FilterState.cached_rows` that holds rows m and m + 1 of P.

    Half of each is a column of the upper triangle, which is slow to read; a landmark in view is
    re-observed many times until the next flush.
    """
    r, n, i, P, pair = f.robot_size, num_rows(f), (m - f.robot_size) // 2, f.P, f.cached_pair
    if pair[i] < 0:
        first, second = f.cached_rows[2 * f.now.cached], f.cached_rows[2 * f.now.cached + 1]
        for j in range(r, m):
            first[j], second[j] = P[j, m], P[j, m + 1]
        first[m], first[m + 1] = P[m, m], P[m, m + 1]
        second[m], second[m + 1] = P[m, m + 1], P[m + 1, m + 1]
        _scale_and_add(first[m + 2 : n], 0.0, 1.0, P[m, m + 2 : n])
        _scale_and_add(second[m + 2 : n], 0.0, 1.0, P[m + 1, m + 2 : n])
        pair[i] = f.now.cached
        f.now.cached += 1
    return int(pair[i])


@kernel(fastmath=("contract",))
def _downdate_blocks(f: FilterState, V: FloatArray) -> None:
    """Subtract V^T V, V (2, n), from the landmarks' diagonal blocks, keeping variances positive."""
    r, blocks = f.robot_size, f.blocks
    n = r + 2 * f.now.landmarks
    x, y = V[0, r:n].reshape((n - r) // 2, 2), V[1, r:n].reshape((n - r) // 2, 2)
    for i in range(len(x)):
        if _squared_norm(x[i, 0], y[i, 0]) > blocks[i, 0] * (1 + ROUNDING):
            x[i, 0] = y[i, 0] = 0.0
        if _squared_norm(x[i, 1], y[i, 1]) > blocks[i, 2] * (1 + ROUNDING):
            x[i, 1] = y[i, 1] = 0.0
        blocks[i, 0] -= _squared_norm(x[i, 0], y[i, 0])
        blocks[i, 1] -= x[i, 0] * x[i, 1] + y[i, 0] * y[i, 1]
        blocks[i, 2] -= _squared_norm(x[i, 1], y[i, 1])


@kernel(fastmath=("contract",))
def retract(f: FilterState, first: float, second: float, V: FloatArray) -> None:
    """Correct the state by the errors first V[0] + second V[1] of eta (C.10).

    The invariant filter corrects by the exponential of SE(2).
    """
    s, a, r, n = f.state, f.heading_lever, f.robot_size, num_rows(f)
    sine, versine, p, q = 0.0, 0.0, 1.0, 0.0
    turn = first * V[0, 2] + second * V[1, 2]
    if f.error_state == INVARIANT and turn != 0:
        sine, versine = sin(turn), 2 * sin(turn / 2) ** 2
        p, q = sine / turn, versine / turn
    for i in range(2, r):
        s[i] += first * V[0, i] + second * V[1, i]
    s[2] = wrapped(s[2])
    by, fixed_lever = (first, second, p, q, sine, versine), f.error_state == STANDARD
    _retract_points(s[:2], a[:2], V[0, :2], V[1, :2], by, fixed_lever)
    _retract_points(s[r:n], a[r:n], V[0, r:n], V[1, r:n], by, fixed_lever)
    f.now.mergeable_variance = 0.0


@kernel(fastmath=("contract",))
def _retract_points(
    s: FloatArray,
    a: FloatArray,
    v: FloatArray,
    w: FloatArray,
    by: tuple[float, ...],
    fixed_lever: bool,
) -> None:
    """Correct points s (2 k,) and their heading levers by rows v and w of V, see `retract`."""
    first, second, p, q, sine, versine = by
    shape = (len(s) // 2, 2)
    points, lever, x0, x1 = s.reshape(shape), a.reshape(shape), v.reshape(shape), w.reshape(shape)
    for i in range(len(points)):
        e, f = first * x0[i, 0] + second * x1[i, 0], first * x0[i, 1] + second * x1[i, 1]
        x = p * e - q * f + sine * lever[i, 0] - versine * lever[i, 1]
        y = q * e + p * f + versine * lever[i, 0] + sine * lever[i, 1]
        points[i, 0] += x
        points[i, 1] += y
        if not fixed_lever:
            lever[i, 0] -= y
            lever[i, 1] += x


@kernel(fastmath=("contract",))
def augment(f: FilterState, xy: FloatArray, Gx: FloatArray, noise: FloatArray) -> None:
    """Add a landmark at xy (2,), with Jacobian Gx (2, r) by the robot and noise (C.16-C.17)."""
    r, P, D, a, now = f.robot_size, f.P, np.empty(f.robot_size), f.heading_lever, f.now
    state, blocks, downdates, updates, pair = (
        f.state,
        f.blocks,
        f.downdates,
        f.updates,
        f.cached_pair,
    )
    N = now.landmarks
    n = r + 2 * N
    for k in range(2):
        for i in range(r):
            D[i] = Gx[k, i]
        D[2] += D[0] * a[0] + D[1] * a[1]
        for j in range(n):
            P[j, n + k] = 0.0
            for i in range(r):
                P[j, n + k] += D[i] * P[i, j]  # C.17, Gx Pxx and Gx Pxm
        for j in range(len(state) - 2 * f.auxiliary, len(state)):
            P[n + k, j] = 0.0
            for i in range(r):
                P[n + k, j] += D[i] * P[i, j]
        for m in range(k + 1):
            total = (noise[k, m] + noise[m, k]) / 2
            for i in range(r):
                total += D[i] * P[i, n + m]
            P[n + m, n + k] = total  # C.17, Gx Pxx Gx^T + Gz R Gz^T
            blocks[N, k + m] = total
        state[n + k], a[n + k] = xy[k], 0.0
        for i in range(len(downdates)):
            downdates[i, n + k] = updates[i, n + k] = 0.0
    for i in range(N + 1):
        pair[i] = -1
    now.cached = 0
    now.heading_variance = P[2, 2]
    f.ids[N] = now.next_id
    now.next_id += 1
    now.landmarks = N + 1
