"""Residuals of matches of two views, and their derivatives by the entries of a matrix."""

from math import hypot, inf, log1p, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray

KINDS = ("homography", "fundamental", "essential")
"""Kinds of matrices; kernels take the index."""
HOMOGRAPHY, ESSENTIAL = 0, 2
SMALLEST = 1e-300
"""Lower bound of a variance."""
RIDGE = 1e-13
"""Relative increase of the diagonal of a system that may be singular."""
FREEDOM = (8, 7, 5)
"""Number of parameters of each kind."""


@kernel()
def fill_epipolar(
    F: FloatArray,
    matched: FloatArray,
    sigma: FloatArray,
    z: FloatArray,
    J: FloatArray,
) -> None:
    """Sampson distances of matches in standard deviations, and their derivatives.

    Args:
        F: (3, 3) fundamental or essential matrix.
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) standard deviations of both positions.
        z: (m, 1) distances.
        J: (m, 1, 9) derivatives by the entries of F, row by row.

    Source: Hartley & Zisserman (2004), section 11.4.3.
    """
    for i in range(len(matched)):
        x1, y1, x2, y2 = matched[i, 0], matched[i, 1], matched[i, 2], matched[i, 3]
        v1, v2 = sigma[i, 0] ** 2, sigma[i, 1] ** 2
        u1 = x2 * F[0, 0] + y2 * F[1, 0] + F[2, 0]  # F' x2, the line in the first image
        w1 = x2 * F[0, 1] + y2 * F[1, 1] + F[2, 1]
        u2 = F[0, 0] * x1 + F[0, 1] * y1 + F[0, 2]  # F x1
        w2 = F[1, 0] * x1 + F[1, 1] * y1 + F[1, 2]
        gap = x2 * u2 + y2 * w2 + F[2, 0] * x1 + F[2, 1] * y1 + F[2, 2]
        variance = (u1 * u1 + w1 * w1) * v1 + (u2 * u2 + w2 * w2) * v2
        length = sqrt(max(variance, SMALLEST))
        z[i, 0] = gap / length
        # d gap = x2' dF x1, and half of d variance = x2' dF (v1 u1, v1 w1) + (v2 u2, v2 w2)' dF x1.
        ratio = gap / (length * length)
        a, b = x1 - ratio * v1 * u1, y1 - ratio * v1 * w1
        c, d = ratio * v2 * u2, ratio * v2 * w2
        J[i, 0, 0] = (x2 * a - c * x1) / length
        J[i, 0, 1] = (x2 * b - c * y1) / length
        J[i, 0, 2] = (x2 - c) / length
        J[i, 0, 3] = (y2 * a - d * x1) / length
        J[i, 0, 4] = (y2 * b - d * y1) / length
        J[i, 0, 5] = (y2 - d) / length
        J[i, 0, 6] = a / length
        J[i, 0, 7] = b / length
        J[i, 0, 8] = 1 / length


@kernel()
def fill_whitening(
    H: FloatArray,
    matched: FloatArray,
    sigma: FloatArray,
    whitening: FloatArray,
) -> None:
    """Triangular factors that scale errors of both positions to unit covariance.

    Args:
        H: (3, 3) homography.
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) standard deviations of both positions.
        whitening: (m, 3) entries (0, 0), (1, 0) and (1, 1) of the inverse of the lower Cholesky
            factor of the covariance in the second image.
    """
    for i in range(len(matched)):
        x, y = matched[i, 0], matched[i, 1]
        depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / depth
        w = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / depth
        a, b = (H[0, 0] - u * H[2, 0]) / depth, (H[0, 1] - u * H[2, 1]) / depth
        c, d = (H[1, 0] - w * H[2, 0]) / depth, (H[1, 1] - w * H[2, 1]) / depth
        v1, v2 = sigma[i, 0] ** 2, sigma[i, 1] ** 2
        xx, xy, yy = (a * a + b * b) * v1 + v2, (a * c + b * d) * v1, (c * c + d * d) * v1 + v2
        l00 = sqrt(xx)
        l10 = xy / l00
        l11 = sqrt(yy - l10 * l10)
        whitening[i, 0] = 1 / l00
        whitening[i, 1] = -l10 / (l00 * l11)
        whitening[i, 2] = 1 / l11


