"""EKF steps with the models of this package: `drive` and `compose`, range and bearing."""

from math import atan2, cos, hypot, sin
from typing import NamedTuple

from saccade._jit import kernel
from saccade.slam.filter._kernels import (
    _joint_covariance,
    _sandwich,
    augment,
    predict,
    update,
    wrapped,
)
from saccade.slam.filter._state_kernels import (
    INVARIANT,
    LANDMARKS,
    STANDARD,
    FilterState,
    Scratch,
    is_full,
)
from saccade.types import FloatArray, IntArray

MIN_RANGE = 1e-6
"""Metres; a landmark closer than this to the robot has no bearing."""


class Innovations(NamedTuple):
    """Innovations of k observations, NaN where one updated nothing; see `results.Innovation`."""

    value: FloatArray
    """(k, 2)."""
    covariance: FloatArray
    """(k, 2, 2)."""
    nis: FloatArray
    """(k,)."""


@kernel()
def predict_by_control(
    f: FilterState, w: Scratch, u: FloatArray, U: FloatArray, D: FloatArray
) -> None:
    """`predict` by `models.drive`, u (2,), or by `models.compose`, u (3,).

    D (c, r - 3) is the Jacobian of the control by the robot's states beyond the pose.
    """
    s, r, c = f.state, f.robot_size, len(u)
    Fx, Fu, Q = w.Fx, w.Fu, w.Q
    real, moved = w.control, w.pose
    for i in range(r):
        moved[i] = s[i]
        for k in range(r):
            Fx[i, k] = 0.0
        for k in range(3):
            Fu[i, k] = 0.0
        Fx[i, i] = 1.0
    for i in range(c):
        real[i] = u[i]
        for k in range(r - 3):
            real[i] += D[i, k] * s[3 + k]
    angle = s[2] + real[1] if c == 2 else s[2]
    cosine, sine = cos(angle), sin(angle)
    dx, dy = cosine * real[0], sine * real[0]
    Fu[0, 0], Fu[1, 0], Fu[2, c - 1] = cosine, sine, 1.0
    if c == 3:
        Fu[0, 1], Fu[1, 1] = -sine, cosine
        dx, dy = dx - sine * real[1], dy + cosine * real[1]
    else:
        Fu[0, 1], Fu[1, 1] = -dy, dx
    Fx[0, 2], Fx[1, 2] = -dy, dx
    for i in range(3):
        for k in range(r - 3):
            for j in range(c):
                Fx[i, 3 + k] += Fu[i, j] * D[j, k]
    moved[0], moved[1], moved[2] = s[0] + dx, s[1] + dy, wrapped(s[2] + real[c - 1])
    _sandwich(Fu, U, Fx, 0.0, Q, (r, c))
    predict(f, w, moved, Fx, Q)


@kernel()
def update_range_bearing(
    f: FilterState,
    w: Scratch,
    m: int,
    z: FloatArray,
    R: FloatArray,
    v: FloatArray,
    S: FloatArray,
) -> float:
    """`update` by range and bearing; fills v (2,) and S."""
    linearize_range_bearing(f, w, m, z, R, v)
    range_part, bearing_part = w.R[0, 0] - R[0, 0], w.R[1, 1] - R[1, 1]
    nis = update(f, w, m, v, w.H, w.R, S)
    if S[0, 0] > 0 and S[1, 1] > 0:
        part = max(range_part / S[0, 0], bearing_part / S[1, 1])
        f.nonlinearity[0] += part
        f.nonlinearity[1] += 1
    return nis


@kernel()
def linearize_range_bearing(
    f: FilterState, w: Scratch, m: int, z: FloatArray, R: FloatArray, v: FloatArray
) -> None:
    """Fill the innovation v (2,), its Jacobian w.H by eta and its noise w.R (C.14).

    The standard filter takes range and bearing to first order, the others to second order.
    """
    s, a, r, H, noise = f.state, f.heading_lever, f.robot_size, w.H, w.R
    for i in range(r + 2):
        H[0, i] = H[1, i] = 0.0
    for i in range(2):
        for j in range(2):
            noise[i, j] = R[i, j]
    dx, dy = s[m] - s[0], s[m + 1] - s[1]
    q = hypot(dx, dy)
    if q > MIN_RANGE:
        H[0, r], H[0, r + 1], H[1, r], H[1, r + 1] = dx / q, dy / q, -dy / q**2, dx / q**2
        for k in range(2):
            H[k, 0], H[k, 1] = -H[k, r], -H[k, r + 1]
        H[1, 2] = -1.0
    v[0], v[1] = z[0] - q, wrapped(z[1] - (atan2(dy, dx) - s[2] if q > MIN_RANGE else 0.0))
    if f.error_state != STANDARD and q > MIN_RANGE:
        for k in range(2):
            H[k, 2] += H[k, r] * (a[m] - a[0]) + H[k, r + 1] * (a[m + 1] - a[1])
        _add_second_order(f, w, m, q, v)


