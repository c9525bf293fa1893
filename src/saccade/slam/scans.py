"""Scans: the validated arguments of a step, with the noise of the settings."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from saccade.slam.config import EkfConfig
from saccade.slam.filter.validation import MIN_SIGMA, as_array, as_names, as_number, check_noise
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


def validated_scan(
    config: EkfConfig,
    control_size: int | None,
    time: float,
    control: FloatArray | None,
    U: FloatArray | None,
    z: FloatArray | None,
    R: FloatArray | None,
    names: IntArray | None,
) -> Scan:
    """The arguments of `Slam.step`, copied.

    Raises:
        LogError: one of them has another shape, is not finite, or no covariance.
    """
    time, motion = as_number("time", time), None
    if control is not None:
        c = control_size or np.size(control)
        u = np.array(as_array("control", (c,), control), np.float64)
        U = np.array(as_array("covariance of the control", (c, c), U), np.float64)
        check_noise("control", u[None], U[None], 0, 1, config.motion_noise_scale**2, 0.0)
        motion = u, U
    k = 0 if z is None else len(z)
    if k == 0:
        return Scan(time, motion, *NO_SCAN)
    z = as_array("observations", (k, 2), z).astype(np.float64)
    R = as_array("covariances of the observations", (k, 2, 2), R).astype(np.float64)
    identity = np.full(k, -1) if names is None else as_names(k, names).astype(np.int64)
    check_noise("observation", z, R, 0, k, config.sensor_noise_scale**2, MIN_SIGMA)
    return Scan(time, motion, z, R, identity)


def scans_of(log: LandmarkLog, config: EkfConfig) -> Iterator[Scan]:
    """The steps of a log, the first without a motion.

    Raises:
        LogError: before the first of them, a control or an observation is invalid.
    """
    u, U = (np.array(each, np.float64, order="C") for each in (log.control, log.control_covariance))
    z, R = np.array(log.observation, np.float64), np.array(log.observation_covariance, np.float64)
    check_noise("control", u, U, 0, len(u), config.motion_noise_scale**2, 0.0)
    check_noise("observation", z, R, 0, len(z), config.sensor_noise_scale**2, MIN_SIGMA)
    edge = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1)).tolist()
    names, times = np.asarray(log.landmark, np.int64), log.time.tolist()

    def scans() -> Iterator[Scan]:
        for i, time in enumerate(times):
            motion = None if i == 0 else (u[i - 1], U[i - 1])
            start, end = edge[i], edge[i + 1]
            scan = NO_SCAN if start == end else (z[start:end], R[start:end], names[start:end])
            yield Scan(time, motion, *scan)

    return scans()
