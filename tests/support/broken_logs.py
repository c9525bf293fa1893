"""Small logs of every kind of motion and sensor, with one or two defects."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from saccade import slam
from saccade.errors import LogError
from saccade.types import LandmarkLog
from support.logs import with_observations

STEP_SIGMA, SIGMA = np.array([0.01, 0.002, 0.004]), np.array([0.05, 0.02])
MOTIONS = {
    "curve": (0.1, 0.04),
    "line": (0.1, 0.0),
    "rest": (0.0, 0.0),
    "turn": (0.0, 0.1),
    "slow": (1e-4, 1e-5),
}
"""Meters and radians per step."""


def world(rng, motion, steps, tags, reach, labeled):
    """A log among random landmarks; without noise of what does not move."""
    forward, turn = MOTIONS[motion]
    u = (
        np.tile([forward, 0.0, turn], (steps - 1, 1))
        * (1 + 0.3 * np.sin(np.arange(steps - 1) / 17))[:, None]
    )
    pose = [np.zeros(3)]
    for each in u:
        pose.append(slam.compose(pose[-1], each)[0])
    pose, places = np.array(pose), rng.uniform(-6, 9, (tags, 2))
    z = np.array([slam.observe(each, places)[0] for each in pose])
    row, tag = np.nonzero((z[..., 0] < reach) & (np.abs(z[..., 1]) < 1.6))
    still = (u != 0).any(1)[:, None]
    return LandmarkLog(
        name="world",
        start=np.zeros(3),
        time=np.arange(steps) / 5.0,
        motion="compose",
        control=u + still * STEP_SIGMA * rng.standard_normal(u.shape),
        control_covariance=np.tile(np.diag(STEP_SIGMA**2), (steps - 1, 1, 1)),
        observation_pose=row,
        observation=np.abs(z[row, tag] + SIGMA * rng.standard_normal((len(row), 2))) * [1, 0]
        + (z[row, tag] + SIGMA * rng.standard_normal((len(row), 2))) * [0, 1],
        observation_covariance=np.tile(np.diag(SIGMA**2), (len(row), 1, 1)),
        landmark=tag if labeled else np.full(len(row), -1),
    )


class Defect(NamedTuple):
    """A defect of a log."""

    make: Callable[[LandmarkLog, np.random.Generator], LandmarkLog]
    found: bool = False
    """Whether it must be found in a long log among many labeled landmarks."""


def controls(change):
    """The log with other controls, given the controls and chance."""
    return lambda log, rng: replace(log, control=change(log.control.copy(), rng))


def observations(change):
    return lambda log, rng: replace(log, observation=change(log.observation.copy(), rng))


def labels(change):
    return lambda log, rng: replace(log, landmark=change(log.landmark.copy(), rng))


def with_first(u, value):
    u[:1] = value
    return u


def with_one(u, rng, value):
    u[rng.integers(len(u)) if len(u) else slice(0)] = value
    return u


def single(log, rng):
    """Nothing but the first pose."""
    kept = with_observations(log, log.observation_pose == 0)
    return replace(
        kept,
        time=log.time[:1],
        control=log.control[:0],
        control_covariance=log.control_covariance[:0],
    )


def gap(log, rng):
    """No observations for a third of the log."""
    n = len(log.time)
    return with_observations(
        log, (log.observation_pose < n / 3) | (log.observation_pose > 2 * n / 3)
    )


DEFECTS = {
    "none": Defect(lambda log, rng: log),
    "no turn": Defect(controls(lambda u, rng: u * [1, 1, 0])),
    "no motion": Defect(controls(lambda u, rng: 0 * u)),
    "turns mirrored": Defect(controls(lambda u, rng: u * [1, 1, -1]), True),
    "backward": Defect(controls(lambda u, rng: u * [-1, 1, 1]), True),
    "odometry in mm": Defect(controls(lambda u, rng: u * [1000, 1000, 1]), True),
    "odometry in cm": Defect(controls(lambda u, rng: u * [100, 100, 1]), True),
    "turns in degrees": Defect(controls(lambda u, rng: u * [1, 1, 57.3]), True),
    "absolute poses": Defect(controls(lambda u, rng: np.cumsum(u, 0)), True),
    "first increment": Defect(controls(lambda u, rng: with_first(u, [5.0, 5.0, 2.0]))),
    "one jump": Defect(controls(lambda u, rng: with_one(u, rng, [1000.0, 0.0, 0.0]))),
    "large jump": Defect(controls(lambda u, rng: with_one(u, rng, [0.0, 3e4, 3.0]))),
    "ranges in mm": Defect(observations(lambda z, rng: z * [1000, 1]), True),
    "ranges in cm": Defect(observations(lambda z, rng: z * [100, 1]), True),
    "bearings mirrored": Defect(observations(lambda z, rng: z * [1, -1]), True),
    "bearings constant": Defect(observations(lambda z, rng: z * [1, 0])),
    "bearings by chance": Defect(
        observations(lambda z, rng: np.stack([z[:, 0], rng.uniform(-3, 3, len(z))], 1)), True
    ),
    "ranges constant": Defect(observations(lambda z, rng: z * [0, 1] + np.array([2, 0]))),
    "no ranges": Defect(observations(lambda z, rng: z + np.array([np.nan, 0]))),
    "no bearings": Defect(observations(lambda z, rng: z + np.array([0, np.nan]))),
    "not a number": Defect(observations(lambda z, rng: with_one(z, rng, np.nan))),
    "labels shuffled": Defect(labels(lambda n, rng: rng.permutation(n)), True),
    "one label": Defect(labels(lambda n, rng: 0 * n), True),
    "labels count": Defect(labels(lambda n, rng: np.arange(len(n)))),
    "half without": Defect(labels(lambda n, rng: np.where(rng.random(len(n)) < 0.5, -1, n))),
    "misread": Defect(labels(lambda n, rng: np.where(rng.random(len(n)) < 0.1, n[::-1], n))),
    "order reversed": Defect(
        lambda log, rng: replace(log, observation_pose=log.observation_pose[::-1].copy())
    ),
    "time backward": Defect(lambda log, rng: replace(log, time=log.time[::-1].copy())),
    "time stands": Defect(lambda log, rng: replace(log, time=0 * log.time)),
    "no covariance": Defect(
        lambda log, rng: replace(log, control_covariance=0 * log.control_covariance)
    ),
    "no noise": Defect(
        lambda log, rng: replace(log, observation_covariance=0 * log.observation_covariance)
    ),
    "huge covariance": Defect(
        lambda log, rng: replace(log, control_covariance=1e12 * log.control_covariance)
    ),
    "pushed": Defect(controls(lambda u, rng: with_one(u, rng, [9.0, 4.0, 1.5]))),
    "gap": Defect(gap),
    "one pose": Defect(single),
    "one landmark": Defect(
        lambda log, rng: with_observations(log, log.landmark == log.landmark.max(initial=0))
    ),
    "one observation": Defect(
        lambda log, rng: with_observations(log, np.arange(len(log.landmark)) == 0)
    ),
    "no observation": Defect(
        lambda log, rng: with_observations(log, np.zeros(len(log.landmark), bool))
    ),
}


def broken_log(seed):
    """A log, the names of its defects, and whether one of them must be found; or the refusal."""
    rng = np.random.default_rng(seed)
    rich = bool(rng.random() < 0.4)
    motion = "curve" if rich else str(rng.choice([*MOTIONS]))
    steps, tags = (150, 12) if rich else (int(rng.integers(2, 60)), int(rng.integers(1, 13)))
    log = world(
        rng,
        motion,
        steps,
        tags,
        8.0 if rich else rng.choice([2.0, 6.0, 20.0]),
        rich or rng.random() < 0.6,
    )
    names = rng.choice([*DEFECTS], 1 if rich else 2, replace=False).tolist()
    try:
        for name in names:
            log = DEFECTS[name].make(log, rng)
    except LogError as error:
        return None, names, str(error)
    return log, names, rich and DEFECTS[names[0]].found