@kernel(inline=True)
def _add_second_order(f: FilterState, w: Scratch, m: int, q: float, v: FloatArray) -> None:
    """Subtract the mean of the second-order terms from v (2,), and add their covariance to w.R.

    With along the error of the landmark's distance q, x that of the bearing and turn that of the
    heading, y = x + turn is the error of the landmark's direction in the map. In the coordinates
    xi these terms are q x y / 2 of the range and -along (x + y) / 2q of the bearing; in those along
    the axes of the map y stands in the place of x (Jazwinski 1970, Gaussian second-order filter).
    """
    r, C, H, noise, D = f.robot_size, w.C, w.H, w.R, w.second_order
    _joint_covariance(f, m, C)
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for k in range(r + 2):
                row = C[2, k]
                if i < 2:
                    row = 0.0
                    for o in range(r + 2):
                        row += H[i, o] * C[o, k]
                total += row * (H[j, k] if j < 2 else (1.0 if k == 2 else 0.0))
            D[i, j] = total
    along, along_x, along_y = D[0, 0], D[1, 0], D[1, 0] + D[2, 0]
    xx, xy = D[1, 1], D[1, 1] + D[2, 1]
    yy = xy + D[2, 1] + D[2, 2]
    if f.error_state != INVARIANT:
        along_x, xx, xy = along_y, yy, yy
    along_mean, mean = (along_x + along_y) / 2, (xx + 2 * xy + yy) / 4
    x_mean, y_mean = (xx + xy) / 2, (xy + yy) / 2
    v[0] -= q * xy / 2
    v[1] = wrapped(v[1] + along_mean / q)
    noise[0, 0] += q * q * (xx * yy + xy * xy) / 4
    noise[1, 1] += (along * mean + along_mean * along_mean) / (q * q)
    both = (along_x * y_mean + along_y * x_mean) / 2
    noise[0, 1] -= both
    noise[1, 0] -= both


@kernel()
def update_scan(
    f: FilterState,
    w: Scratch,
    z: FloatArray,
    R: FloatArray,
    landmark: IntArray,
    k: int,
    end: int,
    out: Innovations,
) -> int:
    """Update by observations from k to `end`, as far as there is room; returns the next one.

    The next free number of a landmark augments, a negative one leaves the observation out.
    """
    while k < end and not is_full(f):
        if landmark[k] == f.counts[LANDMARKS]:
            augment_range_bearing(f, w, z[k], R[k])
        elif landmark[k] >= 0:
            m = f.robot_size + 2 * landmark[k]
            out.nis[k] = update_range_bearing(f, w, m, z[k], R[k], out.value[k], out.covariance[k])
        k += 1
    return k


@kernel(inline=True)
def expected_observation(f: FilterState, landmark: int) -> tuple[float, float]:
    """Range and bearing of a landmark (C.14); zero within `MIN_RANGE`."""
    m = f.robot_size + 2 * landmark
    dx, dy = f.state[m] - f.state[0], f.state[m + 1] - f.state[1]
    q = hypot(dx, dy)
    return q, wrapped(atan2(dy, dx) - f.state[2]) if q > MIN_RANGE else 0.0


@kernel()
def inverse_observe(
    f: FilterState, w: Scratch, z: FloatArray, R: FloatArray, xy: FloatArray, C: FloatArray
) -> None:
    """Fill the position (2,) of an observed point (C.15), and Gz R Gz^T (2, 2)."""
    Gz = w.Gz
    _inverse_jacobian(f.state, z, Gz)
    xy[0], xy[1] = f.state[0] + z[0] * Gz[0, 0], f.state[1] + z[0] * Gz[1, 0]
    _sandwich(Gz, R, R, 0.0, C, (len(xy), len(xy)))


@kernel()
def augment_range_bearing(f: FilterState, w: Scratch, z: FloatArray, R: FloatArray) -> None:
    """`augment` by range and bearing (C.15-C.18).

    The standard filter does so to first order, the others to second order: along the bearing n and
    across it, the terms are -z0 n^2 / 2 and d n, d the error of the range.
    """
    xy, noise, Gx, Gz = w.xy, w.R, w.Gx, w.Gz
    inverse_observe(f, w, z, R, xy, noise)
    if f.error_state != STANDARD:
        c, d, q, k = Gz[0, 0], Gz[1, 0], R[1, 1], R[0, 1]
        along, across = -z[0] * q / 2, k
        xy[0], xy[1] = xy[0] + c * along - d * across, xy[1] + d * along + c * across
        aa, ab, bb = z[0] * z[0] * q * q / 2, -z[0] * k * q, R[0, 0] * q + k * k
        noise[0, 0] += c * c * aa - 2 * c * d * ab + d * d * bb
        noise[1, 1] += d * d * aa + 2 * c * d * ab + c * c * bb
        noise[0, 1] += c * d * (aa - bb) + (c * c - d * d) * ab
        noise[1, 0] = noise[0, 1]
    for i in range(f.robot_size):
        Gx[0, i] = Gx[1, i] = 0.0
    Gx[0, 0] = Gx[1, 1] = 1.0
    Gx[0, 2], Gx[1, 2] = f.state[1] - xy[1], xy[0] - f.state[0]
    augment(f, w, xy, Gx, noise)


@kernel(inline=True)
def _inverse_jacobian(s: FloatArray, z: FloatArray, Gz: FloatArray) -> None:
    """Fill the Jacobian (2, 2) of an observed point's position by z (C.18)."""
    c, d = cos(s[2] + z[1]), sin(s[2] + z[1])
    Gz[0, 0], Gz[0, 1], Gz[1, 0], Gz[1, 1] = c, -z[0] * d, d, z[0] * c


@kernel()
def write_pose(f: FilterState, w: Scratch, pose: FloatArray, covariance: FloatArray) -> None:
    """Fill the pose (3,) and its covariance (3, 3), of e."""
    F = w.Fx
    for i in range(3):
        pose[i] = f.state[i]
        for k in range(3):
            F[i, k] = 1.0 if i == k else 0.0
    if f.error_state == INVARIANT:
        F[0, 2], F[1, 2] = f.heading_lever[0], f.heading_lever[1]
    _sandwich(F, f.P, F, 0.0, covariance, (len(pose), len(pose)))
