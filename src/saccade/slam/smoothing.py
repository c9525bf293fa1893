"""Smoothing as a factor graph in GTSAM: variables, factors and errors.

Every pose and every landmark is a variable (Dellaert & Kaess 2006, "Square root SAM").
Observations have the robust loss of Huber (1964).
"""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from saccade.errors import LogError
from saccade.extras import import_optional
from saccade.slam.config import EkfConfig
from saccade.slam.filter.models import unbiased
from saccade.slam.models import MOTIONS, heading_rotation
from saccade.slam.run import SlamResult
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MIN_SIGMA = 1e-4
"""Meters and radians of noise added to every measurement, so that no weight is infinite."""
ISOTROPIC_NOISE = 1e-2
"""Noise added to a control in every direction, relative to its largest in meters and in radians:
GTSAM fails where the roots of weights differ by more than a factor of about four thousand."""
MAX_ITERATIONS, RELATIVE_CHANGE = 100, 1e-6
"""Of Levenberg-Marquardt: it stops where an iteration decreases the error by less than that."""


@dataclass(frozen=True, eq=False, repr=False)
class SmoothResult:
    """Smoothed trajectory and map: each estimate uses later measurements too."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, given the whole log."""
    map: LandmarkMap
    """The filter's landmarks, with covariance."""
    weight: FloatArray
    """(k,) robust weight of each observation, from 0 to 1; NaN where it was not used."""
    iterations: int
    """Iterations until convergence."""

    def __repr__(self) -> str:
        return f"SmoothResult({self.trajectory!r}, {self.map!r}, {self.iterations} iterations)"


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: EkfConfig = EkfConfig(),
) -> SmoothResult:
    """Smooth a log over the filter's association.

    The controls are corrected for the odometry biases that the filter estimated.

    Args:
        log: controls and observations of range and bearing.
        filtered: result of the same log; the initial estimate.
        config: settings of the filter, of which the noise, the start and `huber` apply.

    Returns:
        Trajectory, map, and the weight of each observation.

    Raises:
        LogError: the log leaves a variable undetermined; names it.
        ConfigError: GTSAM is not installed.
    """
    gtsam = import_optional("gtsam", "smooth")
    problem = _Problem(gtsam, log, filtered, config)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(MAX_ITERATIONS)
    parameters.setRelativeErrorTol(RELATIVE_CHANGE)
    optimizer = gtsam.LevenbergMarquardtOptimizer(problem.graph, problem.estimates(), parameters)
    best = optimizer.optimize()
    problem.check(best)
    marginals = gtsam.Marginals(problem.graph, best)

    pose = np.empty((len(problem.first), 3))
    covariance = np.empty((len(problem.first), 3, 3))
    for number, key in enumerate(problem.pose_keys):
        found = best.atPose2(key)
        rotation = heading_rotation(found.theta())  # GTSAM has errors in the frame of the pose
        pose[number] = found.x(), found.y(), found.theta()
        covariance[number] = rotation @ marginals.marginalCovariance(key) @ rotation.T
    xy = np.array([best.atPoint2(key) for key in problem.landmark_keys]).reshape(-1, 2)
    C = np.array([marginals.marginalCovariance(key) for key in problem.landmark_keys])
    weight = np.full(len(log.observation), np.nan)
    weight[problem.used] = problem.weights(best)
    return SmoothResult(
        trajectory=Trajectory(log.time, pose[problem.variable], covariance[problem.variable]),
        map=replace(filtered.map, xy=xy, covariance=C.reshape(-1, 2, 2)),
        weight=weight,
        iterations=optimizer.iterations(),
    )


