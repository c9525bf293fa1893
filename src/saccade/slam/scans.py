"""Scans: the arguments of a step of the filter, and those of the steps of a log."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from saccade.slam.config import EkfConfig
from saccade.slam.filter.validation import (
    MIN_SIGMA,
    check_noise,
    check_range_bearing,
)
from saccade.types import FloatArray, IntArray, LandmarkLog

NO_SCAN = np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, np.int64)
"""Observations, covariances and names of a step without observations."""


class Scan(NamedTuple):
    """The motion to a pose, and what is observed there."""

    time: float
    """Of the pose."""
    control: tuple[FloatArray, FloatArray] | None
    """(c,) from the last pose to this one and its covariance (c, c); None without a motion."""
    z: FloatArray
    """(k, 2) range in metres, bearing in radians."""
    R: FloatArray
    """(k, 2, 2) their covariances."""
    names: IntArray
    """(k,) landmark identities, -1 where unknown."""


def scans_of(log: LandmarkLog, config: EkfConfig, names: IntArray) -> Iterator[Scan]:
    """The steps of a log, the first without a motion.

    Args:
        log: controls and observations.
        config: whose noise scales apply.
        names: (k,) numbers of the landmarks' names, -1 where unknown.

    Raises:
        LogError: before the first of them, a control or an observation is invalid.
    """
    u, U = (np.array(each, np.float64, order="C") for each in (log.control, log.control_covariance))
    z, R = np.array(log.observation, np.float64), np.array(log.observation_covariance, np.float64)
    check_noise("control", u, U, config.motion_noise_scale**2)
    check_noise("observation", z, R, config.sensor_noise_scale**2, MIN_SIGMA)
    check_range_bearing(z)
    edge = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1)).tolist()
    times = log.time.tolist()

    def scans() -> Iterator[Scan]:
        for i, time in enumerate(times):
            motion = None if i == 0 else (u[i - 1], U[i - 1])
            start, end = edge[i], edge[i + 1]
            scan = NO_SCAN if start == end else (z[start:end], R[start:end], names[start:end])
            yield Scan(time, motion, *scan)

    return scans()
