"""The arithmetic of the filter on plain arrays: each step changes the `Belief` it is given.

What is stored of the covariance is that of the errors

    eta = e - a e_theta,    a = J (s - f) for the robot's place and every landmark, 0 for all else,

e the errors along the axes of the map, J a quarter turn, s the state, and f where each
point was believed to be first: a landmark when it was augmented, the robot when it last
moved. In these errors a correction of the invariant filter carries no covariance along, an
observation depends on f alone, and moving the robot leaves the landmarks but for the
noise of its heading. The other filters have eta = e; the standard one's a is zero, that
of first estimates says at which f the slopes are to be taken.
"""

from math import atan2, cos, hypot, sin, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.slam.belief import GIVEN, INVARIANT, LANDMARKS, STANDARD, TAKEN, Belief
from saccade.slam.models import NEAREST
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
def _times(A: FloatArray, x: FloatArray) -> FloatArray:
    """A x, small: BLAS costs more than the arithmetic."""
    y = np.zeros(len(A))
    for i in range(len(A)):
        for j in range(len(x)):
            y[i] += A[i, j] * x[j]
    return y


@kernel()
def sandwich(A: FloatArray, C: FloatArray, noise: FloatArray) -> FloatArray:
    """A C A^T + noise, C and the noise symmetric and small."""
    out = np.empty(noise.shape)
    for i in range(len(A)):
        for j in range(i + 1):
            total = noise[i, j]
            for k in range(len(C)):
                for m in range(len(C)):
                    total += A[i, k] * C[k, m] * A[j, m]
            out[i, j] = out[j, i] = total
    return out


@kernel(fastmath=("contract",))
def _mix(row: FloatArray, keep: float, factor: float, other: FloatArray) -> None:
    """Make row keep row + factor other."""
    for j in range(len(row)):
        row[j] = keep * row[j] + factor * other[j]


@kernel(fastmath=("contract",))
def predict(b: Belief, kind: int, moved: FloatArray, F: FloatArray, Q: FloatArray) -> None:
    """Move the robot to `moved` (r,), F (r, r) its slope, Q (r, r) its noise (C.5-C.7)."""
    r = len(moved)
    n = r + 2 * b.used[LANDMARKS]
    P, old, a = b.P, b.work, b.swing
    G = F.copy()  # by eta
    for i in range(r):
        G[i, 2] += F[i, 0] * a[0] + F[i, 1] * a[1]
    Pxx = P[:r, :r].copy()
    leak = np.zeros(r)  # covariance of the robot, once moved, with the error of the turn
    if kind == INVARIANT:
        turn = G[2].copy()
        turn[2] -= 1.0
        with_turn = _times(Pxx, turn)
        leak = _times(G, with_turn)
        for i in range(r):
            leak[i] += Q[i, 2]
        _swing_landmarks(b, turn, leak[2] - with_turn[2])
    Pxx = sandwich(G, Pxx, Q)  # C.7, Pxx
    for i in range(r):
        _mix(P[i, :r], 0.0, 1.0, Pxx[i])
        _mix(old[i, r:n], 0.0, 1.0, P[i, r:n])
    for i in range(r):
        _mix(P[i, r:n], 0.0, -leak[i], a[r:n])
        for k in range(r):
            if G[i, k] != 0:
                _mix(P[i, r:n], 1.0, G[i, k], old[k, r:n])  # C.7, Pxm
    _mix(b.state[:r], 0.0, 1.0, moved)  # C.5
    a[0] = a[1] = 0.0


@kernel(fastmath=("contract",))
def _swing_landmarks(b: Belief, turn: FloatArray, variance: float) -> None:
    """Change the landmarks' eta by -a e, e the error of a turn, `variance` in all.

    It is turn . eta of the robot before the step, and noise.
    """
    r = len(turn)
    n = r + 2 * b.used[LANDMARKS]
    a, y, x = b.swing[r:n], b.given[b.used[GIVEN], r:n], b.taken[b.used[TAKEN], r:n]
    if variance <= 0:
        return
    root, coupled = sqrt(variance), False
    _mix(y, 0.0, root, a)
    for k in range(r):
        if turn[k] != 0:
            _mix(x, 1.0 if coupled else 0.0, turn[k] / root, b.P[k, r:n])
            coupled = True
    if coupled:
        _mix(y, 1.0, -1.0, x)
        _add_own(b, x, -1.0)
        b.used[TAKEN] += 1
        b.fresh[0] = 0.0
    _add_own(b, y, 1.0)
    if b.fresh[0] > 0:
        _mix(b.given[b.used[GIVEN] - 1, r:n], sqrt(1 + variance / b.fresh[0]), 0.0, a)
    else:
        b.used[GIVEN] += 1
    b.fresh[0] += 0.0 if coupled else variance


