"""EKF steps with the models of this package: its two of motion, and range and bearing."""

from math import atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._kernels import (
    _joint_covariance,
    _sandwich,
    augment,
    predict,
    update,
    wrapped,
)
from saccade.slam.filter._state_kernels import INVARIANT, FilterState
from saccade.types import FloatArray, IntArray

MIN_RANGE = 1e-6
"""Meters; a landmark closer than this to the robot has no bearing."""


class Innovations(NamedTuple):
    """Innovations of k observations, NaN where one updated nothing; see `results.Innovation`."""

    value: FloatArray
    """(k, 2)."""
    covariance: FloatArray
    """(k, 2, 2)."""
    nis: FloatArray
    """(k,)."""


@kernel()
def predict_by_control(f: FilterState, u: FloatArray, U: FloatArray, D: FloatArray) -> None:
    """`predict` by `models.turn_then_translate`, u (2,), or by `models.compose`, u (3,).

    D (c, r - 3) is the Jacobian of the control by the robot's states beyond the pose.
    """
    s, r, c = f.state, f.robot_size, len(u)
    Fx, Fu, Q = np.eye(r), np.zeros((r, 3)), np.empty((r, r))
    real, moved = np.empty(3), s[:r].copy()
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
    _sandwich(Fu, U, Fx, 0.0, Q, r, c)
    predict(f, moved, Fx, Q)


@kernel()
def update_scan(
    f: FilterState, z: FloatArray, R: FloatArray, landmark: IntArray, out: Innovations
) -> None:
    """Update by the observations (k,) of a scan, in their order (C.10-C.14).

    The next free number of a landmark augments, a negative one leaves the observation out.
    """
    H, noise = np.empty((2, f.robot_size + 2)), np.empty((2, 2))
    for k in range(len(z)):
        if landmark[k] == f.now.landmarks:
            augment_range_bearing(f, z[k], R[k])
        elif landmark[k] >= 0:
            m, v, S = f.robot_size + 2 * landmark[k], out.value[k], out.covariance[k]
            _linearize_range_bearing(f, m, z[k], R[k], v, H, noise)
            range_part, bearing_part = noise[0, 0] - R[k, 0, 0], noise[1, 1] - R[k, 1, 1]
            out.nis[k] = update(f, m, v, H, noise, S)
            if S[0, 0] > 0 and S[1, 1] > 0:
                f.now.nonlinearity += max(range_part / S[0, 0], bearing_part / S[1, 1])
                f.now.nonlinear_updates += 1


@kernel()
def _linearize_range_bearing(
    f: FilterState,
    m: int,
    z: FloatArray,
    R: FloatArray,
    v: FloatArray,
    H: FloatArray,
    noise: FloatArray,
) -> None:
    """Fill the innovation v (2,), its Jacobian H (2, r + 2) by eta and its noise (2, 2) (C.14).

    The standard filter takes range and bearing to first order, the invariant to second order.
    """
    s, a, r = f.state, f.heading_lever, f.robot_size
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
    if f.error_state == INVARIANT and q > MIN_RANGE:
        for k in range(2):
            H[k, 2] += H[k, r] * (a[m] - a[0]) + H[k, r + 1] * (a[m + 1] - a[1])
        _add_second_order(f, m, q, v, H, noise)


