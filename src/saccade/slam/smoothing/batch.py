"""Smoothing of a log by GTSAM with robust noise, over the filter's association.

As one batch least-squares problem, or with a fixed lag.
"""

import numpy as np

from saccade.slam.models import Motion
from saccade.slam.run import SlamResult
from saccade.slam.smoothing.fixed_lag import smooth_fixed_lag
from saccade.slam.smoothing.problem import SmoothConfig, SmoothingProblem, SmoothResult
from saccade.types import LandmarkLog

RELATIVE_CHANGE = 1e-6
"""Relative decrease of the error below which the optimizer stops."""


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: SmoothConfig | None = None,
    motion: Motion | None = None,
) -> SmoothResult:
    """Smooth a log over the filter's association.

    The controls are corrected for the odometry biases that the filter estimated.

    Args:
        log: controls and observations of range and bearing.
        filtered: result of the same log; the initial estimate.
        config: method and noise; batch by default.
        motion: the motion model; by default that of the log's controls. It must be invariant to
            the initial pose.

    Returns:
        Trajectory, map, and the weight of each observation.

    Raises:
        LogError: the log leaves variables undetermined; names them.
        ConfigError: GTSAM is not installed.
    """
    problem = SmoothingProblem(log, filtered, config or SmoothConfig(), motion)
    return smooth_fixed_lag(problem) if problem.config.method == "fixed-lag" else _solve(problem)


def _solve(problem: SmoothingProblem) -> SmoothResult:
    gtsam = problem.gtsam
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(problem.config.iterations)
    parameters.setRelativeErrorTol(RELATIVE_CHANGE)
    optimizer = gtsam.LevenbergMarquardtOptimizer(problem.graph, problem.estimates(), parameters)
    best = optimizer.optimize()
    problem.check(best)
    marginals = gtsam.Marginals(problem.graph, best)
    pose, pose_covariance = np.empty((len(problem), 3)), np.empty((len(problem), 3, 3))
    for number in range(len(problem)):
        covariance = marginals.marginalCovariance(problem.pose_key(number))
        pose[number], pose_covariance[number] = problem.pose(number, best, covariance)
    landmarks = [problem.landmark_key(number) for number in range(len(problem.filtered.map))]
    xy = np.array([best.atPoint2(key) for key in landmarks]).reshape(-1, 2)
    covariance = np.array([marginals.marginalCovariance(key) for key in landmarks])
    weights = np.array([problem.weight(number, best) for number in range(len(problem.used))])
    landmark_estimates = (xy, covariance.reshape(-1, 2, 2))
    iterations = optimizer.iterations()
    return problem.result((pose, pose_covariance), landmark_estimates, weights, iterations)
