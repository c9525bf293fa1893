"""Simulated logs of a robot that is moved without its knowledge."""

import dataclasses

import numpy as np

from saccade.simulation import WorldConfig, simulate_world
from support.logs import with_observations, without_names

WORLD = WorldConfig(
    course_length=60, landmarks=60, landmark_spread=6, steps=640, range_limits=(0.5, 8.0)
)
STEP, JUMP = 300, 60  # 15 m on the course


def kidnapped(seed, named, jump=JUMP):
    """A log without the poses between two: its odometry does not tell of the way between them."""
    log = simulate_world(WORLD, seed)
    kept = np.delete(np.arange(len(log.time)), np.arange(STEP + 1, STEP + 1 + jump))
    observed = with_observations(log, np.isin(log.observation_pose, kept))
    log = dataclasses.replace(
        observed,
        time=log.time[: len(kept)],
        control=log.control[kept[:-1]],
        control_covariance=log.control_covariance[kept[:-1]],
        observation_pose=np.searchsorted(kept, observed.observation_pose),
        truth=dataclasses.replace(log.truth, time=log.time[: len(kept)], pose=log.truth.pose[kept]),
    )
    return log if named else without_names(log)