@kernel(fastmath=("contract",))
def _add_own(b: Belief, y: FloatArray, sign: float) -> None:
    """Add sign y^T y, y (2N,), to the landmarks' own blocks."""
    for i in range(b.used[LANDMARKS]):
        first, second = y[2 * i], y[2 * i + 1]
        b.own[i, 0] += sign * first * first
        b.own[i, 1] += sign * first * second
        b.own[i, 2] += sign * second * second


@kernel(fastmath=("contract",))
def correct(
    b: Belief, kind: int, m: int, v: FloatArray, H: FloatArray, noise: FloatArray, huber: float
) -> tuple[float, FloatArray]:
    """Correct by an innovation v (2,) of the landmark at row m; gives v^T S^-1 v, and S.

    An innovation whose root of that is over `huber` has its noise as many times larger.
    H (2, r + 2) is by eta of the robot and the landmark, `noise` (2, 2) the covariance of the
    observation. Only their columns take part in the gain (C.10-C.13).
    """
    r = H.shape[1] - 2
    n = r + 2 * b.used[LANDMARKS]
    S, D, A = weigh(b, m, H, noise)
    nis = (_times(A, v) ** 2).sum()
    if nis > huber * huber:
        _, D, A = weigh(b, m, H, noise * (sqrt(nis) / huber))
    V, P, u = b.taken[b.used[TAKEN] : b.used[TAKEN] + 2], b.P, _times(A, v)
    _observed_rows(b, m, D, V)
    for i in range(r):
        if V[0, i] ** 2 + V[1, i] ** 2 > P[i, i] * (1 + ROUNDING):
            V[0, i] = V[1, i] = 0.0
    _take_own(b, V)
    for k in range(2):
        for i in range(r):
            _mix(P[i, :n], 1.0, -V[k, i], V[k, :n])  # C.13: W S W^T = V^T V
    b.used[TAKEN] += 2
    _retract(b, kind, r, u, V)
    return nis, S


