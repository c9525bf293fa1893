"""Linear combinations of long rows: where the filter spends its time."""

import numpy as np

from saccade._jit import kernel
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
    """Add w (8,) rows[i : i + 8] from r to n to row."""
    a, b, c, d, e, f, g, h = w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7]
    s, t, u, v = rows[i, r:n], rows[i + 1, r:n], rows[i + 2, r:n], rows[i + 3, r:n]
    x, y, p, q = rows[i + 4, r:n], rows[i + 5, r:n], rows[i + 6, r:n], rows[i + 7, r:n]
    for j in range(len(row)):
        one = (a * s[j] + b * t[j]) + (c * u[j] + d * v[j])
        row[j] += one + ((e * x[j] + f * y[j]) + (g * p[j] + h * q[j]))


@kernel()
def _add_product(
    V: FloatArray, D: FloatArray, r: int, m: int, sign: float, Y: FloatArray, used: int, n: int
) -> None:
    """Add the product of D and sign Y^T Y, of the first `used` rows of Y, to V (2, n)."""
    w = np.empty((2, used))
    for k in range(2):
        for i in range(used):
            w[k, i] = sign * (D[k, r] * Y[i, m] + D[k, r + 1] * Y[i, m + 1])
    x, y, eights = V[0, r:n], V[1, r:n], used // 8 * 8
    for i in range(0, eights, 8):
        _add_eight_rows(x, w[0, i : i + 8], Y, i, r, n)
        _add_eight_rows(y, w[1, i : i + 8], Y, i, r, n)
    for i in range(eights, used - 1, 2):
        _add_two_rows(x, w[0, i], Y[i, r:n], w[0, i + 1], Y[i + 1, r:n])
        _add_two_rows(y, w[1, i], Y[i, r:n], w[1, i + 1], Y[i + 1, r:n])
    if used % 2 == 1:
        _scale_and_add(x, 1.0, w[0, used - 1], Y[used - 1, r:n])
        _scale_and_add(y, 1.0, w[1, used - 1], Y[used - 1, r:n])
