"""How large the noise of a log is, as its own innovations say.

Of all factors on the deviations of controls and observations, those under which the innovations
of the filter are the likeliest: the prediction error decomposition of the likelihood
(Schweppe 1965), in which a wrong observation counts no more than one that is barely possible.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from saccade.errors import LogError
from saccade.slam.run import EkfConfig, run
from saccade.types import LandmarkLog

STEPS = (2.0, 2.0**0.5, 2.0**0.25)
"""Factors by which the scales are changed, until none of them helps."""
RANGE = (1 / 64, 64.0)
"""Of the scales."""
LARGEST = 25.0
"""Normalized square of an innovation beyond which it is wrong, and it is all the same by how
much; of right ones that far are four in a million."""
FEWEST = 20
"""Innovations that say something about noise."""


@dataclass(frozen=True)
class Tuning:
    """The noise that a log turned out to have."""

    config: EkfConfig
    """With the scales found."""
    before: float
    """Mean loss of an innovation with the scales that were given: its robust normalized square,
    and the logarithm of its covariance's determinant."""
    after: float
    """With the scales found; never larger."""

    @property
    def words(self) -> str:
        """What was found, in a sentence."""
        found = self.config.motion_noise_scale, self.config.sensor_noise_scale
        return (
            f"the innovations say that the deviations of the controls are {found[0]:.2f} and "
            f"those of the observations {found[1]:.2f} times what the log says"
        )


def tune(log: LandmarkLog, config: EkfConfig) -> Tuning:
    """Find the noise scales under which a log is the likeliest.

    The association is that of the filter with the scales given.

    Args:
        log: to be filtered.
        config: where the search begins.

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
            least = min([best, *inside], key=loss)
            if not loss(least) < loss(best):
                break
            best = least
    found = replace(config, motion_noise_scale=best[0], sensor_noise_scale=best[1])
    return Tuning(found, loss(first), loss(best))


def _loss(log: LandmarkLog, config: EkfConfig) -> float:
    """Mean of Huber's loss of the innovations and of log det S."""
    if not (log.landmark >= 0).any():
        raise LogError("tune: expected observations of landmarks, found none that could be used")
    result = run(log, config)
    nis = result.consistency.nis
    used = np.isfinite(nis)
    if used.sum() < FEWEST:
        raise LogError(f"tune: expected at least {FEWEST} innovations, found {int(used.sum())}")
    robust = np.minimum(nis[used], LARGEST)
    _, size = np.linalg.slogdet(result.innovation_covariance[used])
    return float((robust + size).mean())
