"""A line through points of which some are wrong."""

from dataclasses import dataclass

import numpy as np

from saccade.types import FloatArray

ROUNDS = 10
"""In which those that are near are chosen anew."""
NEAR = 3.0
"""Standard deviations within which a point counts."""
WITHIN = 0.987
"""Standard deviation of a normal number that is cut off there."""


@dataclass(frozen=True, eq=False)
class Fit:
    """y = A @ value."""

    value: FloatArray
    """(c,)."""
    error: FloatArray
    """(c,) its standard errors."""
    sigma: float
    """Standard deviation of what is left, of the points that agree."""

    def differs(self, index: int, expected: float, least: float) -> bool:
        """Whether a value is off by more than `least`, and more than chance lets it be."""
        apart = abs(self.value[index] - expected)
        return bool(apart > max(least, 4 * self.error[index]))


def fit(A: FloatArray, y: FloatArray) -> Fit | None:
    """Least squares over the points that agree; None where there are too few.

    Args:
        A: (n, c).
        y: (n,).
    """
    columns = A.shape[1]
    if len(y) < 5 * columns:
        return None
    near = np.ones(len(y), bool)
    for _ in range(ROUNDS):
        value, *_ = np.linalg.lstsq(A[near], y[near], rcond=None)
        rest = np.abs(y - A @ value)
        sigma = 1.4826 * float(np.median(rest)) + 1e-12
        near = rest < NEAR * sigma
        if near.sum() < 3 * columns:
            return None
    information = A[near].T @ A[near]
    if np.linalg.cond(information) > 1e12:
        return None
    freedom = int(near.sum()) - columns
    sigma = float(np.sqrt(np.square(rest[near]).sum() / freedom)) / WITHIN
    error = sigma * np.sqrt(np.diagonal(np.linalg.inv(information)))
    return Fit(np.asarray(value), np.asarray(error), sigma)
