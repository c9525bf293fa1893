"""The steps of `_kernels` by the models of this package: `drive`, `compose`, range and bearing."""

from math import atan2, cos, hypot, sin

from saccade._jit import kernel
from saccade.slam.filter._kernels import augment, predict, sandwich, update, wrapped
from saccade.slam.filter.state import INVARIANT, STANDARD, FilterState
from saccade.slam.models import NEAREST
from saccade.types import FloatArray


@kernel()
def predict_by_control(
    b: FilterState, kind: int, u: FloatArray, U: FloatArray, D: FloatArray
) -> None:
    """`predict` by `models.drive`, u (2,), or by `models.compose`, u (3,).

    D (c, r - 3) is the slope of the control by what the robot's state has behind the pose.
    """
    s, r, c = b.state, len(b.workspace), len(u)
    F, B, Q, real, moved = (
        b.scratch[3],
        b.scratch[4],
        b.scratch[5],
        b.scratch[6, 0],
        b.scratch[6, 1],
    )
    for i in range(r):
        moved[i] = s[i]
        for k in range(r):
            F[i, k], B[i, k] = 0.0, 0.0
        F[i, i] = 1.0
    for i in range(c):
        real[i] = u[i]
        for k in range(r - 3):
            real[i] += D[i, k] * s[3 + k]
    angle = s[2] + real[1] if c == 2 else s[2]
    cosine, sine = cos(angle), sin(angle)
    dx, dy = cosine * real[0], sine * real[0]
    B[0, 0], B[1, 0], B[2, c - 1] = cosine, sine, 1.0
    if c == 3:
        B[0, 1], B[1, 1] = -sine, cosine
        dx, dy = dx - sine * real[1], dy + cosine * real[1]
    else:
        B[0, 1], B[1, 1] = -dy, dx
    F[0, 2], F[1, 2] = -dy, dx
    for i in range(3):
        for k in range(r - 3):
            for j in range(c):
                F[i, 3 + k] += B[i, j] * D[j, k]
    moved[0], moved[1], moved[2] = s[0] + dx, s[1] + dy, wrapped(s[2] + real[c - 1])
    sandwich(B, U, F, 0.0, Q, (r, c))
    predict(b, kind, moved, F, Q)


@kernel()
def update_range_bearing(
    b: FilterState,
    kind: int,
    m: int,
    z: FloatArray,
    R: FloatArray,
    huber: float,
    v: FloatArray,
    S: FloatArray,
) -> float:
    """`update` by range and bearing, as `error_state.linearize` has them; fills v (2,) and S."""
    s, a, r, H, noise = b.state, b.heading_lever, len(b.workspace), b.scratch[4], b.scratch[5]
    for i in range(r + 2):
        H[0, i] = H[1, i] = 0.0
    dx, dy = s[m] - s[0], s[m + 1] - s[1]
    if kind != STANDARD:
        _inverse_slope(s, z, b.scratch[6])
        B = b.scratch[6]
        v[0], v[1] = z[0] * B[0, 0] - dx, z[0] * B[1, 0] - dy
        H[0, 0], H[1, 1], H[0, r], H[1, r + 1] = -1.0, -1.0, 1.0, 1.0
        H[0, 2], H[1, 2] = dy + a[m] - a[0], a[m + 1] - a[1] - dx  # J (f_p - f_m)
        sandwich(B, R, R, 0.0, noise, (2, 2))
        return update(b, kind, m, v, H, noise, huber, S)
    q = hypot(dx, dy)
    if q > NEAREST:
        H[0, r], H[0, r + 1], H[1, r], H[1, r + 1] = dx / q, dy / q, -dy / q**2, dx / q**2
        for k in range(2):
            H[k, 0], H[k, 1] = -H[k, r], -H[k, r + 1]
        H[1, 2] = -1.0
    v[0], v[1] = z[0] - q, wrapped(z[1] - (atan2(dy, dx) - s[2] if q > NEAREST else 0.0))
    return update(b, kind, m, v, H, R, huber, S)


@kernel()
def expected_observation(b: FilterState, landmark: int) -> tuple[float, float]:
    """Range and bearing of a landmark (C.14), zero if it is where the robot is."""
    m = len(b.workspace) + 2 * landmark
    dx, dy = b.state[m] - b.state[0], b.state[m + 1] - b.state[1]
    q = hypot(dx, dy)
    return q, wrapped(atan2(dy, dx) - b.state[2]) if q > NEAREST else 0.0


@kernel()
def inverse_observe(
    b: FilterState, z: FloatArray, R: FloatArray, xy: FloatArray, C: FloatArray
) -> None:
    """Fill the place (2,) of an observation by range and bearing, and Gz R Gz^T (2, 2)."""
    B = b.scratch[6]
    _inverse_slope(b.state, z, B)
    xy[0], xy[1] = b.state[0] + z[0] * B[0, 0], b.state[1] + z[0] * B[1, 0]
    sandwich(B, R, R, 0.0, C, (2, 2))


@kernel()
def augment_range_bearing(b: FilterState, z: FloatArray, R: FloatArray) -> None:
    """`augment` by range and bearing (C.15-C.18)."""
    xy, C, G = b.scratch[3, 0], b.scratch[4], b.scratch[5]
    inverse_observe(b, z, R, xy, C)
    for i in range(len(b.workspace)):
        G[0, i] = G[1, i] = 0.0
    G[0, 0] = G[1, 1] = 1.0
    G[0, 2], G[1, 2] = b.state[1] - xy[1], xy[0] - b.state[0]
    augment(b, xy, G, C)


@kernel()
def _inverse_slope(s: FloatArray, z: FloatArray, B: FloatArray) -> None:
    """Fill the slope (2, 2) of the place of an observation by z (C.18)."""
    c, d = cos(s[2] + z[1]), sin(s[2] + z[1])
    B[0, 0], B[0, 1], B[1, 0], B[1, 1] = c, -z[0] * d, d, z[0] * c


@kernel()
def write_pose(b: FilterState, kind: int, pose: FloatArray, covariance: FloatArray) -> None:
    """Fill the pose (3,) and its covariance (3, 3), of e."""
    F = b.scratch[0]
    for i in range(3):
        pose[i] = b.state[i]
        for k in range(3):
            F[i, k] = 1.0 if i == k else 0.0
    if kind == INVARIANT:
        F[0, 2], F[1, 2] = b.heading_lever[0], b.heading_lever[1]
    sandwich(F, b.P, F, 0.0, covariance, (3, 3))
