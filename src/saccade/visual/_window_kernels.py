"""Compiled loops of the sliding window: normal equations of its poses.

Their columns are those of the errors of the calibration, of each pose (rotation vector and
translation), and of the errors of odometry.
"""

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray
from saccade.visual._kernels import Intrinsics, _times_transposed, robot_motion_kernel

MIN_DEPTH_RATIO = 0.05
"""Least depth in a frame as a fraction of that in the reference frame; nearer observations are
ignored."""
DAMPING = 1.0
"""Added to the information of a point in every coordinate (Levenberg): far less than that of an
observation, it keeps a point without parallax or depth where it is."""
PARAMETERS = 3
"""Errors of the calibration, see `SelfCalibration`."""


@kernel()
def eliminate_points(
    observed: FloatArray,
    sigma: FloatArray,
    reference: IntArray,
    intrinsics: Intrinsics,
    poses: tuple[FloatArray, FloatArray],
    references: tuple[FloatArray, FloatArray],
    disparity_scale: float,
    kernel_width: float,
    points: FloatArray,
    information: FloatArray,
    gradient: FloatArray,
    gain: FloatArray,
    offset: FloatArray,
) -> None:
    """Add k points observed in n frames to the normal equations of the poses.

    A point (x, y, h) is the ray (x, y, 1) and the inverse depth h in the frame in which it was
    first observed, at the pose it had before the iterations (`references`): the residuals of an
    observation then depend on one pose alone. Points are eliminated by the Schur complement.

    Args:
        observed: (k, n, 3) pixels and inverse depth in 1 / metres, NaN where not measured.
        sigma: (k, n, 3) their standard deviations.
        reference: (k,) number of the frame in which each was first observed.
        intrinsics: of the camera.
        poses: (n, 3, 3) and (n, 3) `CameraPose`s of the frames, from a common frame.
        references: the same before the iterations.
        disparity_scale: inverse depth of a disparity of one pixel; 0 without a stereo rig.
        kernel_width: width of the robust kernel, in standard deviations.
        points: (k, 3).
        information: (3 + 6 n + ..., the same) by the errors of the calibration (see
            `SelfCalibration`) and by rotation vector and translation of each pose, added to.
        gradient: (3 + 6 n + ...,), added to.
        gain: (k, 3, 3 + 6 n) overwritten: a change p of these changes the points by
            `offset` - `gain` p.
        offset: (k, 3) overwritten.
    """
    fx, fy, cx, cy = intrinsics
    R, t = poses
    R0, t0 = references
    k, n = len(points), len(R)
    m = PARAMETERS
    A, P, inverse = np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 3))
    J, D = np.zeros((3, 6 + m)), np.empty((3, 3))
    b, q, residual = np.empty(3), np.empty(3), np.empty(3)
    cross, columns = np.empty((6 * n + m, 3)), np.empty(6 * n + m, np.int64)
    block = np.empty(6 + m, np.int64)
    H, g = np.empty((3, 3)), np.empty(3)
    for c in range(m):
        columns[c] = block[6 + c] = c
    for i in range(k):
        a = reference[i]
        x, y, h = points[i, 0], points[i, 1], points[i, 2]
        for r in range(3):
            g[r] = 0.0
            for c in range(3):
                H[r, c] = DAMPING if r == c else 0.0
            for c in range(m):
                cross[c, r] = 0.0
        count = m
        for j in range(n):
            if not np.isfinite(observed[i, j, 0]):
                continue
            for r in range(3):
                for c in range(3):
                    A[r, c] = (
                        R[j, r, 0] * R0[a, c, 0]
                        + R[j, r, 1] * R0[a, c, 1]
                        + R[j, r, 2] * R0[a, c, 2]
                    )
            for r in range(3):
                b[r] = t[j, r] - A[r, 0] * t0[a, 0] - A[r, 1] * t0[a, 1] - A[r, 2] * t0[a, 2]
                q[r] = A[r, 0] * x + A[r, 1] * y + A[r, 2] + h * b[r]
            if q[2] <= MIN_DEPTH_RATIO:
                continue
            u, v, w = q[0] / q[2], q[1] / q[2], h / q[2]
            measured = np.isfinite(observed[i, j, 2])
            residual[0] = (observed[i, j, 0] - fx * u - cx) / sigma[i, j, 0]
            residual[1] = (observed[i, j, 1] - fy * v - cy) / sigma[i, j, 1]
            residual[2] = (observed[i, j, 2] - w) / sigma[i, j, 2] if measured else 0.0
            s0, s1 = fx / q[2] / sigma[i, j, 0], fy / q[2] / sigma[i, j, 1]
            s2 = 1 / q[2] / sigma[i, j, 2] if measured else 0.0
            P[0, 0], P[0, 2], P[1, 1], P[1, 2], P[2, 2] = s0, -u * s0, s1, -v * s1, -w * s2
            px, py, pz = q[0] - h * t[j, 0], q[1] - h * t[j, 1], q[2] - h * t[j, 2]
            square = 0.0
            for r in range(3):
                J[r, 0] = P[r, 2] * py - P[r, 1] * pz
                J[r, 1] = P[r, 0] * pz - P[r, 2] * px
                J[r, 2] = P[r, 1] * px - P[r, 0] * py
                for c in range(3):
                    J[r, 3 + c] = h * P[r, c]
                    D[r, c] = P[r, 0] * A[0, c] + P[r, 1] * A[1, c] + P[r, 2] * A[2, c]
                D[r, 2] = P[r, 0] * b[0] + P[r, 1] * b[1] + P[r, 2] * b[2]
                square += residual[r] * residual[r]
            D[2, 2] += s2
            # taken at the predicted pixel: noise of the observed one would bias them
            radius = u * u + v * v
            J[0, 6] = -fx * u * radius / sigma[i, j, 0]
            J[1, 6] = -fy * v * radius / sigma[i, j, 1]
            stereo = measured and disparity_scale > 0
            J[2, 6] = -w * (3 * u * u + v * v) / sigma[i, j, 2] if stereo else 0.0
            J[2, 7] = -u * disparity_scale / sigma[i, j, 2] if stereo else 0.0
            J[2, 8] = -disparity_scale / sigma[i, j, 2] if stereo else 0.0
            root = 1 / (1 + square / (kernel_width * kernel_width))
            robust = root * root  # Geman & McClure (1987)
            for c in range(6):
                columns[count + c] = block[c] = m + 6 * j + c
                for r in range(3):
                    cross[count + c, r] = 0.0
            for r in range(6 + m):
                row = count + r if r < 6 else r - 6
                j0, j1, j2 = robust * J[0, r], robust * J[1, r], robust * J[2, r]
                gradient[block[r]] += j0 * residual[0] + j1 * residual[1] + j2 * residual[2]
                for c in range(6 + m):
                    information[block[r], block[c]] += j0 * J[0, c] + j1 * J[1, c] + j2 * J[2, c]
                for c in range(3):
                    cross[row, c] += j0 * D[0, c] + j1 * D[1, c] + j2 * D[2, c]
            for r in range(3):
                d0, d1, d2 = robust * D[0, r], robust * D[1, r], robust * D[2, r]
                g[r] += d0 * residual[0] + d1 * residual[1] + d2 * residual[2]
                for c in range(3):
                    H[r, c] += d0 * D[0, c] + d1 * D[1, c] + d2 * D[2, c]
            count += 6
        invert3(H, inverse)
        for r in range(3):
            for c in range(6 * n + m):
                gain[i, r, c] = 0.0
            i0, i1, i2 = inverse[r, 0], inverse[r, 1], inverse[r, 2]
            offset[i, r] = i0 * g[0] + i1 * g[1] + i2 * g[2]
            for c in range(count):
                gain[i, r, columns[c]] = i0 * cross[c, 0] + i1 * cross[c, 1] + i2 * cross[c, 2]
        for r in range(count):
            row, c0, c1, c2 = columns[r], cross[r, 0], cross[r, 1], cross[r, 2]
            gradient[row] -= c0 * offset[i, 0] + c1 * offset[i, 1] + c2 * offset[i, 2]
            for c in range(count):
                e = columns[c]
                information[row, e] -= c0 * gain[i, 0, e] + c1 * gain[i, 1, e] + c2 * gain[i, 2, e]


