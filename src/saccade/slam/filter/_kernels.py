"""EKF prediction and update (C.5-C.14), in place on a `FilterState`.

The stored covariance is of the errors

    eta = e - a e_theta,    a = J (s - f) for the robot's position and every landmark, else 0,

e the errors along the axes of the map, J a quarter turn, s the state, and f the first estimate
of each point: of a landmark when it was augmented, of the robot after its last motion. The vector a
is called the heading lever. In these errors an update of the invariant filter needs no change of
coordinates of the covariance, the observation Jacobian depends on f alone, and a motion changes
the landmarks' covariance by the noise of the heading only. In the standard filter a is zero.

A common scale of odometry, ranges and map is unobservable, too. In the invariant filter, errors of
the two scale factors are relative, see `is_relative`, and their Jacobians are those at f: then the
direction of a common scale, f for the points, 1 for the odometry and -1 for the ranges, is the same
at every step, and no observation appears to measure it.

No kernel runs out of room: `state.with_capacity` is called before.
"""

from math import atan2, cos, exp, expm1, hypot, sin, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._row_kernels import _add_two_rows, _multiply_covariance, _scale_and_add
from saccade.slam.filter._state_kernels import INVARIANT, FilterState, num_rows
from saccade.types import FloatArray, IntArray

MIN_RANGE = 1e-6
"""Meters; a landmark closer than this to the robot has no bearing."""
SINGULAR = 1e-13
"""An innovation variance below this fraction of the terms that it is the sum of counts as zero."""
VARIANCE_ROUNDING = 1e-9
"""Fraction of a variance by which rounding may make an update subtract more than all of it."""
NEGLIGIBLE_VARIANCE = 1e-100
"""Square meters or radians; variances below it are zero."""


@kernel()
def wrapped(angle: float) -> float:
    """Angle wrapped to (-pi, pi]."""
    return angle if -np.pi < angle <= np.pi else np.pi - (np.pi - angle) % (2 * np.pi)


@kernel()
def _add_sandwich(A: FloatArray, C: FloatArray, out: FloatArray) -> None:
    """Add A C A^T to out (n, n), A of shape (n, m), C and out symmetric."""
    n, m = A.shape
    part = np.empty(m)  # C A^T, one column at a time
    for j in range(n):
        for k in range(m):
            part[k] = 0.0
            for o in range(m):
                part[k] += C[k, o] * A[j, o]
        for i in range(j, n):
            total = out[i, j]
            for k in range(m):
                total += A[i, k] * part[k]
            out[i, j] = out[j, i] = total


@kernel(fastmath=("contract",))
def predict(f: FilterState, u: FloatArray, U: FloatArray, D: FloatArray) -> None:
    """Predict the state after a relative pose u (3,) with covariance U (3, 3) (C.5-C.9).

    D (3, 3) is its Jacobian by the systematic errors of the odometry, if the robot's states have
    these.
    """
    r, n, P, a, now = f.robot_size, num_rows(f), f.P, f.heading_lever, f.now
    Fx, Fu = np.empty((r, r)), np.empty((r, 3))
    Pxx, new, turn = np.empty((r, r)), np.empty((r, r)), np.empty(r)
    _predict_pose(f, u, D, Fx, Fu)  # C.5, C.8, C.9
    for i in range(r):
        for k in range(r):
            Pxx[i, k], new[i, k] = P[i, k], 0.0
    _add_sandwich(Fu, U, new)  # C.7, Q
    now.lowest_heading_variance = min(now.lowest_heading_variance, now.heading_variance)
    if f.errors == INVARIANT:
        variance = new[2, 2]
        for i in range(r):  # covariance of the moved robot with the error of the turn
            turn[i] = new[i, 2]
        for k in range(r):
            biased = 0.0
            for j in range(3, r):
                biased += Pxx[k, j] * Fx[2, j]
            variance += Fx[2, k] * biased if k > 2 else 0.0
            for i in range(r):
                turn[i] += Fx[i, k] * biased
        _add_heading_noise(f, Fx[2], variance)
    _add_sandwich(Fx, Pxx, new)  # C.6, Pxx
    for i in range(r):
        row = P[i, r:n]
        if f.errors == INVARIANT:
            _scale_and_add(row, 1.0, -turn[i], a[r:n])
        for k in range(max(i + 1, 2), r):
            if Fx[i, k] != 0:
                _scale_and_add(row, 1.0, Fx[i, k], P[k, r:n])  # C.6, Pxm
        for k in range(r):
            P[i, k] = new[i, k]


