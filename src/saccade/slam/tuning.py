"""Maximum-likelihood noise scales of a log, estimated on its first half and tested on its second.

The factors on the standard deviations of controls and observations that maximize the likelihood
of the filter's innovations: the prediction error decomposition (Schweppe 1965), with a bounded
loss of outliers. Innovations that are correlated in time have a model with other errors than white
noise (Mehra 1970); there the most likely scales describe the noise between one scan and the next,
which is too small for the errors that stay, and the initial scales are kept.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from saccade.errors import LogError
from saccade.slam.config import EkfConfig
from saccade.slam.run import SlamResult, run
from saccade.types import BoolArray, FloatArray, LandmarkLog

STEPS = (2.0, 2.0**0.5, 2.0**0.25)
"""Factors of the coordinate search, from coarse to fine."""
RANGE = (1 / 64, 64.0)
"""Limits of the scales."""
MAX_NIS = 25.0
"""Bound of the loss of an outlier; four in a million of the other innovations are beyond it."""
MIN_INNOVATIONS = 20
"""Innovations that an estimate needs, in either half."""
START_FACTORS = (1.0, 2.0, 4.0, 8.0)
"""Factors on both initial scales, the first of which that has enough innovations is the start."""
ENOUGH = 0.9
"""Innovations that the first of these must have, as a fraction of the most of any."""
MAX_ROUNDS = 4
"""Of association with the scales of the round before."""
MAX_CORRELATION = 0.045
"""Correlation of successive innovations of a landmark up to which they are white, beside one
standard error: -0.03 to 0.06 in simulated worlds with white noise, 0.06 to 0.23 where the odometry
or each range has a bias, 0.2 to 0.7 in recordings of robots."""
MIN_KEPT = 0.98
"""Fraction of the observations used with the initial scales that the estimated ones must use."""
SIGNIFICANT = 3.0
"""Standard errors by which the loss of the second half must fall."""


@dataclass(frozen=True)
class Tuning:
    """Estimated noise scales of a log, and whether its second half confirms them."""

    config: EkfConfig
    """With the estimated scales where they are confirmed, else as it was."""
    estimated: tuple[float, float]
    """Scales of the controls and of the observations that fit the first half."""
    before: float
    """Mean loss of an innovation of the second half with the initial scales: its bounded NIS plus
    the logarithm of its covariance's determinant. NaN where the second half was not tested."""
    after: float
    """With the estimated scales."""
    objection: str
    """Why the estimated scales are not used, in a sentence; empty where they are."""

    @property
    def words(self) -> str:
        """The result in a sentence."""
        motion, sensor = self.estimated
        found = (
            f"the first half of the log says that the deviations of the controls are {motion:.2f} "
            f"and those of the observations {sensor:.2f} times the declared ones"
        )
        if self.objection:
            return f"the noise scales stay as they were: {found}, but {self.objection}"
        return f"{found}; the second half confirms it"


