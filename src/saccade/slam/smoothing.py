"""Smoothing: the most probable trajectory and map, given a whole log."""

from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from saccade.errors import LogError
from saccade.motions import SYSTEMATIC_ERRORS, find_motion
from saccade.plane import (
    in_robot_frame,
    path_of,
    relative_poses_of,
    rotated,
    rotations,
)
from saccade.slam.config import EkfConfig
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.robot_models import as_relative_poses, wrap
from saccade.slam.least_squares import (
    MAX_ITERATIONS,
    MIN_COST_DECREASE,
    Estimate,
    Measurements,
    NormalEquations,
    minimize,
)
from saccade.slam.results import SlamResult
from saccade.threads import SERIAL_BLAS
from saccade.types import (
    BoolArray,
    FloatArray,
    IntArray,
    LandmarkLog,
    LandmarkMap,
    Trajectory,
)

MIN_SIGMA = 1e-4
"""Standard deviation in meters and radians that is added to every measurement."""
MIN_BIAS_SIGMA = 1e-6
"""Standard deviation that is added to those of the odometry biases, in their units."""
MAX_BYTES = 2e9
"""Largest size of the covariances between poses and landmarks, in bytes."""
ANYWHERE = (1e4, 1e4, 10.0)
"""Standard deviations in meters and radians of the motion of a kidnapped robot."""
MAX_LANDMARK_SIGMA = 1e4
"""Largest standard deviation of a determined landmark, in meters."""
MAX_TURN_SIGMA = 0.05
"""Largest standard deviation in radians of a rotation of the prior map as a whole. The Gaussian of
a map is linear in rotations: one by the angle a stretches it by 1 / cos a."""
COPIES = 20
"""Number of matrices of the size of the prior covariance that are in memory at once."""


class Prior(NamedTuple):
    """Gaussian of the first pose, landmarks and odometry biases before a log."""

    mean: Estimate
    """First pose (1, 3), p landmarks and b biases."""
    covariance: FloatArray
    """(3 + 2 p + b,) squared, in this order."""

    @classmethod
    def without_map(cls, log: LandmarkLog, config: EkfConfig) -> Self:
        """The start of a log that begins a map."""
        sigma = np.concatenate(config.systematic_sigmas(log.odometry_bias, log.range_errors))
        mean = Estimate(np.array(log.start)[None], np.empty((0, 2)), np.zeros(len(sigma)))
        return cls(mean, np.diag(np.square([*config.start_sigma, *sigma])))

    @classmethod
    def of_filter(cls, ekf: EkfSlam) -> Self:
        """The present estimate of a filter."""
        pose, bias = np.split(ekf.robot_state, [3])
        mean = Estimate(pose[None].copy(), ekf.landmarks.copy(), bias.copy())
        biases_last = np.r_[
            :3, 3 + len(bias) : 3 + len(bias) + mean.landmark.size, 3 : 3 + len(bias)
        ]
        return cls(mean, ekf.marginal(ekf.ids)[np.ix_(biases_last, biases_last)])

    @property
    def turn_sigma(self) -> float:
        """Standard deviation in radians of a rotation of all landmarks about any point."""
        xy = self.mean.landmark
        if len(xy) < 2:
            return 0.0
        rigid = np.zeros((len(xy), 2, 3))  # derivatives of the landmarks by rotation, translation
        rigid[:, :, 0] = xy @ [[0, 1], [-1, 0]]
        rigid[:, 0, 1] = rigid[:, 1, 2] = 1.0
        rows = slice(3, 3 + xy.size)
        W = _root(self.covariance[rows, rows]) @ rigid.reshape(xy.size, 3)
        return float(np.sqrt(np.linalg.inv(W.T @ W)[0, 0]))

    def of_landmarks(self, kept: BoolArray) -> Self:
        """The marginal without other landmarks than the `kept` ones (p,)."""
        rows = np.ones(len(self.covariance), np.bool_)
        rows[3 : 3 + 2 * len(kept)] = np.repeat(kept, 2)
        mean = self.mean._replace(landmark=self.mean.landmark[kept])
        return type(self)(mean, self.covariance[np.ix_(rows, rows)])


class Smoothed(NamedTuple):
    """A smoothed log, with the field names of `SlamResult`."""

    trajectory: Trajectory
    """(t + 1) poses with covariance."""
    map: LandmarkMap
    """n landmarks with covariance."""
    weight: FloatArray
    """(k,) robust weight of each observation, NaN where it was not used."""
    odometry_bias: FloatArray | None
    """(3,) odometry biases; None if they are not estimated."""
    bias_covariance: FloatArray | None
    """(3, 3) its covariance."""
    range_errors: FloatArray | None
    """(2,) scale error and offset of the ranges; None if they are not estimated."""
    range_error_covariance: FloatArray | None
    """(2, 2) its covariance."""
    scale_disagreement: tuple[float, float] | None
    """As in `SlamResult`."""


