"""A drive smoothed by GTSAM with robust noise, over what the filter associated.

The whole of it at once, as one least-squares problem, or with a fixed lag.
"""

import numpy as np

from saccade.slam.models import Motion
from saccade.slam.run import SlamResult
from saccade.slam.smoothing.fixed_lag import smooth_fixed_lag
from saccade.slam.smoothing.problem import SmoothConfig, SmoothingProblem, SmoothResult
from saccade.types import LandmarkLog

RELATIVE_CHANGE = 1e-6
"""Of the error, below which an iteration is the last."""


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: SmoothConfig | None = None,
    motion: Motion | None = None,
) -> SmoothResult:
    """Smooth a log over the association that the filter found.

    What the filter found the odometry to be off by is taken from the controls.

    Args:
        log: controls and observations of range and bearing.
        filtered: of the same log; where the smoothing begins.
        config: method and noise; the whole drive at once unless told otherwise.
        motion: what the controls mean; the log says it unless told otherwise. One whose way does
            not depend on where it begins.

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
    pose, spread = np.empty((len(problem), 3)), np.empty((len(problem), 3, 3))
    for number in range(len(problem)):
        covariance = marginals.marginalCovariance(problem.pose_key(number))
        pose[number], spread[number] = problem.pose(number, best, covariance)
    landmarks = [problem.landmark_key(number) for number in range(len(problem.filtered.map))]
    xy = np.array([best.atPoint2(key) for key in landmarks]).reshape(-1, 2)
    around = np.array([marginals.marginalCovariance(key) for key in landmarks]).reshape(-1, 2, 2)
    weights = np.array([problem.weight(number, best) for number in range(len(problem.used))])
    return problem.result((pose, spread), (xy, around), weights, optimizer.iterations())