@kernel()
def _add_second_order(
    f: FilterState, m: int, q: float, v: FloatArray, H: FloatArray, noise: FloatArray
) -> None:
    """Subtract the mean of the second-order terms from v (2,), and add their covariance to noise.

    With along the error of the landmark's distance q, x that of the bearing and turn that of the
    heading, y = x + turn is the error of the landmark's direction in the map. These terms are
    q x y / 2 of the range and -along (x + y) / 2q of the bearing (Jazwinski 1970, Gaussian
    second-order filter).
    """
    r = f.robot_size
    C, D = np.empty((r + 2, r + 2)), np.zeros((3, 3))
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
def expected_observations(f: FilterState, landmark: IntArray, z: FloatArray, S: FloatArray) -> None:
    """Fill range and bearing z (c, 2) of landmarks (c,), and S = H P H^T (c, 2, 2)."""
    r, s, a, P, diagonal = f.robot_size, f.state, f.heading_lever, f.P, f.blocks
    D, W = np.zeros((2, 5)), np.zeros((2, 5))  # x, y, heading, landmark
    for i in range(len(landmark)):
        m, blocks = r + 2 * landmark[i], diagonal[landmark[i]]
        dx, dy = s[m] - s[0], s[m + 1] - s[1]
        q = hypot(dx, dy)
        for k in range(2):
            for p in range(5):
                D[k, p] = 0.0
        z[i, 0], z[i, 1] = q, 0.0
        if q > MIN_RANGE:
            z[i, 1] = wrapped(atan2(dy, dx) - s[2])
            D[0, 3], D[0, 4], D[1, 3], D[1, 4] = dx / q, dy / q, -dy / q**2, dx / q**2
            D[1, 2] = -1.0
            for k in range(2):
                D[k, 0], D[k, 1] = -D[k, 3], -D[k, 4]
                D[k, 2] += D[k, 3] * (a[m] - a[0]) + D[k, 4] * (a[m + 1] - a[1])  # by eta
        for j in range(2):
            d = D[j]
            for p in range(3):
                W[j, p] = P[p, m] * d[3] + P[p, m + 1] * d[4]
                for o in range(3):
                    W[j, p] += P[p, o] * d[o]
            W[j, 3] = blocks[0] * d[3] + blocks[1] * d[4]
            W[j, 4] = blocks[1] * d[3] + blocks[2] * d[4]
            for p in range(3):
                W[j, 3] += P[p, m] * d[p]
                W[j, 4] += P[p, m + 1] * d[p]
        for j in range(2):
            for k in range(2):
                S[i, j, k] = 0.0
                for p in range(5):
                    S[i, j, k] += D[max(j, k), p] * W[min(j, k), p]


@kernel()
def inverse_observe(
    f: FilterState, z: FloatArray, R: FloatArray, xy: FloatArray, C: FloatArray
) -> None:
    """Fill the position (2,) of an observed point (C.15), and Gz R Gz^T (2, 2)."""
    s = f.state
    c, d = cos(s[2] + z[1]), sin(s[2] + z[1])
    Gz = np.array([[c, -z[0] * d], [d, z[0] * c]])  # C.18
    xy[0], xy[1] = s[0] + z[0] * c, s[1] + z[0] * d
    _sandwich(Gz, R, R, 0.0, C, 2, 2)


@kernel()
def augment_range_bearing(f: FilterState, z: FloatArray, R: FloatArray) -> None:
    """`augment` by range and bearing (C.15-C.18).

    The standard filter does so to first order, the invariant to second order: along the bearing n
    and across it, the terms are -z0 n^2 / 2 and d n, d the error of the range.
    """
    xy, noise, Gx, s = np.empty(2), np.empty((2, 2)), np.zeros((2, f.robot_size)), f.state
    inverse_observe(f, z, R, xy, noise)
    if f.error_state == INVARIANT:
        c, d, q, k = cos(s[2] + z[1]), sin(s[2] + z[1]), R[1, 1], R[0, 1]
        along, across = -z[0] * q / 2, k
        xy[0], xy[1] = xy[0] + c * along - d * across, xy[1] + d * along + c * across
        aa, ab, bb = z[0] * z[0] * q * q / 2, -z[0] * k * q, R[0, 0] * q + k * k
        noise[0, 0] += c * c * aa - 2 * c * d * ab + d * d * bb
        noise[1, 1] += d * d * aa + 2 * c * d * ab + c * c * bb
        noise[0, 1] += c * d * (aa - bb) + (c * c - d * d) * ab
        noise[1, 0] = noise[0, 1]
    Gx[0, 0] = Gx[1, 1] = 1.0
    Gx[0, 2], Gx[1, 2] = s[1] - xy[1], xy[0] - s[0]
    augment(f, xy, Gx, noise)


@kernel()
def write_pose(f: FilterState, pose: FloatArray, covariance: FloatArray) -> None:
    """Fill the pose (3,) and its covariance (3, 3), of e."""
    F, s, a = np.eye(3), f.state, f.heading_lever
    for i in range(3):
        pose[i] = s[i]
    if f.error_state == INVARIANT:
        F[0, 2], F[1, 2] = a[0], a[1]
    _sandwich(F, f.P, F, 0.0, covariance, 3, 3)
