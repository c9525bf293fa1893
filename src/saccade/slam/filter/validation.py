"""What is no measurement is refused before it changes anything."""

from math import sqrt

import numpy as np

from saccade._jit import kernel
from saccade.errors import LogError
from saccade.types import FloatArray

LARGEST = 1e9
"""Metres or radians; numbers beyond it are no measurements, and their squares may overflow."""
SLACK = 1e-9
"""Share of its largest entry by which rounding may take a covariance from being one."""


def check_vector(name: str, value: FloatArray, size: int | None = None) -> FloatArray:
    """The numbers as an array, if they are as many as they should be, and finite."""
    array = np.asarray(value, np.float64)
    if array.ndim != 1 or (size is not None and len(array) != size):
        raise LogError(f"{name}: expected {size or 'some'} numbers, found shape {array.shape}")
    if not (np.abs(array) < LARGEST).all():  # NaN is not under anything
        raise LogError(f"{name}: expected numbers within {LARGEST:g}, found {array.tolist()}")
    return array


def check_covariance(name: str, value: FloatArray, size: int) -> FloatArray:
    """The matrix as an array, if it is a covariance (size, size)."""
    matrix = np.asarray(value, np.float64)
    if matrix.shape != (size, size):
        raise LogError(f"{name}: expected shape {(size, size)}, found {matrix.shape}")
    if not (np.abs(matrix) < LARGEST**2).all():
        raise LogError(f"{name}: expected numbers within {LARGEST**2:g}, found {matrix.tolist()}")
    if _first_bad(np.zeros((1, size)), matrix[None]) == 0:
        raise LogError(
            f"{name}: expected a symmetric matrix without negative eigenvalues, "
            f"found {matrix.tolist()}"
        )
    return matrix


def check_all(name: str, values: FloatArray, covariances: FloatArray) -> None:
    """Raise for the first of values (k, c) and their covariances (k, c, c) that is none."""
    bad = _first_bad(values, covariances)
    if bad >= 0:
        check_vector(f"{name} {bad}", values[bad])
        check_covariance(f"covariance of {name} {bad}", covariances[bad], values.shape[1])


def check_landmark(landmark: int, count: int) -> None:
    """Raise unless it is one of so many."""
    if not 0 <= landmark < count:
        raise LogError(
            f"landmark: expected a number from 0 to {count - 1} of a map of "
            f"{count} landmarks, found {landmark}"
        )


@kernel()
def _first_bad(values: FloatArray, covariances: FloatArray) -> int:
    """The first of values (k, c) or covariances (k, c, c) that is none, -1 where all are fine.

    A symmetric matrix with a little on its diagonal has a Cholesky root if and only if no
    eigenvalue is under minus that little.
    """
    k, c = values.shape
    root = np.empty((c, c))
    for n in range(k):
        largest = 0.0
        for i in range(c):
            if not abs(values[n, i]) < LARGEST:
                return n
            for j in range(c):
                if not abs(covariances[n, i, j]) < LARGEST * LARGEST:
                    return n
                largest = max(largest, abs(covariances[n, i, j]))
        if largest == 0:
            continue
        for i in range(c):
            for j in range(i + 1):
                rest = covariances[n, i, j] + (SLACK * largest if i == j else 0.0)
                if abs(covariances[n, i, j] - covariances[n, j, i]) > SLACK * largest:
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
