"""Camera motion beside odometry, step by step, and robust regression between the two."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saccade.diagnostics.survey import Survey
from saccade.frames import Drive
from saccade.types import BoolArray, FloatArray
from saccade.visual.tables import Table, column

MIN_STEPS = 20
"""Steps from which odometry and images are compared."""
MAX_LAG = 1.0
"""Largest offset between the two clocks that is tried, in seconds."""
MAX_ITERATIONS, INLIER_SIGMAS = 10, 3.0
"""Robust regression: standard deviations of the residual within which a sample is an inlier."""
TRUNCATED_SIGMA = 0.987
"""Standard deviation of a standard normal variable truncated at `INLIER_SIGMAS`."""
SIGNIFICANT_SIGMAS = 4.0
"""Standard errors of a coefficient that make a difference significant."""


@dataclass(frozen=True, eq=False)
class MotionSeries(Table):
    """k steps between successive frames in which both motions are known, in order."""

    duration: FloatArray = column()
    """(k,) seconds."""
    rotation: FloatArray = column(3)
    """(k, 3) by the images, as `Survey.rotation`."""
    translation: FloatArray = column(3)
    """(k, 3) by the images, in metres; scaled by odometry where they do not measure the length."""
    metric: BoolArray = column(dtype=np.bool_)
    """(k,) whether the images measure the length; the same in all steps."""
    odometry: FloatArray = column(3)
    """(k, 3) metres ahead and left, radians turned."""
    covariance: FloatArray = column(3, 3)
    """(k, 3, 3) covariances of odometry."""

    @property
    def moving(self) -> "MotionSeries":
        """The steps in which the robot drives, rather than stands or turns on the spot."""
        length = np.hypot(self.odometry[:, 0], self.odometry[:, 1])
        return self[length > 0.3 * (np.quantile(length, 0.9) if len(length) else 0.0)]


def series_of(drive: Drive, survey: Survey) -> MotionSeries:
    """The surveyed steps of a drive; none where it has no odometry."""
    known = survey.frame > 0
    known &= np.isfinite(survey.rotation).all(1) & np.isfinite(survey.translation).all(1)
    metric = bool(survey.metric[known].mean() > 0.5) if known.any() else False
    known &= (survey.metric == metric) & bool(drive.control.any())
    step = survey.frame[known] - 1
    odometry, translation = drive.control[step], survey.translation[known]
    if not metric:
        translation = translation * np.hypot(odometry[:, 0], odometry[:, 1])[:, None]
    return MotionSeries(
        *(np.diff(drive.time)[step], survey.rotation[known], translation, survey.metric[known]),
        *(odometry, drive.control_covariance[step]),
    )


class Lag(NamedTuple):
    """Offset between two clocks."""

    frames: int
    """Frames by which odometry is later than the images."""
    correlation: float
    """Correlation of both turns at this lag, -1 to 1."""
    correlation_without: float
    """Correlation at lag 0."""


def lag_of(drive: Drive, survey: Survey) -> Lag | None:
    """The lag of the highest correlation between turns of odometry and images.

    None where the robot does not turn.
    """
    turn = np.full(len(drive) - 1, np.nan)
    turn[survey.frame[survey.frame > 0] - 1] = survey.rotation[survey.frame > 0, 2]
    duration = np.diff(drive.time)
    period = float(np.median(duration)) if len(duration) else 0.0
    if period <= 0:
        return None
    duration = np.maximum(duration, period / 2)
    rates = turn / duration, drive.control[:, 2] / duration
    longest = int(np.clip(round(MAX_LAG / period), 2, max(len(turn) // 5, 2)))
    lags = range(-longest, longest + 1)
    correlations = [_correlation(*rates, lag) for lag in lags]
    if not np.isfinite(correlations).all():
        return None
    best = int(np.argmax(np.abs(correlations)))
    return Lag(lags[best], correlations[best], correlations[longest])


def _correlation(turn: FloatArray, odometry: FloatArray, lag: int) -> float:
    """Correlation of turn rates with those of odometry `lag` steps later, without outliers."""
    n = len(turn)
    first, second = turn[max(0, -lag) : n - max(0, lag)], odometry[max(0, lag) : n + min(0, lag)]
    known = np.isfinite(first)
    if known.sum() < MIN_STEPS:
        return float("nan")
    a, b = (np.clip(x, *np.quantile(x, [0.005, 0.995])) for x in (first[known], second[known]))
    if a.std() == 0 or b.std() == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of y = A @ value."""

    value: FloatArray
    """(c,) coefficients."""
    error: FloatArray
    """(c,) their standard errors."""
    sigma: float
    """Standard deviation of the residuals of the inliers."""

    def differs(self, index: int, expected: float, tolerance: float) -> bool:
        """Whether a coefficient deviates significantly, and by more than a tolerance."""
        difference = abs(self.value[index] - expected)
        return bool(difference > max(tolerance, SIGNIFICANT_SIGMAS * self.error[index]))


def fit(A: FloatArray, y: FloatArray) -> Fit | None:
    """Least squares with iterated rejection of outliers: y (n,) = A (n, c) @ value (c,).

    None where there are too few samples or inliers, or A is singular.
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