@kernel()
def fill_transfer(
    H: FloatArray,
    matched: FloatArray,
    whitening: FloatArray,
    z: FloatArray,
    J: FloatArray,
) -> None:
    """Errors of matches in the second image of a homography, whitened, and their derivatives.

    Args:
        H: (3, 3) homography.
        matched: (m, 4) rows x1, y1, x2, y2.
        whitening: (m, 3), see `fill_whitening`.
        z: (m, 2) errors.
        J: (m, 2, 9) derivatives by the entries of H, row by row; (0, 2, 9) for none.
    """
    for i in range(len(matched)):
        x, y = matched[i, 0], matched[i, 1]
        depth = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / depth
        w = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / depth
        a, b, c = whitening[i, 0], whitening[i, 1], whitening[i, 2]
        z[i, 0] = a * (u - matched[i, 2])
        z[i, 1] = b * (u - matched[i, 2]) + c * (w - matched[i, 3])
        if i < len(J):
            for k in range(3):
                p = (x if k == 0 else y if k == 1 else 1.0) / depth
                J[i, 0, k] = a * p
                J[i, 0, 3 + k] = 0.0
                J[i, 0, 6 + k] = -a * u * p
                J[i, 1, k] = b * p
                J[i, 1, 3 + k] = c * p
                J[i, 1, 6 + k] = -(b * u + c * w) * p


@kernel()
def fill_beyond(
    R: FloatArray,
    t: FloatArray,
    rays: FloatArray,
    ahead: FloatArray,
    behind: FloatArray,
) -> None:
    """Distances of matches from points in front of both cameras, in the second view.

    Args:
        R: (3, 3) rotation.
        t: (3,) translation.
        rays: (m, 4) rows x1, y1, x2, y2 in the planes z = 1.
        ahead: (m,) distances for t: 0 in front of both cameras, infinite where the direction at
            infinity is behind the second one.
        behind: (m,) distances for -t.
    """
    for i in range(len(rays)):
        u, v = rays[i, 2], rays[i, 3]
        x = R[0, 0] * rays[i, 0] + R[0, 1] * rays[i, 1] + R[0, 2]  # first ray, turned
        y = R[1, 0] * rays[i, 0] + R[1, 1] * rays[i, 1] + R[1, 2]
        z = R[2, 0] * rays[i, 0] + R[2, 1] * rays[i, 1] + R[2, 2]
        # a turned + t = b second, solved by products with the two rays.
        n0, n1, n2 = y - z * v, z * u - x, x * v - y * u
        c0, c1, c2 = n1 * t[2] - n2 * t[1], n2 * t[0] - n0 * t[2], n0 * t[1] - n1 * t[0]
        a, b = -(c0 * u + c1 * v + c2), -(c0 * x + c1 * y + c2 * z)
        beyond = inf
        if z > 0:  # along the epipolar line from the direction at infinity
            at_x, at_y = x / z, y / z
            step_x, step_y = t[0] - at_x * t[2], t[1] - at_y * t[2]
            length = max(hypot(step_x, step_y), 1e-12)
            beyond = abs((u - at_x) * step_x + (v - at_y) * step_y) / length
        ahead[i] = 0.0 if a > 0 and b > 0 else beyond
        behind[i] = 0.0 if a < 0 and b < 0 else beyond


