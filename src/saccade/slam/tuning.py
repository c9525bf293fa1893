"""Maximum-likelihood noise scales of a log.

The factors on the standard deviations of controls and observations that maximize the likelihood
of the filter's innovations: the prediction error decomposition (Schweppe 1965), with a bounded
loss of outliers.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from saccade.errors import LogError
from saccade.slam.config import EkfConfig
from saccade.slam.run import run
from saccade.types import LandmarkLog

STEPS = (2.0, 2.0**0.5, 2.0**0.25)
"""Factors of the coordinate search, from coarse to fine."""
RANGE = (1 / 64, 64.0)
"""Limits of the scales."""
MAX_NIS = 25.0
"""Bound of the loss of an outlier; four in a million of the other innovations are beyond it."""
MIN_INNOVATIONS = 20
"""Innovations that an estimate needs."""


@dataclass(frozen=True)
class Tuning:
    """Estimated noise scales of a log."""

    config: EkfConfig
    """With the estimated scales."""
    before: float
    """Mean loss of an innovation with the initial scales: its bounded NIS plus the logarithm of its
    covariance's determinant."""
    after: float
    """With the estimated scales; never larger."""

    @property
    def words(self) -> str:
        """The result in a sentence."""
        found = self.config.motion_noise_scale, self.config.sensor_noise_scale
        return (
            f"the innovations say that the deviations of the controls are {found[0]:.2f} and "
            f"those of the observations {found[1]:.2f} times what the log says"
        )


def tune(log: LandmarkLog, config: EkfConfig) -> Tuning:
    """Estimate the noise scales of a log by maximum likelihood.

    The association is that of the filter with the initial scales.

    Args:
        log: to be filtered.
        config: the filter, with the initial scales.

    Raises:
        LogError: there are too few innovations.
    """
    association = run(log, config).association
    named = replace(log, landmark=association)
    known = replace(config, association="known")
    losses: dict[tuple[float, float], float] = {}

    def loss(scales: tuple[float, float]) -> float:
        if scales not in losses:
            motion, sensor = scales
            changed = replace(known, motion_noise_scale=motion, sensor_noise_scale=sensor)
            losses[scales] = _loss(named, changed)
        return losses[scales]

    best = first = config.motion_noise_scale, config.sensor_noise_scale
    for step in STEPS:
        while True:
            around = [
                (best[0] * step**i, best[1] * step**j) for i, j in product((-1, 0, 1), repeat=2)
            ]
            inside = [s for s in around if all(RANGE[0] <= x <= RANGE[1] for x in s)]
            candidate = min([best, *inside], key=loss)
            if not loss(candidate) < loss(best):
                break
            best = candidate
    found = replace(config, motion_noise_scale=best[0], sensor_noise_scale=best[1])
    return Tuning(found, loss(first), loss(best))


def _loss(log: LandmarkLog, config: EkfConfig) -> float:
    """Mean of the bounded NIS and of log det S."""
    if not (log.landmark >= 0).any():
        raise LogError("tune: expected observations of landmarks, found none that could be used")
    result = run(log, config)
    nis = result.consistency.nis
    used = np.isfinite(nis)
    if used.sum() < MIN_INNOVATIONS:
        raise LogError(
            f"tune: expected at least {MIN_INNOVATIONS} innovations, found {int(used.sum())}"
        )
    robust = np.minimum(nis[used], MAX_NIS)
    _, size = np.linalg.slogdet(result.innovation_covariance[used])
    return float((robust + size).mean())
