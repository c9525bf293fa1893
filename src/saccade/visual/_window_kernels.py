"""Compiled loops of the sliding window: normal equations of poses, with the points eliminated."""

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import Intrinsics

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
    squared_residual: FloatArray,
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
        information: (6 n + 3, 6 n + 3) by rotation vector and translation of each pose and by the
            errors of the calibration (see `SelfCalibration`), added to.
        gradient: (6 n + 3,), added to.
        gain: (k, 3, 6 n + 3) overwritten: a change p of these changes the points by
            `offset` - `gain` p.
        offset: (k, 3) overwritten.
        squared_residual: (k, n) overwritten by the normalized squares, NaN where not observed.
    """
    fx, fy, cx, cy = intrinsics
    R, t = poses
    R0, t0 = references
    k, n = squared_residual.shape
    m = PARAMETERS
    A, P, inverse = np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 3))
    J, D = np.zeros((3, 6 + m)), np.empty((3, 3))
    b, q, residual = np.empty(3), np.empty(3), np.empty(3)
    cross, columns = np.empty((6 * n + m, 3)), np.empty(6 * n + m, np.int64)
    block = np.empty(6 + m, np.int64)
    H, g = np.empty((3, 3)), np.empty(3)
    for c in range(m):
        columns[c] = block[6 + c] = 6 * n + c
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
            squared_residual[i, j] = np.nan
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
            squared_residual[i, j] = square
            root = 1 / (1 + square / (kernel_width * kernel_width))
            robust = root * root  # Geman & McClure (1987)
            for c in range(6):
                columns[count + c] = block[c] = 6 * j + c
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