@kernel()
def is_relative(f: FilterState, i: int) -> bool:
    """Whether the error of the robot's state in row i is relative: that of a scale, 1 + s."""
    return bool(f.errors == INVARIANT and i > 2 and (i == 3 or i == f.range_errors))


@kernel()
def fill_error_factors(f: FilterState, mean: FloatArray, factor: FloatArray) -> None:
    """Fill the factors (r,) that convert errors of the robot's states to errors of their scales.

    The states of a mean (n,) need not be those of f.
    """
    for i in range(len(factor)):
        factor[i] = 1 + mean[i] if is_relative(f, i) else 1.0


@kernel()
def _predict_pose(
    f: FilterState, u: FloatArray, D: FloatArray, Fx: FloatArray, Fu: FloatArray
) -> None:
    """Move the robot (C.5); fill Fx (r, r), by eta, and Fu (r, 3) (C.8, C.9)."""
    s, a, r = f.state, f.heading_lever, f.robot_size
    biased = f.range_errors if f.range_errors > 0 else r  # end of the odometry's errors
    real = np.empty(3)  # the relative pose without biases
    for j in range(3):
        real[j] = u[j]
        for k in range(3, biased):
            real[j] += D[j, k - 3] * s[k]
    cosine, sine = cos(s[2]), sin(s[2])
    dx, dy = cosine * real[0] - sine * real[1], sine * real[0] + cosine * real[1]
    for i in range(r):
        for j in range(3):
            Fu[i, j] = 0.0
        for k in range(r):
            Fx[i, k] = 1.0 if i == k else 0.0
    Fu[0, 0], Fu[1, 0], Fu[2, 2] = cosine, sine, 1.0
    Fu[0, 1], Fu[1, 1] = -sine, cosine
    Fx[0, 2], Fx[1, 2] = a[0] - dy, a[1] + dx
    for i in range(3):
        for k in range(3, biased):
            for j in range(3):
                Fx[i, k] += Fu[i, j] * D[j, k - 3]
        if biased > 3 and f.errors == INVARIANT:  # relative error of both lengths
            Fx[i, 3] = Fu[i, 0] * real[0] + Fu[i, 1] * real[1]
    s[0], s[1], s[2] = s[0] + dx, s[1] + dy, wrapped(s[2] + real[2])
    if f.range_errors > 0:  # the first estimate of the robot is the new one
        Fx[0, f.range_errors], Fx[1, f.range_errors] = -a[1], a[0]
    a[0] = a[1] = 0.0


@kernel(fastmath=("contract",))
def _add_heading_noise(f: FilterState, by_robot: FloatArray, variance: float) -> None:
    """Change the landmarks' eta by -a e, e the error of a turn with this variance.

    It is noise plus `by_robot` (r,) times the robot's eta beyond the pose, before the motion.
    """
    if variance <= 0:
        return
    r, n, now, P, updates = f.robot_size, num_rows(f), f.now, f.P, f.updates
    a = f.heading_lever[r:n]
    y, x = updates[now.updates, r:n], f.downdates[now.downdates, r:n]
    root, coupled = sqrt(variance), False
    _scale_and_add(y, 0.0, root, a)
    for k in range(3, r):
        if by_robot[k] != 0:
            _scale_and_add(x, 1.0 if coupled else 0.0, by_robot[k] / root, P[k, r:n])
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
    blocks = f.blocks
    for i in range(f.now.landmarks):
        first, second = y[2 * i], y[2 * i + 1]
        blocks[i, 0] += sign * first * first
        blocks[i, 1] += sign * first * second
        blocks[i, 2] += sign * second * second


@kernel()
def update(
    f: FilterState,
    z: FloatArray,
    R: FloatArray,
    landmark: IntArray,
    k: int,
    v: FloatArray,
    S: FloatArray,
    nis: FloatArray,
) -> int:
    """Update by observations z (n, 2) of landmarks at rows (n,), from the k-th on (C.10-C.14).

    Fills v (n, 2), S (n, 2, 2) and the normalized innovations squared (n,). A negative landmark
    leaves an observation out; returns the index of the first one that is not in the map, or n.
    """
    H, C, D, noise = np.empty((3, 7)), np.empty((7, 7)), np.empty((3, 3)), np.empty((2, 2))
    now = f.now
    while k < len(z) and landmark[k] < now.landmarks:
        if landmark[k] >= 0:
            m = f.robot_size + 2 * landmark[k]
            q = _expect(f, m, v[k], H, C, D)
            v[k, 0], v[k, 1] = z[k, 0] - v[k, 0], wrapped(z[k, 1] - v[k, 1])  # C.10
            for i in range(2):
                for j in range(2):
                    noise[i, j] = R[k, i, j]
            if f.errors == INVARIANT and q > MIN_RANGE:
                _add_second_order(q, D, v[k], noise)
            nis[k] = _update_landmark(f, m, v[k], H, C, D, noise, S[k])
            if S[k, 0, 0] > 0 and S[k, 1, 1] > 0:
                range_part = (noise[0, 0] - R[k, 0, 0]) / S[k, 0, 0]
                now.nonlinearity += max(range_part, (noise[1, 1] - R[k, 1, 1]) / S[k, 1, 1])
                now.nonlinear_updates += 1
        k += 1
    return k