@kernel()
def minimize(
    kind: int,
    factors: FloatArray,
    matched: FloatArray,
    scales: FloatArray,
    width: float,
    max_steps: int,
    min_decrease: float,
) -> None:
    """Moves a matrix to the least Cauchy loss near it.

    Gauss-Newton steps that take the second derivative of the loss where it is positive. A step
    that does not lower the loss is halved.

    Args:
        kind: of the matrix, an index of `KINDS`.
        factors: (3, 3, 3) U, K and V of the matrix U K V', of unit norm; changed in place. Of a
            homography U and V are identities. Otherwise they are rotations, and K is zero but for
            two rows and columns, which are a rotation over sqrt(2) for an essential matrix.
        matched: (m, 4) rows x1, y1, x2, y2.
        scales: of the residuals: (m, 3) of a homography, see `fill_whitening`; else (m, 2) standard
            deviations of both positions.
        width: of the loss.
        max_steps: largest number of steps, halved ones included.
        min_decrease: relative decrease of the loss below which the fit has converged.
    """
    c, k = 2 if kind == HOMOGRAPHY else 1, FREEDOM[kind]
    z, J = np.empty((len(matched), c)), np.empty((len(matched), c, 9))
    step, trial, matrix = np.empty(k), np.empty((3, 3, 3)), np.empty((3, 3))
    directions = np.empty((k, 9))
    _multiply(factors, matrix)
    _fill_residuals(kind, matrix, matched, scales, z, J)
    cost, size, improved = _cauchy_loss(z, width), 1.0, True
    for _ in range(max_steps):
        if improved:
            _fill_directions(kind, factors, directions)
            _fill_step(directions, z, J, width, step)
        _move(kind, factors, size, step, directions, trial)
        _multiply(trial, matrix)
        _fill_residuals(kind, matrix, matched, scales, z, J)
        decrease = cost - _cauchy_loss(z, width)
        improved = decrease > 0
        if improved:
            for i in range(27):
                factors[i // 9, i // 3 % 3, i % 3] = trial[i // 9, i // 3 % 3, i % 3]
            cost, size = cost - decrease, 1.0
        else:
            size /= 2
        if abs(decrease) <= min_decrease * cost:
            break


@kernel()
def _multiply(factors: FloatArray, matrix: FloatArray) -> None:
    """Writes the (3, 3) product U K V' of factors (3, 3, 3)."""
    for i in range(3):
        for j in range(3):
            matrix[i, j] = 0.0
            for p in range(3):
                for q in range(3):
                    matrix[i, j] += factors[0, i, p] * factors[1, p, q] * factors[2, j, q]


@kernel()
def _fill_residuals(
    kind: int,
    matrix: FloatArray,
    matched: FloatArray,
    scales: FloatArray,
    z: FloatArray,
    J: FloatArray,
) -> None:
    if kind == HOMOGRAPHY:
        fill_transfer(matrix, matched, scales, z, J)
    else:
        fill_epipolar(matrix, matched, scales, z, J)


@kernel()
def _cauchy_loss(z: FloatArray, width: float) -> float:
    total = 0.0
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            total += log1p((z[i, j] / width) ** 2)
    return total


@kernel()
def _fill_directions(kind: int, factors: FloatArray, directions: FloatArray) -> None:
    """Directions (k, 9) in which a matrix of unit norm can move, orthonormal, row by row.

    Args:
        kind: see `minimize`.
        factors: see `minimize`.
        directions: of the changes of K that `_move` takes apart, as changes of U K V'.
    """
    size = 3 if kind == HOMOGRAPHY else 2
    first = len(directions) - (1 if kind == ESSENTIAL else size * size - 1)
    inner = np.zeros((len(directions), 3, 3))
    for p in range(first):  # the last row and the last column of K
        inner[p, 2 if p < 2 else p - 2, p if p < 2 else 2] = 1.0
    last = factors[1, size - 1, size - 1]
    for p in range(size * size - 1):
        i, j = p // size, p % size
        if kind != ESSENTIAL:  # a reflection of the last entry onto K: its other columns
            for q in range(size * size):
                entry = factors[1, q // size, q % size]
                if q == size * size - 1:
                    entry += 1.0 if last >= 0 else -1.0
                reflected = -factors[1, i, j] * entry / (1 + abs(last))
                inner[first + p, q // size, q % size] = reflected
            inner[first + p, i, j] += 1.0
        elif j == 0:  # a rotation
            inner[4, i, 0], inner[4, i, 1] = factors[1, i, 1], -factors[1, i, 0]
    for p in range(len(directions)):
        for i in range(3):
            for j in range(3):
                total = 0.0
                for q in range(3):
                    for r in range(3):
                        total += factors[0, i, q] * inner[p, q, r] * factors[2, j, r]
                directions[p, 3 * i + j] = total


@kernel()
def _fill_step(
    directions: FloatArray, z: FloatArray, J: FloatArray, width: float, step: FloatArray
) -> None:
    """A Gauss-Newton step (k,) along directions (k, 9), from residuals and derivatives."""
    k = len(step)
    A, row = np.zeros((k, k)), np.empty(k)
    for p in range(k):
        step[p] = 0.0
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            loss = 1 + (z[i, j] / width) ** 2
            curvature = max((2 - loss) / loss**2, 0.0)
            for p in range(k):
                row[p] = 0.0
                for q in range(9):
                    row[p] += directions[p, q] * J[i, j, q]
                step[p] -= row[p] * z[i, j] / loss
                for q in range(p + 1):
                    A[p, q] += curvature * row[p] * row[q]
    for p in range(k):  # Cholesky's root, in place, and both triangular solutions
        A[p, p] = A[p, p] * (1 + RIDGE) + SMALLEST
        for q in range(p + 1):
            for r in range(q):
                A[p, q] -= A[p, r] * A[q, r]
            A[p, q] = A[p, q] / A[q, q] if q < p else sqrt(max(A[p, p], SMALLEST))
        for q in range(p):
            step[p] -= A[p, q] * step[q]
        step[p] /= A[p, p]
    for p in range(k - 1, -1, -1):
        for q in range(p + 1, k):
            step[p] -= A[q, p] * step[q]
        step[p] /= A[p, p]


@kernel()
def _move(
    kind: int,
    factors: FloatArray,
    size: float,
    step: FloatArray,
    directions: FloatArray,
    moved: FloatArray,
) -> None:
    """Factors of the matrix that is `size` times a step along directions away, to first order."""
    for i in range(3):
        for j in range(3):
            for p in range(3):
                moved[p, i, j] = factors[p, i, j]
    if kind != HOMOGRAPHY:
        a, b, c, d = factors[1, 0, 0], factors[1, 0, 1], factors[1, 1, 0], factors[1, 1, 1]
        scale = size / (a * d - b * c)
        # The last row of K turns U, its last column turns V.
        _turn(moved, 0, scale * (step[0] * d - step[1] * c), scale * (step[1] * a - step[0] * b))
        _turn(moved, 2, scale * (step[2] * d - step[3] * b), scale * (step[3] * a - step[2] * c))
    for p in range(0 if kind == HOMOGRAPHY else 4, len(step)):
        for i in range(3 if kind == HOMOGRAPHY else 2):
            for j in range(3 if kind == HOMOGRAPHY else 2):
                for q in range(9):  # U' D V, the change of K
                    entry = factors[0, q // 3, i] * directions[p, q] * factors[2, q % 3, j]
                    moved[1, i, j] += size * step[p] * entry
    length = 0.0
    for i in range(3):
        for j in range(3):
            length += moved[1, i, j] ** 2
    length = sqrt(length)
    for i in range(3):
        for j in range(3):
            moved[1, i, j] /= length


@kernel()
def _turn(factors: FloatArray, part: int, x: float, y: float) -> None:
    """Moves the first columns of a rotation by x and y of the last one, and keeps it a rotation."""
    first = second = product = 0.0
    for i in range(3):
        factors[part, i, 0] += x * factors[part, i, 2]
        factors[part, i, 1] += y * factors[part, i, 2]
        first += factors[part, i, 0] ** 2
        product += factors[part, i, 0] * factors[part, i, 1]
    for i in range(3):  # Gram and Schmidt
        factors[part, i, 1] -= product / first * factors[part, i, 0]
        factors[part, i, 0] /= sqrt(first)
        second += factors[part, i, 1] ** 2
    for i in range(3):
        factors[part, i, 1] /= sqrt(second)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        product = factors[part, j, 0] * factors[part, k, 1]
        factors[part, i, 2] = product - factors[part, k, 0] * factors[part, j, 1]