def smooth(
    log: LandmarkLog,
    result: SlamResult,
    config: EkfConfig = EkfConfig(),
    *,
    prior: Prior | None = None,
    min_decrease: float = MIN_COST_DECREASE,
) -> SlamResult:
    """Smooths a log over the association of the filter.

    Args:
        log: controls and observations of range and bearing.
        result: result of the filter on this log, the initial estimate.
        config: settings of the filter: the noise, the start, `huber` and the odometry biases apply.
        prior: first pose, biases and the first landmarks of the result before the log; by default
            as `config` has them, without landmarks.
        min_decrease: minimum relative decrease of the cost in an iteration; then the estimate has
            converged.

    Returns:
        The result with the smoothed trajectory, map and odometry biases, and the weight of each
        observation.

    Raises:
        LogError: a landmark, whose label is given, is not determined; the log is too large; or the
            estimate does not converge.
    """
    log = in_robot_frame(log)
    found = smooth_log(
        *(log, result.trajectory.pose, result.map, result.association, result.lost),
        *(config, prior, min_decrease),
    )
    return replace(result, **found._asdict(), estimate="smoothed")


def smooth_log(
    log: LandmarkLog,
    poses: FloatArray,
    landmarks: LandmarkMap,
    association: IntArray,
    lost: BoolArray | None,
    config: EkfConfig,
    prior: Prior | None = None,
    min_decrease: float = MIN_COST_DECREASE,
) -> Smoothed:
    """Smooths a log in the frame of the robot, from poses (t + 1, 3) and a map of n landmarks.

    Each of the k observations is of the landmark in row `association` (k,), -1 for none; at each
    pose the robot may be `lost` (t + 1,).

    Raises:
        LogError: as `smooth`.
    """
    if lost is not None and lost[0]:
        raise LogError("smoothing: expected a known first pose, found a robot that is lost")
    prior = prior or Prior.without_map(log, config)
    cuts = _kidnappings(log, association, lost)
    cut = np.isin(np.arange(len(log.control)), cuts)
    moves = log.control.any(1) | log.control_covariance.any((1, 2)) | cut  # (t,)
    variable = np.concatenate([[0], np.cumsum(moves)])  # poses at standstill share one
    first = np.unique(variable, return_index=True)[1]
    cells = 3 * len(first) * 2 * len(landmarks) + COPIES * prior.covariance.size
    if 8 * cells > MAX_BYTES:
        raise LogError(
            f"smoothing: expected poses and landmarks that fit into {MAX_BYTES / 1e9:g} GB, "
            f"found {len(first)} and {len(landmarks)}"
        )
    if (sigma := prior.turn_sigma) > MAX_TURN_SIGMA:
        raise LogError(
            "smoothing: expected a map whose standard deviation of the heading is at most "
            f"{MAX_TURN_SIGMA} rad, found {sigma:.2f}"
        )
    measured = _measurements(log, config, prior, variable, association, cuts)
    initial = _initial_poses(log, poses, lost, cuts)[first]
    start = Estimate(initial, landmarks.xy, prior.mean.bias)
    try:
        with SERIAL_BLAS:
            best, iterations = minimize(measured, start, min_decrease)
            pose_covariance, others = NormalEquations(measured, best).covariances()
    except (np.linalg.LinAlgError, RuntimeError) as error:
        raise LogError(f"smoothing: {_undetermined(landmarks, measured, start)}") from error
    if iterations == MAX_ITERATIONS:
        raise LogError(f"smoothing: expected convergence in {MAX_ITERATIONS} steps, found none")
    n = len(best.landmark)
    row = 2 * np.arange(n)[:, None] + np.arange(2)
    covariance = others[row[:, :, None], row[:, None]]
    if not (np.abs(covariance) < MAX_LANDMARK_SIGMA**2).all():
        raise LogError(f"smoothing: {_undetermined(landmarks, measured, best)}")
    weight = np.full(len(log.observation), np.nan)
    weight[association >= 0] = measured.weights(measured.observations(best))
    of_odometry, of_ranges = len(best.bias) >= 3, len(best.bias) in (2, 5)
    return Smoothed(
        trajectory=Trajectory(log.time, best.pose[variable], pose_covariance[variable]),
        map=replace(landmarks, xy=best.landmark, covariance=covariance),
        weight=weight,
        odometry_bias=best.bias[:3] if of_odometry else None,
        bias_covariance=others[2 * n : 2 * n + 3, 2 * n : 2 * n + 3] if of_odometry else None,
        range_errors=best.bias[-2:] if of_ranges else None,
        range_error_covariance=others[-2:, -2:] if of_ranges else None,
        scale_disagreement=scale_disagreement(best.bias, others[2 * n :, 2 * n :]),
    )


