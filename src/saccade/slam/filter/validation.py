"""Validates inputs before the state changes."""

from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.slam.filter._validation_kernels import MAX_MAGNITUDE, first_invalid
from saccade.types import FloatArray, invalid_range_bearing

MIN_SIGMA = 1e-4
"""Meters and radians: standard deviation added to observations with a singular covariance. Exact
ones would make a filter diverge by its own linearization errors."""


def check_vector(name: str, value: FloatArray, size: int | None = None) -> FloatArray:
    """The numbers as an array (size,), all finite.

    Raises:
        LogError: it has another shape, or a number is not finite or beyond `MAX_MAGNITUDE`.
    """
    array = as_numbers(name, value)
    if array.ndim != 1 or (size is not None and len(array) != size):
        raise LogError(f"{name}: expected {size or 'some'} numbers, found shape {array.shape}")
    if not (np.abs(array) < MAX_MAGNITUDE).all():  # NaN is not under anything
        raise LogError(f"{name}: expected numbers within {MAX_MAGNITUDE:g}, found {array.tolist()}")
    return array


def check_covariance(name: str, value: FloatArray, size: int) -> FloatArray:
    """The matrix as an array (size, size).

    Raises:
        LogError: it is no covariance matrix.
    """
    matrix = as_numbers(name, value)
    if matrix.shape != (size, size):
        raise LogError(f"{name}: expected shape {(size, size)}, found {matrix.shape}")
    if first_invalid(np.zeros((1, size)), matrix[None].copy(), 1.0, 0.0) == 0:
        expected = "a symmetric matrix without negative eigenvalues"
        if not (np.abs(matrix) < MAX_MAGNITUDE**2).all():
            expected = f"numbers within {MAX_MAGNITUDE**2:g}"
        raise LogError(f"{name}: expected {expected}, found {matrix.tolist()}")
    return matrix


def check_gaussian(
    name: str, value: FloatArray, covariance: npt.ArrayLike | None, size: int, factor: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Copies of the numbers (size,) and of their covariance (size, size), times a factor.

    Raises:
        LogError: see `check_vector` and `check_covariance`.
    """
    mean, C = np.array(value), np.array(as_numbers(f"covariance of the {name}", covariance))
    known = mean.shape == (size,) and C.shape == (size, size)
    if not known or first_invalid(mean[None], C[None], factor, 0.0) == 0:
        check_vector(name, mean, size)
        check_covariance(f"covariance of the {name}", C, size)
    return mean, C


def check_all(
    name: str,
    values: FloatArray,
    covariances: FloatArray,
    factor: float = 1.0,
    min_sigma: float = 0.0,
) -> None:
    """Raises for the first invalid one of values (k, c) and their covariances (k, c, c).

    Before, the covariances are multiplied by a factor, in place, and singular ones get the variance
    of `min_sigma` in every direction.
    """
    i = first_invalid(values, covariances, factor, min_sigma)
    if i >= 0:
        check_vector(f"{name} {i}", values[i])
        check_covariance(f"covariance of {name} {i}", covariances[i], values.shape[1])


def check_range_bearing(z: FloatArray) -> None:
    """Raise unless all of (k, 2) are ranges and bearings."""
    invalid = invalid_range_bearing(z)
    if invalid is not None:
        number, expected, found = invalid
        raise LogError(f"observation {number}: expected {expected}, found {found}")


def as_numbers(name: str, value: object) -> FloatArray:
    """The numbers as an array; None is NaN."""
    try:
        return np.asarray(np.nan if value is None else value, np.float64)
    except (TypeError, ValueError) as error:
        found = " ".join(repr(value).split())[:60]
        raise LogError(f"{name}: expected numbers, found {found}") from error


def as_array(name: str, shape: tuple[int, ...], value: object) -> FloatArray:
    """The numbers as an array of this shape; None, or an empty list, for none."""
    array = as_numbers(name, value)
    if 0 in shape and (value is None or array.size == 0):
        return np.empty(shape)
    require_shape(name, shape, array)
    return array


def require_shape(name: str, shape: tuple[int, ...], array: npt.NDArray[Any]) -> None:
    """Raise unless an array has this shape."""
    if array.shape != shape:
        raise LogError(f"{name}: expected shape {shape}, found {array.shape}")


def as_number(name: str, value: object) -> float:
    """The finite number."""
    number = as_array(name, (), value).item()
    if not isfinite(number):
        raise LogError(f"{name}: expected finite numbers, found {number}")
    return number
