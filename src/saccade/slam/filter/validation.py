"""Validates inputs before the state changes."""

import numpy as np

from saccade.errors import LogError
from saccade.slam.filter._validation_kernels import LARGEST, first_invalid
from saccade.types import FloatArray

MIN_SIGMA = 1e-4
"""Metres and radians: standard deviation added to observations with a singular covariance. Exact
ones would make a filter diverge by its own linearization errors."""


def check_vector(name: str, value: FloatArray, size: int | None = None) -> FloatArray:
    """The numbers as an array (size,), all finite.

    Raises:
        LogError: it has another shape, or a number is not finite or beyond `LARGEST`.
    """
    array = np.asarray(value, np.float64)
    if array.ndim != 1 or (size is not None and len(array) != size):
        raise LogError(f"{name}: expected {size or 'some'} numbers, found shape {array.shape}")
    if not (np.abs(array) < LARGEST).all():  # NaN is not under anything
        raise LogError(f"{name}: expected numbers within {LARGEST:g}, found {array.tolist()}")
    return array


def check_covariance(name: str, value: FloatArray, size: int) -> FloatArray:
    """The matrix as an array (size, size).

    Raises:
        LogError: it is no covariance matrix.
    """
    matrix = np.asarray(value, np.float64)
    if matrix.shape != (size, size):
        raise LogError(f"{name}: expected shape {(size, size)}, found {matrix.shape}")
    if not (np.abs(matrix) < LARGEST**2).all():
        raise LogError(f"{name}: expected numbers within {LARGEST**2:g}, found {matrix.tolist()}")
    if first_invalid(np.zeros((1, size)), matrix[None]) == 0:
        raise LogError(
            f"{name}: expected a symmetric matrix without negative eigenvalues, "
            f"found {matrix.tolist()}"
        )
    return matrix


def check_all(name: str, values: FloatArray, covariances: FloatArray) -> None:
    """Raise for the first invalid one of values (k, c) and their covariances (k, c, c)."""
    i = first_invalid(values, covariances)
    if i >= 0:
        check_vector(f"{name} {i}", values[i])
        check_covariance(f"covariance of {name} {i}", covariances[i], values.shape[1])


def check_landmark(landmark: int, count: int) -> None:
    """Raise unless it is the number of a landmark in a map of `count`."""
    if not 0 <= landmark < count:
        raise LogError(
            f"landmark: expected a number from 0 to {count - 1} of a map of "
            f"{count} landmarks, found {landmark}"
        )


def as_array(name: str, shape: tuple[int, ...], value: object) -> FloatArray:
    """The finite numbers as an array of this shape; None for none."""
    if value is None and 0 in shape:
        return np.empty(shape)
    array = np.asarray(np.nan if value is None else value, np.float64)
    if array.ndim == len(shape) - 1 and shape[0] == 1:
        array = array[None]
    if array.shape != shape:
        raise LogError(f"{name}: expected shape {shape}, found {array.shape}")
    if not np.isfinite(array).all():
        raise LogError(f"{name}: expected finite numbers, found {array.tolist()}")
    return array


def regularized(R: FloatArray) -> FloatArray:
    """Covariances (k, 2, 2), singular ones with `MIN_SIGMA` in every direction."""
    a, b, d = R[:, 0, 0], R[:, 0, 1], R[:, 1, 1]
    smallest = (a + d) / 2 - np.hypot((a - d) / 2, b)  # eigenvalue
    return R + MIN_SIGMA**2 * (smallest < MIN_SIGMA**2)[:, None, None] * np.eye(2)
