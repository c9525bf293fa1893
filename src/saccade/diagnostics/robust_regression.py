"""Robust linear regression: least squares with iterated rejection of outliers."""

from dataclasses import dataclass

import numpy as np

from saccade.types import FloatArray

MAX_ITERATIONS = 10
INLIER_SIGMAS = 3.0
"""Standard deviations of the residual within which a sample is an inlier."""
TRUNCATED_SIGMA = 0.987
"""Standard deviation of a standard normal variable truncated there."""
SIGNIFICANT_SIGMAS = 4.0
"""Standard errors by which a coefficient must differ to be significant."""


@dataclass(frozen=True, eq=False)
class Fit:
    """y = A @ value."""

    value: FloatArray
    """(c,) coefficients."""
    error: FloatArray
    """(c,) their standard errors."""
    sigma: float
    """Standard deviation of the residuals of the inliers."""

    def differs(self, index: int, expected: float, tolerance: float) -> bool:
        """Whether a coefficient is significantly, and by more than a tolerance, not as expected."""
        difference = abs(self.value[index] - expected)
        return bool(difference > max(tolerance, SIGNIFICANT_SIGMAS * self.error[index]))


def fit(A: FloatArray, y: FloatArray) -> Fit | None:
    """Fit c coefficients to n samples; None where there are too few.

    Args:
        A: (n, c).
        y: (n,).
    """
    c = A.shape[1]
    if len(y) < 5 * c:
        return None
    inlier = np.ones(len(y), bool)
    for _ in range(MAX_ITERATIONS):
        value, *_ = np.linalg.lstsq(A[inlier], y[inlier], rcond=None)
        residual = np.abs(y - A @ value)
        sigma = 1.4826 * float(np.median(residual)) + 1e-12
        inlier = residual < INLIER_SIGMAS * sigma
        if inlier.sum() < 3 * c:
            return None
    information = A[inlier].T @ A[inlier]
    if np.linalg.cond(information) > 1e12:
        return None
    dof = int(inlier.sum()) - c
    sigma = float(np.sqrt(np.square(residual[inlier]).sum() / dof)) / TRUNCATED_SIGMA
    error = sigma * np.sqrt(np.diagonal(np.linalg.inv(information)))
    return Fit(np.asarray(value), np.asarray(error), sigma)