@kernel()
def _update_landmark(
    f: FilterState,
    m: int,
    v: FloatArray,
    H: FloatArray,
    C: FloatArray,
    D: FloatArray,
    noise: FloatArray,
    S: FloatArray,
) -> float:
    """Update by an innovation v (2,) of the landmark at row m; returns the NIS and fills S.

    With A the inverse root of S and V = A H P, the gain W = P H^T S^-1 (C.13) is V^T A: W v is V^T
    (A v), and W S W^T is V^T V. Where the root of the NIS exceeds `huber`, the noise is multiplied
    by their ratio.
    """
    r, n, P, now = f.robot_size, num_rows(f), f.P, f.now
    A, B, x = np.empty((2, 2)), np.empty((2, 7)), np.empty(2)
    nis = _whiten(v, H, C, D, noise, 1.0, S, A, x)
    if nis > f.huber * f.huber:
        _whiten(v, H, C, D, noise, sqrt(nis) / f.huber, np.empty((2, 2)), A, x)
    for k in range(2):
        for i in range(7):
            B[k, i] = A[k, 0] * H[0, i] + A[k, 1] * H[1, i]
    V = f.downdates[now.downdates : now.downdates + 2]
    _multiply_covariance(f, m, B, V)  # C.13
    for i in range(r):
        if V[0, i] * V[0, i] + V[1, i] * V[1, i] > P[i, i] * (1 + VARIANCE_ROUNDING):
            V[0, i] = V[1, i] = 0.0
    _downdate_blocks(f, V)  # C.11, W S W^T = V^T V
    for i in range(r):
        _add_two_rows(P[i, :n], -V[0, i], V[0, :n], -V[1, i], V[1, :n])  # C.11
    now.downdates += 2
    retract(f, x[0], x[1], V)  # C.10, W v = V^T x
    now.heading_variance = P[2, 2]
    return float(nis)