def tune(log: LandmarkLog, config: EkfConfig) -> Tuning:
    """Estimate the noise scales of a log by maximum likelihood.

    They are estimated on the first half of the observations, and used if they hold for the second:
    the likelihood of its innovations is significantly higher than with the initial scales, they are
    uncorrelated, and no fewer observations are used.

    Args:
        log: to be filtered.
        config: the filter, with the initial scales.

    Raises:
        LogError: there are too few innovations, or the filter diverges with the initial scales.
    """
    if len(log.observation) == 0:
        raise LogError("tune: expected observations of landmarks, found none")
    middle = int(log.observation_pose[len(log.observation) // 2])
    first = _first_poses(log, middle)
    found, named = _start(first, config)
    for _ in range(MAX_ROUNDS):
        previous, found = found, _search(named, found)
        again = _named(first, found)
        if found == previous or len(again.landmark) < MIN_KEPT * len(named.landmark):
            break
        named = again
    scales = found.motion_noise_scale, found.sensor_noise_scale
    if found == config:
        return Tuning(config, scales, np.nan, np.nan, "these are the initial scales")
    before, after, objection = _test(log, middle, config, found)
    return Tuning(config if objection else found, scales, before, after, objection)


def _start(log: LandmarkLog, config: EkfConfig) -> tuple[EkfConfig, LandmarkLog]:
    """Settings that associate enough observations, and the log with their association.

    Gates of a noise that is declared far too small reject many: then it is doubled.
    """
    starts, counts = [], []
    for factor in START_FACTORS:
        scales = factor * config.motion_noise_scale, factor * config.sensor_noise_scale
        start = _scaled(config, scales)
        named = _named(log, start)
        nis = _run_known(named, start).consistency.nis
        starts.append((start, named))
        counts.append(int(np.isfinite(nis).sum()))
    if max(counts) < MIN_INNOVATIONS:
        raise LogError(
            f"tune: expected at least {MIN_INNOVATIONS} innovations in the first half of the log, "
            f"found {max(counts)}"
        )
    return starts[int(np.argmax(np.array(counts) >= ENOUGH * max(counts)))]


def _named(log: LandmarkLog, config: EkfConfig) -> LandmarkLog:
    """The observations that a run uses, with its association as identities."""
    association = run(log, config).association
    return _select(replace(log, landmark=association), association >= 0)


def _search(named: LandmarkLog, config: EkfConfig) -> EkfConfig:
    """The scales of the highest likelihood, for a known association."""
    losses: dict[tuple[float, float], float] = {}

    def loss(scales: tuple[float, float]) -> float:
        if scales not in losses:
            losses[scales] = np.inf
            with suppress(LogError):  # diverged
                each = _losses(_run_known(named, _scaled(config, scales)))
                if np.isfinite(each).sum() >= MIN_INNOVATIONS:
                    losses[scales] = float(np.nanmean(each))
        return losses[scales]

    best = config.motion_noise_scale, config.sensor_noise_scale
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
    return _scaled(config, best)


def _test(
    log: LandmarkLog, middle: int, config: EkfConfig, found: EkfConfig
) -> tuple[float, float, str]:
    """Mean losses from the pose `middle` on with two settings, and what speaks against `found`."""
    named, previous = _named(log, found), _named(log, config)
    second = named.observation_pose >= middle
    kept = second.sum() / max((previous.observation_pose >= middle).sum(), 1)
    result = _run_known(named, found)
    before, after = _losses(_run_known(named, config)), _losses(result)
    tested = second & np.isfinite(before) & np.isfinite(after)
    before, after, count = before[tested], after[tested], int(tested.sum())
    if count < MIN_INNOVATIONS:
        return np.nan, np.nan, f"the second has only {count} innovations to test them"
    means = float(before.mean()), float(after.mean())
    if kept < MIN_KEPT:
        return *means, f"with them only {kept:.0%} as many observations of the second are used"
    if means[0] - means[1] <= SIGNIFICANT * (before - after).std() / np.sqrt(count):
        return *means, "they do not fit the second significantly better"
    correlation = innovation_correlation(result)
    if correlation > MAX_CORRELATION + 1 / np.sqrt(2 * len(second)):
        why = f"successive innovations have a correlation of {correlation:.2f} with them"
        return *means, f"{why}: the errors are not white noise"
    return *means, ""


def innovation_correlation(result: SlamResult) -> float:
    """Correlation of successive normalized innovations of the same landmark; 0 if they are white.

    Args:
        result: of a run; innovations longer than 3 sigma are shortened to that.
    """
    used = np.isfinite(result.consistency.nis)
    values, vectors = np.linalg.eigh(result.innovation_covariance[used])
    along = (vectors.transpose(0, 2, 1) @ result.innovation[used, :, None])[..., 0]
    normalized = (vectors @ (along / np.sqrt(values))[..., None])[..., 0]  # S^-1/2 v
    length = np.linalg.norm(normalized, axis=1, keepdims=True)
    normalized *= np.minimum(1.0, 3.0 / np.maximum(length, 3.0))
    landmark = result.association[used]
    order = np.argsort(landmark, kind="stable")
    same = landmark[order][1:] == landmark[order][:-1]
    one, other = normalized[order[:-1][same]], normalized[order[1:][same]]
    size = np.sqrt(np.square(one).sum() * np.square(other).sum())
    return float((one * other).sum() / size) if size > 0 else 0.0


def _run_known(named: LandmarkLog, config: EkfConfig) -> SlamResult:
    return run(named, replace(config, association="known"))


def _scaled(config: EkfConfig, scales: tuple[float, float]) -> EkfConfig:
    return replace(config, motion_noise_scale=scales[0], sensor_noise_scale=scales[1])


def _losses(result: SlamResult) -> FloatArray:
    """(k,) bounded NIS plus log det S of each observation; NaN where it updated nothing."""
    nis = result.consistency.nis
    losses = np.full(len(nis), np.nan)
    used = np.isfinite(nis)
    _, size = np.linalg.slogdet(result.innovation_covariance[used])
    losses[used] = np.minimum(nis[used], MAX_NIS) + size
    return losses


def _first_poses(log: LandmarkLog, count: int) -> LandmarkLog:
    """The log up to a pose; at least the first one."""
    poses = max(count, 1)
    seen = _select(log, log.observation_pose < poses)
    return replace(
        seen,
        time=log.time[:poses],
        control=log.control[: poses - 1],
        control_covariance=log.control_covariance[: poses - 1],
        truth=None,
    )


def _select(log: LandmarkLog, kept: BoolArray) -> LandmarkLog:
    """The log with some of its observations, by a mask (k,)."""
    return replace(
        log,
        observation_pose=log.observation_pose[kept],
        observation=log.observation[kept],
        observation_covariance=log.observation_covariance[kept],
        landmark=log.landmark[kept],
    )