@kernel()
def weigh(
    b: Belief, m: int, H: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """S (C.11) of an observation as in `correct`; A H; and A.

    A (2, 2) is the inverse root of S: A S A^T = 1 on the directions in which S has a
    variance. What rounding leaves of one that is much smaller than its terms is none.
    """
    r = H.shape[1] - 2
    C, own = np.empty((r + 2, r + 2)), b.own[(m - r) // 2]
    for i in range(r):
        for j in range(r + 2):
            C[i, j] = C[j, i] = b.P[i, j if j < r else m + j - r]
    C[r, r], C[r, r + 1], C[r + 1, r], C[r + 1, r + 1] = own[0], own[1], own[1], own[2]
    S, A, size, D = sandwich(H, C, noise), np.zeros((2, 2)), np.zeros(2), np.empty(H.shape)
    for k in range(2):
        for i in range(r + 2):
            size[k] += abs(H[k, i]) * sqrt(abs(C[i, i]))
        size[k] = size[k] ** 2 + noise[k, k]
    i, j = (0, 1) if S[0, 0] * size[1] >= S[1, 1] * size[0] else (1, 0)
    if S[i, i] > SINGULAR * size[i] + TINY:
        slope = S[i, j] / S[i, i]
        rest = S[j, j] - slope * S[i, j]
        A[i, i] = 1 / sqrt(S[i, i])
        if rest > SINGULAR * size[j] + TINY:
            A[j, j] = 1 / sqrt(rest)
            A[j, i] = -slope * A[j, j]
    for i in range(r + 2):
        D[0, i] = A[0, 0] * H[0, i] + A[0, 1] * H[1, i]
        D[1, i] = A[1, 0] * H[0, i] + A[1, 1] * H[1, i]
    return S, D, A


@kernel(fastmath=("contract",))
def _observed_rows(b: Belief, m: int, D: FloatArray, V: FloatArray) -> None:
    """Fill V (2, n) with D's product with the covariance of eta, D as `weigh` gives it."""
    r, P = D.shape[1] - 2, b.P
    n = r + 2 * b.used[LANDMARKS]
    for k in range(2):
        first, second, v = D[k, r], D[k, r + 1], V[k, :n]
        for j in range(m):
            v[j] = first * P[j, m] + second * P[j, m + 1]
        v[m] = first * P[m, m] + second * P[m, m + 1]
        left, right = P[m, m + 1 : n], P[m + 1, m + 1 : n]
        for j in range(n - m - 1):
            v[m + 1 + j] = first * left[j] + second * right[j]
        for i in range(r):
            _mix(v, 1.0, D[k, i], P[i, :n])
    for sign, rows, used in ((-1.0, b.taken, b.used[TAKEN]), (1.0, b.given, b.used[GIVEN])):
        for i in range(used):
            first, second = sign * rows[i, m], sign * rows[i, m + 1]
            for k in range(2):
                _mix(V[k, r:n], 1.0, D[k, r] * first + D[k, r + 1] * second, rows[i, r:n])


@kernel(fastmath=("contract",))
def _take_own(b: Belief, V: FloatArray) -> None:
    """Take V^T V, V (2, n), from the landmarks' own blocks, but no more than is there."""
    r = len(b.work)
    for i in range(b.used[LANDMARKS]):
        j = r + 2 * i
        if V[0, j] ** 2 + V[1, j] ** 2 > b.own[i, 0] * (1 + ROUNDING):
            V[0, j] = V[1, j] = 0.0
        if V[0, j + 1] ** 2 + V[1, j + 1] ** 2 > b.own[i, 2] * (1 + ROUNDING):
            V[0, j + 1] = V[1, j + 1] = 0.0
        b.own[i, 0] -= V[0, j] ** 2 + V[1, j] ** 2
        b.own[i, 1] -= V[0, j] * V[0, j + 1] + V[1, j] * V[1, j + 1]
        b.own[i, 2] -= V[0, j + 1] ** 2 + V[1, j + 1] ** 2


@kernel(fastmath=("contract",))
def _retract(b: Belief, kind: int, r: int, u: FloatArray, V: FloatArray) -> None:
    """Correct the state by u V, errors of eta (C.10); the invariant filter's by an exponential."""
    s, a = b.state, b.swing
    turn = u[0] * V[0, 2] + u[1] * V[1, 2]
    sine, lost, p, q = 0.0, 0.0, 1.0, 0.0
    if kind == INVARIANT and turn != 0:
        sine, lost = sin(turn), 2 * sin(turn / 2) ** 2
        p, q = sine / turn, lost / turn
    for i in range(2, r):
        s[i] += u[0] * V[0, i] + u[1] * V[1, i]
    s[2] = wrapped(s[2])
    for i in range(-1, b.used[LANDMARKS]):
        j = r + 2 * i if i >= 0 else 0
        e, f = u[0] * V[0, j] + u[1] * V[1, j], u[0] * V[0, j + 1] + u[1] * V[1, j + 1]
        x = p * e - q * f + sine * a[j] - lost * a[j + 1]
        y = q * e + p * f + lost * a[j] + sine * a[j + 1]
        s[j] += x
        s[j + 1] += y
        if kind != STANDARD:
            a[j] -= y
            a[j + 1] += x
    b.fresh[0] = 0.0


@kernel(fastmath=("contract",))
def augment(b: Belief, xy: FloatArray, G: FloatArray, noise: FloatArray) -> None:
    """Take in a landmark at xy (2,), its slope G (2, r) by the robot, and noise (C.15-C.18)."""
    r, P = G.shape[1], b.P
    n = r + 2 * b.used[LANDMARKS]
    for k in range(2):
        D = G[k].copy()
        D[2] += D[0] * b.swing[0] + D[1] * b.swing[1]
        for j in range(n):
            P[j, n + k] = 0.0
            for i in range(r):
                P[j, n + k] += D[i] * P[i, j]  # C.17, Gx Pxx and Gx Pxm
        for m in range(k + 1):
            total = (noise[k, m] + noise[m, k]) / 2
            for i in range(r):
                total += D[i] * P[i, n + m]
            P[n + m, n + k] = total  # C.17, Gx Pxx Gx^T + Gz R Gz^T
            b.own[b.used[LANDMARKS], k + m] = total
        b.state[n + k], b.swing[n + k] = xy[k], 0.0
        b.taken[:, n + k] = b.given[:, n + k] = 0.0
    b.used[LANDMARKS] += 1


@kernel()
def move(b: Belief, kind: int, u: FloatArray, U: FloatArray, D: FloatArray) -> None:
    """`predict` by `models.drive`, u (2,), or by `models.compose`, u (3,).

    D (c, r - 3) is the slope of the control by what the robot's state has behind the pose.
    """
    s, r = b.state, len(b.work)
    F, B = np.eye(r), np.zeros((r, len(u)))
    u = u + _times(D, s[3:r])
    angle = s[2] + u[1] if len(u) == 2 else s[2]
    B[0, 0], B[1, 0], B[2, len(u) - 1] = cos(angle), sin(angle), 1.0
    if len(u) == 3:
        B[0, 1], B[1, 1] = -B[1, 0], B[0, 0]
    step = _times(B, u)
    if len(u) == 2:
        B[0, 1], B[1, 1] = -step[1], step[0]
    F[0, 2], F[1, 2] = -step[1], step[0]
    for i in range(r - 3):
        F[:, 3 + i] += _times(B, D[:, i])
    moved = s[:r] + step
    moved[2] = wrapped(moved[2])
    predict(b, kind, moved, F, sandwich(B, U, np.zeros((r, r))))


@kernel()
def sight(
    b: Belief, kind: int, m: int, z: FloatArray, R: FloatArray, huber: float, v: FloatArray
) -> tuple[float, FloatArray]:
    """`correct` by range and bearing, as `retraction.linearize` has them; v (2,) is filled."""
    s, a, r, H = b.state, b.swing, len(b.work), np.zeros((2, len(b.work) + 2))
    dx, dy = s[m] - s[0], s[m + 1] - s[1]
    if kind != STANDARD:
        B = _at(s, z)
        v[0], v[1] = z[0] * B[0, 0] - dx, z[0] * B[1, 0] - dy
        H[0, 0], H[1, 1], H[0, r], H[1, r + 1] = -1.0, -1.0, 1.0, 1.0
        H[0, 2], H[1, 2] = dy + a[m] - a[0], a[m + 1] - a[1] - dx  # J (f_p - f_m)
        return correct(b, kind, m, v, H, sandwich(B, R, np.zeros((2, 2))), huber)
    q = hypot(dx, dy)
    if q > NEAREST:
        H[0, r], H[0, r + 1], H[1, r], H[1, r + 1] = dx / q, dy / q, -dy / q**2, dx / q**2
        H[:, :2] = -H[:, r:]
        H[1, 2] = -1.0
    v[0], v[1] = z[0] - q, wrapped(z[1] - (atan2(dy, dx) - s[2] if q > NEAREST else 0.0))
    return correct(b, kind, m, v, H, R, huber)


@kernel()
def toward(b: Belief, landmark: int) -> tuple[float, float]:
    """Range and bearing of a landmark (C.14), zero if it is where the robot is."""
    m = len(b.work) + 2 * landmark
    dx, dy = b.state[m] - b.state[0], b.state[m + 1] - b.state[1]
    q = hypot(dx, dy)
    return q, wrapped(atan2(dy, dx) - b.state[2]) if q > NEAREST else 0.0


@kernel()
def place(b: Belief, z: FloatArray, R: FloatArray, xy: FloatArray, C: FloatArray) -> None:
    """Fill the place (2,) of an observation by range and bearing, and Gz R Gz^T (2, 2)."""
    B = _at(b.state, z)
    xy[0], xy[1] = b.state[0] + z[0] * B[0, 0], b.state[1] + z[0] * B[1, 0]
    C[:] = sandwich(B, R, np.zeros((2, 2)))


@kernel()
def take_in(b: Belief, z: FloatArray, R: FloatArray) -> None:
    """`augment` by range and bearing (C.15-C.18)."""
    xy, C, G = np.empty(2), np.empty((2, 2)), np.eye(2, len(b.work))
    place(b, z, R, xy, C)
    G[0, 2], G[1, 2] = b.state[1] - xy[1], xy[0] - b.state[0]
    augment(b, xy, G, C)


@kernel()
def _at(s: FloatArray, z: FloatArray) -> FloatArray:
    """Slope (2, 2) of the place of an observation by z (C.16)."""
    c, d = cos(s[2] + z[1]), sin(s[2] + z[1])
    return np.array([[c, -z[0] * d], [d, z[0] * c]])


@kernel()
def is_full(b: Belief) -> bool:
    """Whether there is no room for another step and another landmark."""
    full = len(b.taken) - b.used[TAKEN] < 3 or b.used[GIVEN] == len(b.given)
    return bool(full or b.used[LANDMARKS] == len(b.own))


@kernel()
def pose_covariance(b: Belief, kind: int) -> FloatArray:
    """(3, 3) of e."""
    F = np.eye(3)
    if kind == INVARIANT:
        F[0, 2], F[1, 2] = b.swing[0], b.swing[1]
    return sandwich(F, b.P[:3, :3], np.zeros((3, 3)))
