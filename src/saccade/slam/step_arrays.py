"""Arrays of steps: validated input, and room for results."""

import numpy as np

from saccade.errors import LogError
from saccade.slam._step_kernels import StepResults
from saccade.slam.filter.ekf import new_innovations
from saccade.types import FloatArray

MIN_SIGMA = 1e-4
"""Metres and radians: standard deviation added to observations with a singular covariance. Exact
ones would make a filter diverge by its own linearization errors."""


def new_results(t: int, k: int) -> StepResults:
    """Room for the results of so many steps and observations."""
    lost = np.zeros(t, np.bool_)
    return StepResults(np.empty((t, 3)), np.empty((t, 3, 3)), new_innovations(k), lost)


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
