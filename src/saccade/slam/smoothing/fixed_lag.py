"""Fixed-lag smoothing: each pose by the measurements until a fixed time after it.

Poses that leave the sliding window are marginalized to a linear factor on their neighbors
(Dong-Si & Mourikis 2011, "Motion tracking with fixed-lag smoothing"). Landmarks stay in the
window. By GTSAM's incremental smoother.
"""

from typing import Any

import numpy as np

from saccade.errors import LogError
from saccade.slam.models import inverse_observe
from saccade.slam.smoothing.problem import SmoothingProblem, SmoothResult
from saccade.types import FloatArray

MOVES_PER_LAG = 10
"""Times that the window is moved within one lag."""
RELINEARIZE_THRESHOLD = 0.003
"""Metres and radians by which a variable must change before its factors are relinearized."""


def smooth_fixed_lag(problem: SmoothingProblem) -> SmoothResult:
    """Smooth a drive with a fixed lag.

    Args:
        problem: of the whole drive, with the lag in its settings.

    Raises:
        LogError: the measurements leave variables undetermined; names them.
    """
    time = problem.log.time[problem.first] - problem.log.time[0]
    newest = _newest_poses(time, problem.config.lag / MOVES_PER_LAG)
    window = _Window(problem)
    begin = 0
    for end, later in zip(newest, [*newest[1:], -1], strict=True):
        window.advance(begin, end, float(time[end]), time)
        end_left = len(time)  # all poses leave at the end of the log
        if later >= 0:  # those that are as old as the lag leave at the next move
            end_left = int(np.searchsorted(time, time[later] - problem.config.lag, "right"))
        window.record(min(end_left, end + 1))
        begin = end + 1
    return window.result(len(newest))


class _Window:
    """The sliding window, and the estimates of the variables that left it."""

    def __init__(self, problem: SmoothingProblem) -> None:
        gtsam = problem.gtsam
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")  # Cholesky fails on stretches without observations
        parameters.setRelinearizeThreshold(RELINEARIZE_THRESHOLD)
        parameters.relinearizeSkip = 1
        parameters.findUnusedFactorSlots = True
        self.problem = problem
        self.smoother = gtsam.IncrementalFixedLagSmoother(problem.config.lag, parameters)
        self.values = gtsam.Values()
        self.known: set[int] = set()
        observed_from = problem.variable[problem.log.observation_pose[problem.used]]
        self.edge = np.searchsorted(observed_from, np.arange(len(problem) + 1))
        self.pose = np.empty((len(problem), 3))
        self.covariance = np.empty((len(problem), 3, 3))
        self.weights = np.empty(len(problem.used))
        self.recorded = 0

    def advance(self, begin: int, end: int, now: float, time: FloatArray) -> None:
        """Add the pose variables from `begin` to `end`, with the observations from them."""
        problem, gtsam = self.problem, self.problem.gtsam
        factors, values, stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        pose = self.values.atPose2(problem.pose_key(begin - 1)) if begin > 0 else None
        for number in range(begin, end + 1):
            control = problem.control_factor(number)
            pose = control.prior() if pose is None else pose.compose(control.measured())
            factors.add(control)
            values.insert(problem.pose_key(number), pose)
            stamps[problem.pose_key(number)] = float(time[number])
            for each in range(self.edge[number], self.edge[number + 1]):
                factors.add(problem.observation_factor(each))
                self._initialize(each, pose, values)
        stamps.update(dict.fromkeys(map(problem.landmark_key, self.known), now))
        try:
            self.smoother.update(factors, values, stamps)
            for _ in range(problem.config.iterations):
                if self.smoother.getISAM2Result().getVariablesRelinearized() == 0:
                    break
                self.smoother.update()
            self.values = self.smoother.calculateEstimate()
        except RuntimeError as error:
            raise self._refusal(error) from error

    def record(self, end: int) -> None:
        """Record the estimates of the pose variables before `end`."""
        for number in range(self.recorded, end):
            covariance = self.smoother.marginalCovariance(self.problem.pose_key(number))
            estimate = self.problem.pose(number, self.values, covariance)
            self.pose[number], self.covariance[number] = estimate
            for each in range(self.edge[number], self.edge[number + 1]):
                self.weights[each] = self.problem.weight(each, self.values)
        self.recorded = max(self.recorded, end)

    def result(self, moves: int) -> SmoothResult:
        problem, drive = self.problem, self.problem.gtsam.Values(self.values)
        for number, pose in enumerate(self.pose):
            if drive.exists(problem.pose_key(number)):
                drive.erase(problem.pose_key(number))
            drive.insert(problem.pose_key(number), problem.gtsam.Pose2(*pose))
        problem.check(drive)
        keys = list(map(self.problem.landmark_key, range(len(self.problem.filtered.map))))
        xy = np.array([self.values.atPoint2(key) for key in keys]).reshape(-1, 2)
        covariance = np.array([self.smoother.marginalCovariance(key) for key in keys])
        return self.problem.result(
            (self.pose, self.covariance), (xy, covariance.reshape(-1, 2, 2)), self.weights, moves
        )

    def _initialize(self, each: int, pose: Any, values: Any) -> None:
        """Initialize a landmark at its first observation."""
        k = self.problem.used[each]
        number = int(self.problem.filtered.association[k])
        if number not in self.known:
            self.known.add(number)
            start = np.array([pose.x(), pose.y(), pose.theta()])
            values.insert(
                self.problem.landmark_key(number),
                inverse_observe(start, self.problem.log.observation[k])[0],
            )

    def _refusal(self, error: RuntimeError) -> LogError:
        name = self.problem.name(*self.problem.undetermined_variable(error))
        return LogError(
            f"smoothing: expected measurements that determine every pose and landmark within the "
            f"lag of {self.problem.config.lag:g}, found that they leave open {name}; a longer lag "
            "may, or the deviations in the log are too large, or of very different size"
        )


def _newest_poses(time: FloatArray, every: float) -> list[int]:
    """The newest pose of each position of the window; none is moved across a longer gap."""
    stops: list[int] = []
    last = before = 0.0
    for number, now in enumerate(time.tolist()):
        if now - before > every and number - 1 not in stops[-1:]:
            stops.append(number - 1)
        before = now
        if now - last >= every:
            stops.append(number)
            last = now
    if not stops or stops[-1] < len(time) - 1:
        stops.append(len(time) - 1)
    return stops
