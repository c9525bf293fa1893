"""Scans: the validated arguments of a step, with the noise of the settings."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.landmark_names import number_names
from saccade.slam.config import EkfConfig
from saccade.slam.filter.validation import (
    MIN_SIGMA,
    as_array,
    as_number,
    as_numbers,
    check_noise,
    check_range_bearing,
    require_shape,
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


def validated_scan(
    config: EkfConfig,
    time: object,
    control: npt.ArrayLike | None,
    U: npt.ArrayLike | None,
    z: npt.ArrayLike | None,
    R: npt.ArrayLike | None,
    names: npt.ArrayLike | None,
    after: float,
    control_size: int | None,
    text_names: tuple[str, ...],
    observes_ranges: bool,
) -> tuple[Scan, tuple[str, ...]]:
    """The arguments of `Slam.step`, copied, and the table of the names that are text.

    Args:
        config: whose noise scales apply.
        time: as of `Slam.step`; so are the arguments to `names`.
        control: as of `Slam.step`.
        U: as of `Slam.step`.
        z: as of `Slam.step`.
        R: as of `Slam.step`.
        names: as of `Slam.step`.
        after: time of the last step.
        control_size: numbers of a control of the motion model; None for any.
        text_names: the table so far.
        observes_ranges: whether observations are ranges and bearings.

    Raises:
        LogError: one of them has another shape, is not finite, or no covariance; or the time goes
            back.
    """
    seconds, motion = as_number("time", time), None
    if seconds < after:
        raise LogError(f"time: expected {after:g} or later, found {seconds:g}")
    if control is not None:
        c = control_size or np.size(control)
        u = np.array(as_array("control", (c,), control), np.float64)
        U = np.array(as_array("covariance of the control", (c, c), U), np.float64)
        check_noise("control", u[None], U[None], 0, 1, config.motion_noise_scale**2, 0.0)
        motion = u, U
    z = np.empty((0, 2)) if z is None else np.atleast_1d(as_numbers("observations", z))
    k = len(z)
    if names is None:
        identity = np.full(k, -1)
    else:
        identity, text_names = number_names(names, text_names)
        require_shape("names", (k,), identity)
    z = as_array("observations", (k, 2), z).astype(np.float64)
    R = as_array("covariances of the observations", (k, 2, 2), R).astype(np.float64)
    if k == 0:
        return Scan(seconds, motion, *NO_SCAN), text_names
    if observes_ranges:
        check_range_bearing(z)
    check_noise("observation", z, R, 0, k, config.sensor_noise_scale**2, MIN_SIGMA)
    return Scan(seconds, motion, z, R, identity.astype(np.int64)), text_names


def scans_of(
    log: LandmarkLog, config: EkfConfig, names: IntArray, *, observes_ranges: bool = True
) -> Iterator[Scan]:
    """The steps of a log, the first without a motion.

    Args:
        log: controls and observations.
        config: whose noise scales apply.
        names: (k,) numbers of the landmarks' names, -1 where unknown.
        observes_ranges: whether observations are ranges and bearings.

    Raises:
        LogError: before the first of them, a control or an observation is invalid.
    """
    u, U = (np.array(each, np.float64, order="C") for each in (log.control, log.control_covariance))
    z, R = np.array(log.observation, np.float64), np.array(log.observation_covariance, np.float64)
    check_noise("control", u, U, 0, len(u), config.motion_noise_scale**2, 0.0)
    check_noise("observation", z, R, 0, len(z), config.sensor_noise_scale**2, MIN_SIGMA)
    if observes_ranges:
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
