"""Linear combinations of rows of a `FilterState`, and products with its covariance."""

import numpy as np

from saccade._jit import kernel
from saccade.slam.filter._state_kernels import FilterState, num_rows
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
    """Add w[i : i + 8] rows[i : i + 8, r:n] to row."""
    a, b, c, d, e, f, g, h = (
        *(w[i], w[i + 1], w[i + 2], w[i + 3]),
        *(w[i + 4], w[i + 5], w[i + 6], w[i + 7]),
    )
    s, t, u, v = rows[i, r:n], rows[i + 1, r:n], rows[i + 2, r:n], rows[i + 3, r:n]
    x, y, p, q = rows[i + 4, r:n], rows[i + 5, r:n], rows[i + 6, r:n], rows[i + 7, r:n]
    for j in range(len(row)):
        one = (a * s[j] + b * t[j]) + (c * u[j] + d * v[j])
        row[j] += one + ((e * x[j] + f * y[j]) + (g * p[j] + h * q[j]))


@kernel()
def _add_delayed_rows(
    row: FloatArray, r: int, m: int, d: FloatArray, sign: float, Y: FloatArray, used: int
) -> None:
    """Add d (2,), at columns m and m + 1, times sign Y^T Y to a row (n,).

    Y has 8 k rows, of which the first `used` count.
    """
    n, w = len(row), np.empty(len(Y))
    for i in range((used + 7) // 8 * 8):
        w[i] = sign * (d[0] * Y[i, m] + d[1] * Y[i, m + 1]) if i < used else 0.0
    for i in range(0, used, 8):
        _add_eight_rows(row[r:], w, Y, i, r, n)


@kernel(fastmath=("contract",))
def _multiply_covariance(f: FilterState, m: int, B: FloatArray, V: FloatArray) -> None:
    """Fill V (2, n) = B P, B (2, 5) by x, y, theta and the landmark at row m, P of eta."""
    r, n, P = f.robot_size, num_rows(f), f.P
    i, cached = 2 * _cached_rows(f, m), f.cached_rows
    for k in range(2):
        b, v = B[k], V[k, :n]
        _scale_and_add(v, 0.0, b[0], P[0, :n])
        _add_two_rows(v, b[1], P[1, :n], b[2], P[2, :n])
        for j in range(r):
            v[j] += b[3] * P[j, m] + b[4] * P[j, m + 1]
        _add_two_rows(v[r:], b[3], cached[i, r:n], b[4], cached[i + 1, r:n])
        _add_delayed_rows(v, r, m, b[3:], -1.0, f.downdates, f.now.downdates)
        _add_delayed_rows(v, r, m, b[3:], 1.0, f.updates, f.now.updates)


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
