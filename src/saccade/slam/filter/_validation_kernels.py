"""Validation of values and covariances."""

from math import hypot, sqrt

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray

MAX_MAGNITUDE = 1e9
"""Meters or radians; larger numbers are invalid, and their squares might overflow."""
COVARIANCE_ROUNDING = 1e-9
"""Rounding tolerance of a covariance, as a fraction of its largest entry."""


@kernel()
def first_invalid(
    values: FloatArray, covariances: FloatArray, factor: float, min_sigma: float
) -> int:
    """Index of the first invalid one of values (k, c) or covariances (k, c, c), -1 if none is.

    Before, covariances are multiplied by a factor, in place, and singular ones (2, 2) get the
    variance of `min_sigma` in every direction if it is positive. A symmetric matrix plus a multiple
    of the identity has a Cholesky root if and only if no eigenvalue is below minus that multiple.
    """
    k, c = values.shape
    root = np.empty((c, c))
    for n in range(k):
        C, largest = covariances[n], 0.0
        for i in range(c):
            for j in range(c):
                C[i, j] *= factor
        if min_sigma > 0:
            smallest = (C[0, 0] + C[1, 1]) / 2 - hypot((C[0, 0] - C[1, 1]) / 2, C[0, 1])
            if smallest < min_sigma * min_sigma:  # eigenvalue
                C[0, 0] += min_sigma * min_sigma
                C[1, 1] += min_sigma * min_sigma
        for i in range(c):
            for j in range(c):
                if not (
                    abs(C[i, j]) < MAX_MAGNITUDE * MAX_MAGNITUDE
                    and abs(values[n, i]) < MAX_MAGNITUDE
                ):
                    return n
                largest = max(largest, abs(C[i, j]))
        for i in range(c if largest > 0 else 0):
            for j in range(i + 1):
                rest = C[i, j] + (COVARIANCE_ROUNDING * largest if i == j else 0.0)
                if abs(C[i, j] - C[j, i]) > COVARIANCE_ROUNDING * largest:
                    return n
                for m in range(j):
                    rest -= root[i, m] * root[j, m]
                if i > j:
                    root[i, j] = rest / root[j, j]
                elif rest <= 0:
                    return n
                else:
                    root[i, i] = sqrt(rest)
    return -1