class _Problem:
    """The factor graph of a log: variables x0, x1, ... and l0, l1, ..., a factor a measurement."""

    def __init__(
        self,
        gtsam: Any,
        log: LandmarkLog,
        filtered: SlamResult,
        config: EkfConfig,
    ) -> None:
        self.gtsam, self.log, self.filtered, self.config = gtsam, log, filtered, config
        self.used = np.flatnonzero(filtered.association >= 0)
        """(u,) associated observations."""
        moves = log.control.any(1) | log.control_covariance.any((1, 2))  # (t,)
        self.variable = np.concatenate([[0], np.cumsum(moves)])
        """(t + 1,) pose variable of each pose; poses at standstill share one."""
        self.first = np.unique(self.variable, return_index=True)[1]
        """(v,) the first pose of each variable."""
        self.pose_keys = [gtsam.symbol("x", number) for number in range(len(self.first))]
        self.landmark_keys = [gtsam.symbol("l", number) for number in range(len(filtered.map))]
        self.graph = gtsam.NonlinearFactorGraph()
        self._add_controls(np.flatnonzero(moves))
        self._add_observations()

    def estimates(self) -> Any:
        """The filter's estimates as GTSAM's values."""
        values, poses = self.gtsam.Values(), self.filtered.trajectory.pose[self.first]
        for key, pose in zip(self.pose_keys, poses, strict=True):
            values.insert(key, self.gtsam.Pose2(*pose))
        for key, xy in zip(self.landmark_keys, self.filtered.map.xy, strict=True):
            values.insert(key, xy)
        return values

    def weights(self, values: Any) -> FloatArray:
        """(u,) robust weights of the observations: k / e for errors e > k."""
        rows = range(len(self.first), self.graph.size())
        loss = np.array([self.graph.at(row).error(values) for row in rows])
        return np.asarray(1 / np.maximum(loss / self.config.huber**2 + 0.5, 1.0))

    def check(self, values: Any) -> None:
        """Raise unless all variables are determined, which the optimizer does not report."""
        try:
            self.graph.linearize(values).optimize()
        except RuntimeError as error:
            found = re.search(r"Symbol: ([xl])(\d+)", str(error))
            if found is None:
                raise LogError(f"smoothing: {' '.join(str(error).split())}") from error
            raise LogError(
                f"smoothing: expected measurements that determine every pose and landmark, found "
                f"that they leave open {self._name(found[1], int(found[2]))}; "
                "are deviations in the log too large, or of very different size?"
            ) from error

    def _name(self, kind: str, number: int) -> str:
        """A variable as a pose or landmark of the log."""
        if kind == "x":
            step = int(self.first[number])
            return f"pose {step} (at {self.log.time[step]:g})"
        seen = int((self.filtered.association == number).sum())
        return f"landmark {self.filtered.map.names[number]} (seen {seen} time{'s' * (seen != 1)})"

    def _add_controls(self, steps: IntArray) -> None:
        start, bias = self.gtsam.Pose2(*self.log.start), self.filtered.odometry_bias
        control = self.log.control if bias is None else unbiased(self.log.control, bias)
        Q = np.diag(np.square(self.config.start_sigma))
        self.graph.add(self.gtsam.PriorFactorPose2(self.pose_keys[0], start, self._noise(Q)))
        for step in steps.tolist():
            moved, _, Fu = MOTIONS[control.shape[1]](np.zeros(3), control[step])
            A = heading_rotation(-moved[2]) @ Fu  # errors in the frame of the later pose
            Q = A @ self.log.control_covariance[step] @ A.T
            along, left, turn = Q.diagonal()
            Q += ISOTROPIC_NOISE**2 * np.diag([along + left, along + left, turn])
            self.graph.add(
                self.gtsam.BetweenFactorPose2(
                    self.pose_keys[self.variable[step]],
                    self.pose_keys[self.variable[step + 1]],
                    self.gtsam.Pose2(*moved),
                    self._noise(Q * self.config.motion_noise_scale**2),
                )
            )

    def _add_observations(self) -> None:
        huber = self.gtsam.noiseModel.mEstimator.Huber.Create(self.config.huber)
        R = self.log.observation_covariance[:, ::-1, ::-1]  # GTSAM puts the bearing first
        for k in self.used.tolist():
            distance, bearing = self.log.observation[k].tolist()
            noise = self._noise(R[k] * self.config.sensor_noise_scale**2)
            self.graph.add(
                self.gtsam.BearingRangeFactor2D(
                    self.pose_keys[self.variable[self.log.observation_pose[k]]],
                    self.landmark_keys[self.filtered.association[k]],
                    self.gtsam.Rot2(bearing),
                    distance,
                    self.gtsam.noiseModel.Robust.Create(huber, noise),
                )
            )

    def _noise(self, covariance: FloatArray) -> Any:
        return self.gtsam.noiseModel.Gaussian.Covariance(
            covariance + MIN_SIGMA**2 * np.eye(len(covariance))
        )
