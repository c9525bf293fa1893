"""Smoothing: the most probable trajectory and map, given a whole log."""

from dataclasses import dataclass, replace

import numpy as np

from saccade.errors import LogError
from saccade.plane import in_robot_frame, relative_pose_jacobian, rotations, to_relative_poses
from saccade.slam.config import EkfConfig
from saccade.slam.filter.models import bias_jacobian
from saccade.slam.least_squares import (
    MIN_DECREASE,
    Estimate,
    Measurements,
    NormalEquations,
    minimize,
)
from saccade.slam.run import SlamResult
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MIN_SIGMA = 1e-4
"""Standard deviation in meters and radians that is added to every measurement."""
MAX_BYTES = 2e9
"""Largest size of the covariances between poses and landmarks, in bytes."""
MAX_SIGMA = 1e4
"""Standard deviation in meters above which a landmark is not determined."""


@dataclass(frozen=True, eq=False, repr=False)
class SmoothResult:
    """Smoothed trajectory and map: each estimate uses later measurements too."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, given the whole log."""
    map: LandmarkMap
    """The filter's landmarks, with covariance."""
    weight: FloatArray
    """(k,) robust weight of each observation, from 0 to 1; NaN where it was not used."""
    odometry_bias: FloatArray
    """(3,) estimated systematic errors of the odometry, or (0,) if none were estimated."""
    bias_covariance: FloatArray
    """(3, 3) their covariance, or (0, 0)."""
    iterations: int
    """Iterations until convergence."""

    def __repr__(self) -> str:
        return f"SmoothResult({self.trajectory!r}, {self.map!r}, {self.iterations} iterations)"


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: EkfConfig = EkfConfig(),
    *,
    min_decrease: float = MIN_DECREASE,
) -> SmoothResult:
    """Smooth a log over the filter's association.

    Args:
        log: controls and observations of range and bearing.
        filtered: result of the same log; the initial estimate.
        config: settings of the filter, of which the noise, the start, `huber` and
            `estimate_odometry_bias` apply.
        min_decrease: relative decrease of the cost below which the estimate has converged.

    Returns:
        Trajectory, map, and the weight of each observation.

    Raises:
        LogError: the log leaves a landmark undetermined, which is named; or it is too large.
    """
    log = in_robot_frame(log)
    moves = log.control.any(1) | log.control_covariance.any((1, 2))  # (t,)
    variable = np.concatenate([[0], np.cumsum(moves)])  # poses at standstill share one
    first = np.unique(variable, return_index=True)[1]
    used = np.flatnonzero(filtered.association >= 0)
    if 8 * 3 * len(first) * 2 * len(filtered.map) > MAX_BYTES:
        raise LogError(
            f"smoothing: expected poses and landmarks that fit into {MAX_BYTES / 1e9:g} GB, "
            f"found {len(first)} and {len(filtered.map)}"
        )
    measured = _measurements(log, config, variable, filtered.association)
    start = Estimate(
        filtered.trajectory.pose[first], filtered.map.xy, np.zeros(len(measured.bias_sigma))
    )
    try:
        best, iterations = minimize(measured, start, min_decrease)
        pose_covariance, others = NormalEquations(measured, best).covariances()
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise LogError(f"smoothing: {_undetermined(filtered, measured, start)}") from error
    n = len(best.landmark)
    row = 2 * np.arange(n)[:, None] + np.arange(2)
    covariance = others[row[:, :, None], row[:, None]]
    if not (np.abs(covariance) < MAX_SIGMA**2).all():
        raise LogError(f"smoothing: {_undetermined(filtered, measured, best)}")
    weight = np.full(len(log.observation), np.nan)
    weight[used] = measured.weights(measured.observations(best))
    return SmoothResult(
        trajectory=Trajectory(log.time, best.pose[variable], pose_covariance[variable]),
        map=replace(filtered.map, xy=best.landmark, covariance=covariance),
        weight=weight,
        odometry_bias=best.bias,
        bias_covariance=others[2 * n :, 2 * n :],
        iterations=iterations,
    )


def _measurements(
    log: LandmarkLog, config: EkfConfig, variable: IntArray, association: IntArray
) -> Measurements:
    """The measurements of a log between variables (t + 1,), the number of that of each pose."""
    moves, used = np.flatnonzero(np.diff(variable)), np.flatnonzero(association >= 0)
    step, covariance = (each[moves] for each in to_relative_poses(log))
    turned = np.tile(np.eye(3), (len(moves), 1, 1))
    turned[:, :2, :2] = rotations(-step[:, 2])
    in_later_frame = turned @ covariance @ turned.transpose(0, 2, 1)
    sigma = np.array(log.odometry_bias) * config.estimate_odometry_bias
    by_bias = (relative_pose_jacobian(log) @ bias_jacobian(log.control))[moves][:, :, sigma > 0]
    return Measurements(
        start=log.start,
        start_root=_root(np.diag(np.square(config.start_sigma))),
        step=step,
        step_root=_root(in_later_frame * config.motion_noise_scale**2),
        step_by_bias=by_bias,
        bias_sigma=sigma[sigma > 0],
        observer=variable[log.observation_pose[used]],
        landmark=association[used],
        observation=log.observation[used],
        observation_root=_root(log.observation_covariance[used] * config.sensor_noise_scale**2),
        huber=config.huber,
    )


def _root(covariance: FloatArray) -> FloatArray:
    """Square roots W of information matrices: W^T W is the inverse of a covariance (..., d, d)."""
    regular = covariance + MIN_SIGMA**2 * np.eye(covariance.shape[-1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(regular)))


def _undetermined(filtered: SlamResult, measured: Measurements, at: Estimate) -> str:
    """Message that names the landmark about which the observations tell least."""
    B = measured.observations(at).by_second
    information = np.zeros((len(at.landmark), 2, 2))
    np.add.at(information, measured.landmark, B.transpose(0, 2, 1) @ B)
    worst = int(np.linalg.eigvalsh(information)[:, 0].argmin())
    seen = int((measured.landmark == worst).sum())
    return (
        "expected measurements that determine every landmark, found that they leave open landmark "
        f"{filtered.map.names[worst]} (seen {seen} time{'s' * (seen != 1)}); are standard "
        "deviations in the log too large?"
    )
