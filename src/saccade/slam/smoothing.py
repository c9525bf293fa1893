"""Smoothing as a factor graph in GTSAM: variables, factors and errors.

Every pose and every landmark is a variable (Dellaert & Kaess 2006, "Square root SAM").
Observations have the robust loss of Huber (1964). Solved as one batch, or with a fixed lag: poses
that leave the sliding window are marginalized to a linear factor on their neighbors (Dong-Si &
Mourikis 2011, "Motion tracking with fixed-lag smoothing"); landmarks stay in the window.
"""

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from saccade.errors import LogError, Settings, setting
from saccade.extras import import_optional
from saccade.slam.filter.models import unbiased
from saccade.slam.models import MotionModel, inverse_observe
from saccade.slam.run import SlamResult, motion_of
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

MIN_SIGMA = 1e-4
"""Metres and radians of noise added to every measurement, so that no weight is infinite."""
ISOTROPIC_NOISE = 1e-2
"""Noise added to a control in every direction, relative to its largest in metres and in radians:
GTSAM fails where the roots of weights differ by more than a factor of about four thousand."""
MAX_NAMED = 5
"""Undetermined variables that an error names at most."""


@dataclass(frozen=True)
class SmoothConfig(Settings):
    """Parameters of the smoother."""

    method: Literal["batch", "fixed-lag"] = "batch"
    """The whole log at once, or with a fixed lag."""
    lag: float = setting(60.0, above=0)
    """Of "fixed-lag": units of the log's time for which a pose may still change. Loops longer than
    the lag are not closed."""
    huber: float = setting(1.345, above=0, maximum=np.inf)
    """Normalized error beyond which an observation has less weight; the usual value keeps 95 % of
    the efficiency under Gaussian noise."""
    motion_noise_scale: float = setting(1.0, above=0, below=1e6)
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = setting(1.0, above=0, below=1e6)
    """Factor on the standard deviations of the observations."""
    start_sigma: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 0, below=1e6)
    """Standard deviation of the first pose: metres, metres, radians."""
    iterations: int = setting(100, 1)
    """Largest number of Levenberg-Marquardt iterations; "batch" only."""


@dataclass(frozen=True, eq=False, repr=False)
class SmoothResult:
    """Smoothed trajectory and map: each estimate uses later measurements too."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, given the whole log, or the lag after each."""
    map: LandmarkMap
    """The filter's landmarks, with covariance."""
    weight: FloatArray
    """(k,) robust weight of each observation, from 0 to 1; NaN where it was not used."""
    iterations: int
    """Iterations until convergence; of a fixed lag, moves of the window."""

    def __repr__(self) -> str:
        return f"SmoothResult({self.trajectory!r}, {self.map!r}, {self.iterations} iterations)"


