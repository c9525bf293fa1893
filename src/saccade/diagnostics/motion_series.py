"""Time series of steps: motion of the camera beside odometry."""

from dataclasses import dataclass

import numpy as np

from saccade.diagnostics.survey import Survey
from saccade.frames import Drive
from saccade.types import BoolArray, FloatArray

MIN_STEPS = 20
"""Steps from which odometry and images are compared."""
MAX_LAG = 1.0
"""Seconds between two clocks that are tried."""


@dataclass(frozen=True, eq=False)
class MotionSeries:
    """k steps of which both motions are known, in order."""

    duration: FloatArray
    """(k,) seconds."""
    rotation: FloatArray
    """(k, 3) by the images, as that of `CameraMotion`."""
    translation: FloatArray
    """(k, 3) by the images, in metres; of the length of odometry where they do not measure it."""
    metric: bool
    """Whether the images measure the length."""
    odometry: FloatArray
    """(k, 3) metres ahead and left, radians turned."""
    covariance: FloatArray
    """(k, 3, 3) of the odometry."""

    def __len__(self) -> int:
        return len(self.duration)

    @property
    def moving(self) -> BoolArray:
        """(k,) whether the robot drives, rather than stands or turns on the spot."""
        length = np.hypot(self.odometry[:, 0], self.odometry[:, 1])
        return np.asarray(length > 0.3 * (np.quantile(length, 0.9) if len(length) else 0.0))


def series_of(drive: Drive, survey: Survey) -> MotionSeries:
    """The steps of a drive that were surveyed; none where it has no odometry."""
    known = survey.frame > 0
    known &= np.isfinite(survey.rotation).all(1) & np.isfinite(survey.translation).all(1)
    metric = bool(survey.metric[known].mean() > 0.5) if known.any() else False
    known &= (survey.metric == metric) & has_odometry(drive)
    step = survey.frame[known] - 1
    odometry, translation = drive.control[step], survey.translation[known]
    if not metric:
        translation = translation * np.hypot(odometry[:, 0], odometry[:, 1])[:, None]
    return MotionSeries(
        duration=np.diff(drive.time)[step],
        rotation=survey.rotation[known],
        translation=translation,
        metric=metric,
        odometry=odometry,
        covariance=drive.control_covariance[step],
    )


def has_odometry(drive: Drive) -> bool:
    """Whether there are translations or turns."""
    return bool(drive.control.any())


@dataclass(frozen=True)
class Lag:
    """Offset between two clocks."""

    frames: int
    """By which odometry is later than the images."""
    correlation: float
    """Of both turns at this lag, -1 to 1."""
    present_correlation: float
    """Without a lag."""


def lag_of(drive: Drive, survey: Survey) -> Lag | None:
    """The lag at which turns by odometry and images correlate best; None where nothing turns."""
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