@kernel()
def invert3(H: FloatArray, inverse: FloatArray) -> None:
    """Inverse of a symmetric positive definite (3, 3) matrix."""
    a, b, c = H[0, 0], H[0, 1], H[0, 2]
    d, e, f = H[1, 1], H[1, 2], H[2, 2]
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1 / (a * p + b * q + c * r)
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = (
        p * scale,
        (a * f - c * c) * scale,
        (a * d - b * b) * scale,
    )
    inverse[0, 1] = inverse[1, 0] = q * scale
    inverse[0, 2] = inverse[2, 0] = r * scale
    inverse[1, 2] = inverse[2, 1] = (b * c - a * e) * scale


@kernel()
def add_motion_factors(
    poses: tuple[FloatArray, FloatArray],
    mounting: tuple[FloatArray, FloatArray],
    odometry: tuple[FloatArray, FloatArray, FloatArray],
    times: FloatArray,
    acceleration: FloatArray,
    first: tuple[FloatArray, FloatArray],
    kernel_width: float,
    information: FloatArray,
    gradient: FloatArray,
    motion: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Add odometry, and that motion changes little from step to step, to the normal equations.

    Args:
        poses: (n, 3, 3) and (n, 3) `CameraPose`s of the frames.
        mounting: (n, 3, 3) rotations of the camera on the robot in each frame, and its position.
        odometry: (n - 1, 3) controls, (n - 1, 3, m) their derivatives by its errors, and
            (n - 1, 6, 6) information of control and off-plane motion.
        times: (n - 1,) seconds of the steps.
        acceleration: (6,) standard deviations of the change of the motion's rates in a second.
        first: (6,) rates of the motion before the first step, and their (6, 6) information.
        kernel_width: width of the robust kernel, in standard deviations.
        information: (3 + 6 n + m, 3 + 6 n + m), added to.
        gradient: (3 + 6 n + m,), added to.
        motion: (n - 1, 6) overwritten by the motions of the steps.
        jacobian: (n - 1, 6, 12) overwritten by their derivatives by the poses before and after.
    """
    R, t = poses
    mount, position = mounting
    control, by_errors, weight = odometry
    n, m = len(motion), by_errors.shape[2]
    residual, wide, change = np.empty(6), np.zeros((6, 12 + m)), np.empty((6, 18))
    W = np.zeros((6, 6))
    columns = np.empty(12 + m, np.int64)
    for k in range(n):
        step_motion(
            *(R[k], t[k], R[k + 1], t[k + 1], mount[k + 1], mount[k]),
            *(position, motion[k], jacobian[k]),
        )
        for c in range(12 + m):
            columns[c] = PARAMETERS + 6 * (k if c < 12 else n - 1) + c
        for r in range(6):
            residual[r] = (control[k, r] if r < 3 else 0.0) - motion[k, r]
            for c in range(12):
                wide[r, c] = jacobian[k, r, c]
            if r < 3:
                for c in range(m):
                    wide[r, 12 + c] = -by_errors[k, r, c]
        add_factor(wide, columns, residual, weight[k], kernel_width, information, gradient)
    columns = PARAMETERS + np.arange(18)
    rates, before = first
    for r in range(6):
        residual[r] = rates[r] - motion[0, r] / times[0]
    add_factor(
        *(jacobian[0] / times[0], columns[:12], residual, before),
        *(kernel_width, information, gradient),
    )
    for k in range(1, n):
        seconds = (times[k] + times[k - 1]) / 2
        for r in range(6):
            W[r, r] = 1 / (acceleration[r] * seconds) ** 2
            residual[r] = motion[k - 1, r] / times[k - 1] - motion[k, r] / times[k]
            for c in range(18):
                later = jacobian[k, r, c - 6] / times[k] if c >= 6 else 0.0
                change[r, c] = later - (jacobian[k - 1, r, c] / times[k - 1] if c < 12 else 0.0)
        add_factor(
            *(change, columns + 6 * (k - 1), residual, W, kernel_width, information, gradient)
        )


@kernel()
def step_motion(
    R1: FloatArray,
    t1: FloatArray,
    R2: FloatArray,
    t2: FloatArray,
    after: FloatArray,
    before: FloatArray,
    position: FloatArray,
    motion: FloatArray,
    jacobian: FloatArray,
) -> None:
    """The robot's motion (6,) from one `CameraPose` to the next, as `robot_motion_kernel`.

    Its derivative (6, 12) is by rotation vector and translation of both poses.
    """
    R, t, turned, by_motion = np.empty((3, 3)), np.empty(3), np.zeros(3), np.empty((6, 6))
    _times_transposed(R2, R1, R)
    for r in range(3):
        for k in range(3):
            turned[r] += R[r, k] * t1[k]
        t[r] = t2[r] - turned[r]
    robot_motion_kernel(R, t, after, before, position, motion, by_motion)
    for r in range(6):
        x, y, z = by_motion[r, 3], by_motion[r, 4], by_motion[r, 5]
        jacobian[r, 6] = by_motion[r, 0] + y * turned[2] - z * turned[1]
        jacobian[r, 7] = by_motion[r, 1] + z * turned[0] - x * turned[2]
        jacobian[r, 8] = by_motion[r, 2] + x * turned[1] - y * turned[0]
        jacobian[r, 9], jacobian[r, 10], jacobian[r, 11] = x, y, z
        for c in range(6):
            block = 6 + 3 * (c // 3)
            jacobian[r, c] = -(
                jacobian[r, block] * R[0, c % 3]
                + jacobian[r, block + 1] * R[1, c % 3]
                + jacobian[r, block + 2] * R[2, c % 3]
            )


@kernel()
def add_factor(
    J: FloatArray,
    columns: IntArray,
    residual: FloatArray,
    W: FloatArray,
    kernel_width: float,
    information: FloatArray,
    gradient: FloatArray,
) -> None:
    """Add a residual (6,) with information W (6, 6) to normal equations (Cauchy's kernel).

    Its negated derivative J (6, k) is by k of their columns.
    """
    k = len(columns)
    weighted, WJ, square = np.zeros(6), np.zeros((6, k)), 0.0
    for r in range(6):
        for c in range(6):
            weighted[r] += W[r, c] * residual[c]
            for i in range(k):
                WJ[r, i] += W[r, c] * J[c, i]
        square += residual[r] * weighted[r]
    robust = 1 / (1 + square / (kernel_width * kernel_width))
    for i in range(k):
        for r in range(6):
            scaled = robust * J[r, i]
            gradient[columns[i]] += scaled * weighted[r]
            for j in range(k):
                information[columns[i], columns[j]] += scaled * WJ[r, j]