class SmoothingProblem:
    """The factor graph of a log: variables x0, x1, ... and l0, l1, ..., a factor a measurement.

    Args:
        log: controls and observations of range and bearing.
        filtered: result of the same log; the controls are corrected for its odometry biases.
        config: noise.
        motion: the motion model; by default that of the log's controls.

    Raises:
        ConfigError: GTSAM is not installed.
    """

    def __init__(
        self,
        log: LandmarkLog,
        filtered: SlamResult,
        config: SmoothConfig,
        motion: MotionModel | None,
    ) -> None:
        self.gtsam = import_optional("gtsam", "smooth")
        if filtered.odometry_bias is not None:
            log = replace(log, control=unbiased(log.control, filtered.odometry_bias))
        self.log, self.filtered, self.config = log, filtered, config
        self.motion = motion_of(log, motion)
        self.used = np.flatnonzero(filtered.association >= 0)
        """(u,) associated observations."""
        moves = log.control.any(1) | log.control_covariance.any((1, 2))  # (t,)
        self.variable = np.concatenate([[0], np.cumsum(moves)])
        """(t + 1,) pose variable of each pose; poses at standstill share one."""
        self.first = np.unique(self.variable, return_index=True)[1]
        """(v,) the first pose of each variable."""
        self.graph = self.gtsam.NonlinearFactorGraph()
        self._add_controls(np.flatnonzero(moves))
        self._add_observations()

    def __len__(self) -> int:
        return len(self.first)

    def control_factor(self, number: int) -> Any:
        """The factor of the motion to a pose variable; the prior of the first."""
        return self.graph.at(number)

    def observation_factor(self, number: int) -> Any:
        """The factor of an observation, by its index in `used`."""
        return self.graph.at(len(self) + number)

    def estimates(self) -> Any:
        """The filter's estimates as GTSAM's values."""
        values = self.gtsam.Values()
        for number, pose in enumerate(self.filtered.trajectory.pose[self.first]):
            values.insert(self.pose_key(number), self.gtsam.Pose2(*pose))
        for number, xy in enumerate(self.filtered.map.xy):
            values.insert(self.landmark_key(number), xy)
        return values

    def weight(self, number: int, values: Any) -> float:
        """Robust weight of an observation, by its index in `used`: k / e for errors e > k."""
        k, loss = self.config.huber, self.observation_factor(number).error(values)
        return 1.0 if loss <= k * k / 2 else k / (loss / k + k / 2)

    def pose(self, number: int, values: Any, covariance: Any) -> tuple[FloatArray, FloatArray]:
        """A pose (3,) and its covariance (3, 3) from GTSAM's, whose errors are in its frame."""
        pose = values.atPose2(self.pose_key(number))
        rotation = _rotation(pose.theta())
        return np.array([pose.x(), pose.y(), pose.theta()]), rotation @ covariance @ rotation.T

    def result(
        self,
        poses: tuple[FloatArray, FloatArray],
        landmarks: tuple[FloatArray, FloatArray],
        weights: FloatArray,
        iterations: int,
    ) -> SmoothResult:
        """The result by the variables' values and covariances, and the weights (u,)."""
        weight = np.full(len(self.log.observation), np.nan)
        weight[self.used] = weights
        pose, covariance = (each[self.variable] for each in poses)
        return SmoothResult(
            trajectory=Trajectory(self.log.time, pose, covariance),
            map=replace(self.filtered.map, xy=landmarks[0], covariance=landmarks[1]),
            weight=weight,
            iterations=iterations,
        )

    def check(self, values: Any) -> None:
        """Raise unless all variables are determined, which the optimizer does not report."""
        graph = self.gtsam.NonlinearFactorGraph(self.graph)
        named: list[str] = []
        while len(named) <= MAX_NAMED:
            try:
                graph.linearize(values).optimize()
                break
            except RuntimeError as error:
                kind, number = self.undetermined_variable(error)
                named.append(self.name(kind, number))
                self._hold(graph, values, kind, number)
        if named:
            more = " and others" if len(named) > MAX_NAMED else ""
            raise LogError(
                f"smoothing: expected measurements that determine every pose and landmark, found "
                f"that they leave open {', '.join(named[:MAX_NAMED])}{more}; "
                "are deviations in the log too large, or of very different size?"
            )

    def undetermined_variable(self, error: RuntimeError) -> tuple[str, int]:
        """The variable that GTSAM's error names; without one, raises its message in one line."""
        found = re.search(r"Symbol: ([xl])(\d+)", str(error))
        if found is None:
            raise LogError(f"smoothing: {' '.join(str(error).split())}") from error
        return found[1], int(found[2])

    def name(self, kind: str, number: int) -> str:
        """A variable as a pose or landmark of the log."""
        if kind == "x":
            step = int(self.first[number])
            return f"pose {step} (at {self.log.time[step]:g})"
        seen = int((self.filtered.association == number).sum())
        return f"landmark {self.filtered.map.names[number]} (seen {seen} time{'s' * (seen != 1)})"

    def pose_key(self, number: int) -> int:
        """The key of a pose variable."""
        return int(self.gtsam.symbol("x", int(number)))

    def landmark_key(self, number: int) -> int:
        """The key of a landmark."""
        return int(self.gtsam.symbol("l", int(number)))

    def _add_controls(self, steps: IntArray) -> None:
        start = self.gtsam.Pose2(*self.log.start)
        Q = np.diag(np.square(self.config.start_sigma))
        self.graph.add(self.gtsam.PriorFactorPose2(self.pose_key(0), start, self._noise(Q)))
        for step in steps.tolist():
            moved, _, Fu = self.motion(np.zeros(3), self.log.control[step])
            A = _rotation(-moved[2]) @ Fu  # GTSAM has errors in the frame of the later pose
            Q = A @ self.log.control_covariance[step] @ A.T
            along, left, turn = Q.diagonal()
            Q += ISOTROPIC_NOISE**2 * np.diag([along + left, along + left, turn])
            self.graph.add(
                self.gtsam.BetweenFactorPose2(
                    self.pose_key(self.variable[step]),
                    self.pose_key(self.variable[step + 1]),
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
                    self.pose_key(self.variable[self.log.observation_pose[k]]),
                    self.landmark_key(self.filtered.association[k]),
                    self.gtsam.Rot2(bearing),
                    distance,
                    self.gtsam.noiseModel.Robust.Create(huber, noise),
                )
            )

    def _hold(self, graph: Any, values: Any, kind: str, number: int) -> None:
        """Fix a variable, to find the next undetermined one."""
        if kind == "x":
            key, noise = self.pose_key(number), self._noise(np.zeros((3, 3)))
            graph.add(self.gtsam.PriorFactorPose2(key, values.atPose2(key), noise))
        else:
            key, noise = self.landmark_key(number), self._noise(np.zeros((2, 2)))
            graph.add(self.gtsam.PriorFactorPoint2(key, values.atPoint2(key), noise))

    def _noise(self, covariance: FloatArray) -> Any:
        return self.gtsam.noiseModel.Gaussian.Covariance(
            covariance + MIN_SIGMA**2 * np.eye(len(covariance))
        )


def _rotation(angle: float) -> FloatArray:
    """(3, 3) rotation of a pose by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


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


RELATIVE_CHANGE = 1e-6
"""Relative decrease of the error below which the optimizer stops."""


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: SmoothConfig | None = None,
    motion: MotionModel | None = None,
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