@kernel()
def _expect(
    f: FilterState, m: int, z: FloatArray, H: FloatArray, C: FloatArray, D: FloatArray
) -> float:
    """Fill the expected observation z (2,) of the landmark at row m, and its Jacobian (C.14).

    H (3, 7) is of range, bearing and heading by eta of x, y, theta, the landmark, and the scale
    error and offset of the ranges; C (7, 7) is the covariance of these, and D = H C H^T. Returns
    the distance q, whose range is (1 + scale error) q + offset.
    """
    s, a, P, blocks = f.state, f.heading_lever, f.P, f.blocks[(m - f.robot_size) // 2]
    dx, dy, e = s[m] - s[0], s[m + 1] - s[1], f.range_errors
    q = hypot(dx, dy)
    scale, offset = (1 + s[e], s[e + 1]) if e > 0 else (1.0, 0.0)
    for i in range(7):
        for j in range(5, 7):
            C[i, j] = C[j, i] = 0.0
    for i in range(3):
        for j in range(7):
            H[i, j] = 0.0
        for j in range(3):
            C[i, j], D[i, j] = P[i, j], 0.0
        C[i, 3] = C[3, i] = P[i, m]
        C[i, 4] = C[4, i] = P[i, m + 1]
    C[3, 3], C[3, 4], C[4, 3], C[4, 4] = blocks[0], blocks[1], blocks[1], blocks[2]
    z[0], z[1], H[2, 2] = scale * q + offset, 0.0, 1.0
    if e > 0:
        H[0, 6] = 1.0
        for j in range(2):
            for i in range(3):
                C[i, 5 + j] = C[5 + j, i] = P[e + j, i]
            C[3, 5 + j] = C[5 + j, 3] = P[e + j, m]
            C[4, 5 + j] = C[5 + j, 4] = P[e + j, m + 1]
            for i in range(2):
                C[5 + i, 5 + j] = P[e + i, e + j]
    if q > MIN_RANGE:
        z[1] = wrapped(atan2(dy, dx) - s[2])
        H[0, 3], H[0, 4], H[1, 3], H[1, 4] = scale * dx / q, scale * dy / q, -dy / q**2, dx / q**2
        H[1, 2] = -1.0
        for i in range(2):
            H[i, 0], H[i, 1] = -H[i, 3], -H[i, 4]
            H[i, 2] += H[i, 3] * (a[m] - a[0]) + H[i, 4] * (a[m + 1] - a[1])  # by eta
        if e > 0 and f.errors == INVARIANT:
            for i in range(2):  # the landmark's first position relative to the robot's
                H[i, 5] = H[i, 3] * (dx - a[m + 1] + a[1]) + H[i, 4] * (dy + a[m] - a[0])
        elif e > 0:
            H[0, 5] = q
    _add_sandwich(H, C, D)
    return q


@kernel()
def _whiten(
    v: FloatArray,
    H: FloatArray,
    C: FloatArray,
    D: FloatArray,
    noise: FloatArray,
    scale: float,
    S: FloatArray,
    A: FloatArray,
    x: FloatArray,
) -> float:
    """Fill S (C.12), its inverse root A (2, 2), and x = A v (2,); returns the NIS.

    A S A^T = 1 on the directions in which S has a variance. One that is much smaller than the
    terms that it is the sum of is rounding.
    """
    s0, s1 = 0.0, 0.0
    for i in range(7):
        deviation = sqrt(abs(C[i, i]))
        s0 += abs(H[0, i]) * deviation
        s1 += abs(H[1, i]) * deviation
    s0, s1 = s0 * s0 + scale * noise[0, 0], s1 * s1 + scale * noise[1, 1]
    for i in range(2):
        for j in range(2):
            S[i, j], A[i, j] = D[i, j] + scale * noise[i, j], 0.0
    i = 0 if S[0, 0] * s1 >= S[1, 1] * s0 else 1
    j, si, sj = 1 - i, s0 if i == 0 else s1, s1 if i == 0 else s0
    if S[i, i] > SINGULAR * si + NEGLIGIBLE_VARIANCE:
        ratio = S[i, j] / S[i, i]
        rest = S[j, j] - ratio * S[i, j]
        A[i, i] = 1 / sqrt(S[i, i])
        if rest > SINGULAR * sj + NEGLIGIBLE_VARIANCE:
            A[j, j] = 1 / sqrt(rest)
            A[j, i] = -ratio * A[j, j]
    x[0], x[1] = A[0, 0] * v[0] + A[0, 1] * v[1], A[1, 0] * v[0] + A[1, 1] * v[1]
    return float(x[0] * x[0] + x[1] * x[1])


@kernel()
def _add_second_order(q: float, D: FloatArray, v: FloatArray, noise: FloatArray) -> None:
    """Subtract the mean of the second-order terms from v (2,), and add their covariance to noise.

    D (3, 3) is the covariance of three errors: along, of the landmark's distance q; x, of the
    bearing; and turn, of the heading. The error of the landmark's direction in the map is
    y = x + turn. The terms are q x y / 2 of the range and -along (x + y) / 2q of the bearing
    (Jazwinski 1970, Gaussian second-order filter).
    """
    along, along_x, along_y = D[0, 0], D[1, 0], D[1, 0] + D[2, 0]
    xx, xy = D[1, 1], D[1, 1] + D[2, 1]
    yy = xy + D[2, 1] + D[2, 2]
    along_mean, mean = (along_x + along_y) / 2, (xx + 2 * xy + yy) / 4
    x_mean, y_mean = (xx + xy) / 2, (xy + yy) / 2
    v[0] -= q * xy / 2
    v[1] = wrapped(v[1] + along_mean / q)
    noise[0, 0] += q * q * (xx * yy + xy * xy) / 4
    noise[1, 1] += (along * mean + along_mean * along_mean) / (q * q)
    both = (along_x * y_mean + along_y * x_mean) / 2
    noise[0, 1] -= both
    noise[1, 0] -= both


@kernel(fastmath=("contract",))
def _downdate_blocks(f: FilterState, V: FloatArray) -> None:
    """Subtract V^T V, V (2, n), from the landmarks' diagonal blocks, keeping variances positive."""
    r, blocks, x, y = f.robot_size, f.blocks, V[0], V[1]
    for i in range(f.now.landmarks):
        m = r + 2 * i
        if x[m] * x[m] + y[m] * y[m] > blocks[i, 0] * (1 + VARIANCE_ROUNDING):
            x[m] = y[m] = 0.0
        if x[m + 1] * x[m + 1] + y[m + 1] * y[m + 1] > blocks[i, 2] * (1 + VARIANCE_ROUNDING):
            x[m + 1] = y[m + 1] = 0.0
        blocks[i, 0] -= x[m] * x[m] + y[m] * y[m]
        blocks[i, 1] -= x[m] * x[m + 1] + y[m] * y[m + 1]
        blocks[i, 2] -= x[m + 1] * x[m + 1] + y[m + 1] * y[m + 1]


@kernel()
def _similarity(growth: float, turn: float) -> tuple[float, float, float, float]:
    """Parts of (exp(w) - 1) / w and of exp(w) - 1, w = growth + i turn."""
    along = expm1(growth) * cos(turn) - 2 * sin(turn / 2) ** 2
    across, square = exp(growth) * sin(turn), growth * growth + turn * turn
    if square == 0:
        return 1.0, 0.0, along, across
    p = (along * growth + across * turn) / square
    return p, (across * growth - along * turn) / square, along, across


@kernel(fastmath=("contract",))
def retract(f: FilterState, first: float, second: float, V: FloatArray) -> None:
    """Correct the state by the errors first V[0] + second V[1] of eta (C.10).

    The invariant filter corrects by the exponential of SE(2), or of Sim(2) where the ranges have a
    scale error, which moves heading levers as well.
    """
    s, a, r, n, e = f.state, f.heading_lever, f.robot_size, num_rows(f), f.range_errors
    invariant = 1.0 if f.errors == INVARIANT else 0.0
    turn = first * V[0, 2] + second * V[1, 2]
    growth = -first * V[0, e] - second * V[1, e] if e > 0 else 0.0
    p, q, along, across = _similarity(invariant * growth, invariant * turn)
    for i in range(2, r):
        d = first * V[0, i] + second * V[1, i]
        if is_relative(f, i):
            s[i] = (1 + s[i]) * exp(d) - 1
        else:
            s[i] += d
    s[2] = wrapped(s[2])
    for start, end in ((0, 2), (r, n)):
        for i in range(start, end, 2):
            d = first * V[0, i] + second * V[1, i]
            o = first * V[0, i + 1] + second * V[1, i + 1]
            x = p * d - q * o + along * a[i + 1] + across * a[i]
            y = q * d + p * o - along * a[i] + across * a[i + 1]
            s[i] += x
            s[i + 1] += y
            a[i] -= invariant * y
            a[i + 1] += invariant * x
    f.now.mergeable_variance = 0.0


@kernel()
def expected_observations(f: FilterState, landmark: IntArray, z: FloatArray, S: FloatArray) -> None:
    """Fill range and bearing z (c, 2) of landmarks (c,), and S = H P H^T (c, 2, 2)."""
    H, C, D = np.empty((3, 7)), np.empty((7, 7)), np.empty((3, 3))
    for i in range(len(landmark)):
        _expect(f, f.robot_size + 2 * landmark[i], z[i], H, C, D)
        for j in range(2):
            S[i, j, 0], S[i, j, 1] = D[j, 0], D[j, 1]


@kernel()
def expected_observation(
    f: FilterState, landmark: int, z: FloatArray, S: FloatArray, variance: FloatArray
) -> None:
    """Fill range and bearing z (2,) of a landmark, S = H P H^T (2, 2), and `variance` (2,).

    These are the variances of range and bearing if the systematic errors of the ranges were known.
    """
    H, C, D = np.empty((3, 7)), np.empty((7, 7)), np.empty((3, 3))
    _expect(f, f.robot_size + 2 * landmark, z, H, C, D)
    determinant = C[5, 5] * C[6, 6] - C[5, 6] ** 2
    for i in range(2):
        S[i, 0], S[i, 1] = D[i, 0], D[i, 1]
        variance[i], scale, offset = D[i, i], 0.0, 0.0
        if determinant > 0:
            for j in range(7):
                scale += H[i, j] * C[j, 5]
                offset += H[i, j] * C[j, 6]
            explained = scale * scale * C[6, 6] - 2 * scale * offset * C[5, 6]
            explained += offset * offset * C[5, 5]
            variance[i] = max(variance[i] - explained / determinant, 0.0)


@kernel()
def write_pose(f: FilterState, pose: FloatArray, covariance: FloatArray) -> None:
    """Fill the pose (3,) and its covariance (3, 3), of e."""
    s, a, P = f.state, f.heading_lever, f.P
    for i in range(3):
        pose[i] = s[i]
        for j in range(3):
            ai, aj = a[i] if i < 2 else 0.0, a[j] if j < 2 else 0.0
            covariance[i, j] = P[i, j] + ai * P[2, j] + aj * P[i, 2] + ai * aj * P[2, 2]
