"""Scans: validated arguments of a step of the filter, live or from a log."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.landmark_names import Label, labels_of, parse_labels
from saccade.motions import Motion, find_motion
from saccade.plane import in_robot_frame
from saccade.slam.config import EkfConfig
from saccade.slam.filter.robot_models import as_relative_pose, as_relative_poses
from saccade.slam.filter.validation import (
    MIN_SIGMA,
    as_array,
    as_number,
    as_numbers,
    check_all,
    check_range_bearing,
    require_shape,
)
from saccade.types import BoolArray, FloatArray, LandmarkLog

NO_SCAN = np.empty((0, 2)), np.empty((0, 2, 2)), ()
"""Observations, covariances and labels of a step without observations."""
MISSING_VARIANCE = 1e16
"""Variance of a missing range or bearing, in square meters or radians: its gain is below rounding
errors."""


class Scan(NamedTuple):
    """The motion to a pose, and the observations there."""

    time: float
    """Time of the pose."""
    control: tuple[FloatArray, FloatArray, FloatArray] | None
    """Relative pose (3,) from the last pose to this one, its covariance (3, 3), and its Jacobian by
    the systematic errors (3, 3); None without a motion."""
    z: FloatArray
    """(k, 2) range in meters, bearing in radians."""
    R: FloatArray
    """(k, 2, 2) their covariances."""
    labels: Sequence[Label | None]
    """(k,) labels of the landmarks, None where unknown."""
    missing: BoolArray | None = None
    """(k, 2) missing ranges and bearings, zero in `z` with a variance of `MISSING_VARIANCE`; None
    without any."""

    @property
    def partial(self) -> BoolArray:
        """(k,) observations without a range or without a bearing."""
        missing = np.zeros((len(self.z), 2), np.bool_) if self.missing is None else self.missing
        return missing[:, 0] | missing[:, 1]

    @property
    def complete(self) -> Self:
        """The scan without its partial observations."""
        return self if self.missing is None else self.part(~self.partial)._replace(missing=None)

    def part(self, chosen: BoolArray) -> Self:
        """The scan with the chosen (k,) observations only."""
        labels = [self.labels[k] for k in np.flatnonzero(chosen).tolist()]
        missing = None if self.missing is None else self.missing[chosen]
        return self._replace(z=self.z[chosen], R=self.R[chosen], labels=labels, missing=missing)


def checked_scan(
    config: EkfConfig,
    time: object,
    control: npt.ArrayLike | None,
    U: npt.ArrayLike | None,
    z: npt.ArrayLike | None,
    R: npt.ArrayLike | None,
    labels: npt.ArrayLike | None,
    motion: str | Motion = "",
) -> Scan:
    """Validated copies of the arguments of `Slam.step`, with the noise scales of the settings.

    The control is of this motion; by default of the first with its number of columns.

    Raises:
        LogError: an argument is invalid.
    """
    seconds, moved = as_number("time", time), None
    if control is not None:
        moved = as_relative_pose(control, U, motion, config.motion_noise_scale)
    z = np.empty((0, 2)) if z is None else np.atleast_1d(as_numbers("observations", z))
    if z.size == 0:
        return Scan(seconds, moved, *NO_SCAN)
    k = len(z)
    found = [None] * k if labels is None else parse_labels(labels)
    require_shape("labels", (k,), np.empty(len(found)))
    z = as_array("observations", (k, 2), z).copy()
    C = as_numbers("covariances of the observations", R)
    C = np.tile(C, (k, 1, 1)) if C.shape == (2, 2) else C.copy()
    require_shape("covariances of the observations", (k, 2, 2), C)
    return Scan(seconds, moved, z, C, found, _check_observations(z, C, config))


def scans_of(log: LandmarkLog, config: EkfConfig) -> Iterator[Scan]:
    """The steps of a log, the first without a motion, with the noise scales of the settings.

    Raises:
        LogError: a control or an observation is invalid; raised before the first step.
    """
    log = in_robot_frame(log)
    u, U = (np.array(each, np.float64, order="C") for each in (log.control, log.control_covariance))
    z, R = np.array(log.observation, np.float64), np.array(log.observation_covariance, np.float64)
    check_all("control", u, U, config.motion_noise_scale**2)
    steps = as_relative_poses(find_motion(log.motion), u, U)
    missing = _check_observations(z, R, config)
    edge = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1)).tolist()
    labels = labels_of(log.landmark, log.text_names)
    motions, bounds = [None, *zip(*steps, strict=True)], pairwise(edge)
    scans = (
        NO_SCAN
        if start == end
        else (
            *(z[start:end], R[start:end], labels[start:end]),
            None if missing is None or not missing[start:end].any() else missing[start:end],
        )
        for start, end in bounds
    )
    each = zip(log.time.tolist(), motions, scans, strict=True)
    return (Scan(time, motion, *scan) for time, motion, scan in each)


def _check_observations(z: FloatArray, R: FloatArray, config: EkfConfig) -> BoolArray | None:
    """Checks observations (k, 2), and scales their covariances (k, 2, 2) in place.

    Returns:
        `Scan.missing`; its elements are NaN in z before, and zero afterwards.

    Raises:
        LogError: an observation is invalid, or has neither a range nor a bearing.
    """
    missing = np.isnan(z)
    some = bool(missing.any())
    if some:
        if missing.all(1).any():
            first = int(missing.all(1).argmax())
            raise LogError(f"observation {first}: expected a range or a bearing, found neither")
        k, i = missing.nonzero()
        R[k, 0, 1] = R[k, 1, 0] = z[k, i] = 0.0
        R[k, i, i] = R[k, 1 - i, 1 - i]
    check_range_bearing(z)
    check_all("observation", z, R, config.sensor_noise_scale**2, MIN_SIGMA)
    if some:
        R[k, i, i] = MISSING_VARIANCE
    return missing if some else None
