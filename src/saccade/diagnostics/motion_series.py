"""Odometry beside what the images say, step by step."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from saccade.diagnostics.survey import Survey
from saccade.frames import Drive
from saccade.types import FloatArray, IntArray

LATEST = 1.0
"""Seconds by which two clocks may be apart and still be compared."""


@dataclass(frozen=True, eq=False)
class Series:
    """k steps of which both are known, in their order."""

    frame: IntArray
    """(k,) to which each step leads."""
    duration: FloatArray
    """(k,) seconds."""
    rotation: FloatArray
    """(k, 3) by the images, as `Motion.turn`."""
    translation: FloatArray
    """(k, 3) by the images, in metres; where they do not tell the length, that of odometry."""
    metric: bool
    """Whether the images tell the length."""
    odometry: FloatArray
    """(k, 3) metres ahead and left, radians turned."""
    covariance: FloatArray
    """(k, 3, 3) of the odometry."""

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        """(k,) whether the robot drives, rather than stands or turns on the spot."""
        length = np.hypot(self.odometry[:, 0], self.odometry[:, 1])
        return np.asarray(length > 0.3 * (np.quantile(length, 0.9) if len(length) else 0.0))


def series_of(drive: Drive, survey: Survey) -> Series:
    """The steps of a drive that were looked at; none where it has no odometry."""
    known = survey.frame > 0
    known &= np.isfinite(survey.rotation).all(1) & np.isfinite(survey.translation).all(1)
    metric = bool(survey.metric[known].mean() > 0.5) if known.any() else False
    known &= survey.metric == metric
    if not has_odometry(drive):
        known &= False
    step = survey.frame[known] - 1
    odometry = drive.control[step]
    way = survey.translation[known]
    if not metric:
        way = way * np.hypot(odometry[:, 0], odometry[:, 1])[:, None]
    return Series(
        frame=survey.frame[known],
        duration=np.diff(drive.time)[step],
        rotation=survey.rotation[known],
        translation=way,
        metric=metric,
        odometry=odometry,
        covariance=drive.control_covariance[step],
    )


def has_odometry(drive: Drive) -> bool:
    """Whether anything is known of ways or turns."""
    return bool(drive.control.any())


@dataclass(frozen=True)
class Lag:
    """How two clocks fit."""

    frames: int
    """By which odometry comes later than the images."""
    agreement: float
    """Correlation of both turns at this lag, -1 to 1."""
    agreement_now: float
    """Correlation as they are."""


def lag_of(drive: Drive, survey: Survey) -> Lag | None:
    """Where the turns of odometry and of the images fit best; None where nothing turns."""
    at = {int(i): k for k, i in enumerate(survey.frame)}
    seen = np.full(len(drive) - 1, np.nan)
    for i, k in at.items():
        if i > 0:
            seen[i - 1] = survey.rotation[k, 2]
    duration = np.diff(drive.time)
    period = float(np.median(duration)) if len(duration) else 0.0
    if period <= 0:
        return None
    rates = (
        seen / np.maximum(duration, period / 2),
        drive.control[:, 2] / np.maximum(duration, period / 2),
    )
    most = int(np.clip(round(LATEST / period), 2, max(len(seen) // 5, 2)))
    lags = range(-most, most + 1)
    fits = [_agreement(*rates, lag) for lag in lags]
    if not np.isfinite(fits).all():
        return None
    best = int(np.argmax(np.abs(fits)))
    return Lag(lags[best], fits[best], fits[most])


def _agreement(seen: FloatArray, odometry: FloatArray, lag: int) -> float:
    """Correlation of what was seen with the odometry of `lag` steps later."""
    n = len(seen)
    first, second = seen[max(0, -lag) : n - max(0, lag)], odometry[max(0, lag) : n + min(0, lag)]
    both = np.isfinite(first)
    if both.sum() < 20:
        return float("nan")
    a, b = (np.clip(x, *np.quantile(x, [0.005, 0.995])) for x in (first[both], second[both]))
    if a.std() == 0 or b.std() == 0:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])
