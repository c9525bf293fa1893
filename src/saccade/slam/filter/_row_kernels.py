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
    """Fill V (2, n) = B P, P of eta.

    B (2, 7) is by x, y, theta, the landmark at row m, and the systematic errors of the ranges.
    """
    r, n, P, e = f.robot_size, num_rows(f), f.P, f.range_errors
    for k in range(2):
        _scale_and_add(V[k, :n], 0.0, B[k, 0], P[0, :n])
        _add_two_rows(V[k, :n], B[k, 1], P[1, :n], B[k, 2], P[2, :n])
        if e > 0:
            _add_two_rows(V[k, :n], B[k, 5], P[e, :n], B[k, 6], P[e + 1, :n])
    for j in range(m + 1):  # the landmark's columns; then its rows, of the upper triangle
        x, y = P[j, m], P[j, m + 1]
        V[0, j] += B[0, 3] * x + B[0, 4] * y
        V[1, j] += B[1, 3] * x + B[1, 4] * y
    for k in range(2):
        b, v = B[k, 3:], V[k, :n]
        v[m + 1] += b[0] * P[m, m + 1] + b[1] * P[m + 1, m + 1]
        _add_two_rows(v[m + 2 :], b[0], P[m, m + 2 : n], b[1], P[m + 1, m + 2 : n])
        _add_delayed_rows(v, r, m, b, -1.0, f.downdates, f.now.downdates)
        _add_delayed_rows(v, r, m, b, 1.0, f.updates, f.now.updates)