def scale_disagreement(bias: FloatArray, covariance: FloatArray) -> tuple[float, float] | None:
    """Sum of the scale errors of distances and ranges, and its standard deviation.

    Args:
        bias: (b,) systematic errors, as in `Estimate.bias`.
        covariance: (b, b).

    Returns:
        None unless both are estimated.
    """
    if len(bias) < SYSTEMATIC_ERRORS + 2:
        return None
    scales = np.ix_((0, SYSTEMATIC_ERRORS), (0, SYSTEMATIC_ERRORS))
    return float(bias[0] + bias[SYSTEMATIC_ERRORS]), float(np.sqrt(covariance[scales].sum()))


def _kidnappings(log: LandmarkLog, association: IntArray, lost: BoolArray | None) -> IntArray:
    """(c,) number of the control of each kidnapping after which the robot was relocalized.

    It is the first control after the last used observation before the robot counted as lost.
    """
    if lost is None:
        return np.empty(0, np.int64)
    begins = np.flatnonzero(np.diff(lost.astype(np.int64)) > 0) + 1
    begins = begins[begins < np.flatnonzero(~lost).max(initial=0)]
    used = log.observation_pose[association >= 0]
    last = np.append(-1, used)[np.searchsorted(used, begins)]
    return np.asarray(np.where(last < 0, begins - 1, last))


def _initial_poses(
    log: LandmarkLog, poses: FloatArray, lost: BoolArray | None, cuts: IntArray
) -> FloatArray:
    """(t + 1, 3) filtered poses; after a kidnapping, dead reckoning backward from its end."""
    pose = poses.copy()
    if len(cuts) == 0 or lost is None:
        return pose
    steps, found = relative_poses_of(log)[0], np.flatnonzero(~lost)
    for cut in cuts.tolist():
        end = int(found[np.searchsorted(found, np.flatnonzero(lost[cut:])[0] + cut)])
        path = path_of(steps[cut + 1 : end])  # poses cut + 1 to end, relative to the first
        heading = pose[end, 2] - path[-1, 2]
        offset = rotated(path[:, :2] - path[-1, :2], np.full(len(path), heading))
        pose[cut + 1 : end + 1, :2] = pose[end, :2] + offset
        pose[cut + 1 : end + 1, 2] = wrap(heading + path[:, 2])
    return pose


def _measurements(
    log: LandmarkLog,
    config: EkfConfig,
    prior: Prior,
    variable: IntArray,
    association: IntArray,
    cuts: IntArray,
) -> Measurements:
    """The measurements of a log, given the number of the variable (t + 1,) of each pose.

    The controls `cuts` (c,) of kidnappings carry no information.
    """
    moves, used = np.flatnonzero(np.diff(variable)), np.flatnonzero(association >= 0)
    moved = as_relative_poses(
        find_motion(log.motion), log.control[moves], log.control_covariance[moves]
    )
    step, covariance, by_bias = moved
    covariance[np.isin(moves, cuts)] += np.diag(np.square(ANYWHERE))
    turned = np.tile(np.eye(3), (len(moves), 1, 1))
    turned[:, :2, :2] = rotations(-step[:, 2])
    in_later_frame = turned @ covariance @ turned.transpose(0, 2, 1)
    missing = np.isnan(log.observation[used])  # (k, 2)
    with_missing = missing[:, :, None] | missing[:, None]
    R = np.where(with_missing, np.eye(2), log.observation_covariance[used])
    b = len(prior.mean.bias)
    min_sigma = np.repeat([MIN_SIGMA, MIN_BIAS_SIGMA], [len(prior.covariance) - b, b])
    return Measurements(
        prior=prior.mean,
        prior_root=_root(prior.covariance, min_sigma),
        step=step,
        step_root=_root(in_later_frame * config.motion_noise_scale**2),
        step_by_bias=np.concatenate(
            [by_bias[:, :, : 3 * (b >= 3)], np.zeros((len(step), 3, 2 * (b in (2, 5))))], 2
        ),
        observer=variable[log.observation_pose[used]],
        landmark=association[used],
        observation=np.where(missing, 0.0, log.observation[used]),
        observation_root=~missing[:, :, None] * _root(R * config.sensor_noise_scale**2),
        huber=config.huber,
    )


def _root(covariance: FloatArray, min_sigma: FloatArray | float = MIN_SIGMA) -> FloatArray:
    """Square roots W of information matrices: W^T W is the inverse of a covariance (..., d, d)."""
    regular = covariance + np.square(min_sigma) * np.eye(covariance.shape[-1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(regular)))


def _undetermined(landmarks: LandmarkMap, measured: Measurements, at: Estimate) -> str:
    """Message with the label of the least determined landmark."""
    if len(landmarks) == 0:
        return "expected observations of landmarks, found none that are used"
    B = measured.observations(at).by_second
    information = np.zeros((len(at.landmark), 2, 2))
    np.add.at(information, measured.landmark, B.transpose(0, 2, 1) @ B)
    worst = int(np.linalg.eigvalsh(information)[:, 0].argmin())
    seen = int((measured.landmark == worst).sum())
    return (
        "expected measurements that determine every landmark, found too few of landmark "
        f"{landmarks.names[worst]} (seen {seen} time{'s' * (seen != 1)}); check the standard "
        "deviations in the log"
    )
