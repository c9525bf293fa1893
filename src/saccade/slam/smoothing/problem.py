"""Smoothing as a factor graph in GTSAM: variables, factors and errors.

Every pose and every landmark is a variable (Dellaert & Kaess 2006, "Square root SAM").
Observations have the robust loss of Huber (1964).
"""

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from saccade.errors import LogError, require
from saccade.extras import import_optional
from saccade.slam.filter.odometry_bias import unbiased
from saccade.slam.models import Motion
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
class SmoothConfig:
    """Parameters of the smoother."""

    method: Literal["batch", "fixed-lag"] = "batch"
    """The whole log at once, or with a fixed lag."""
    lag: float = 60.0
    """Of "fixed-lag": units of the log's time for which a pose may still change. Loops longer than
    the lag are not closed."""
    huber: float = 1.345
    """Normalized error beyond which an observation has less weight; the usual value keeps 95 % of
    the efficiency under Gaussian noise."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the first pose: metres, metres, radians."""
    iterations: int = 100
    """Largest number of Levenberg-Marquardt iterations; "batch" only."""

    def __post_init__(self) -> None:
        methods = ("batch", "fixed-lag")
        require(self.method in methods, "method", f"one of {methods}", self.method)
        require(0 < self.lag < np.inf, "lag", "over 0 and finite", self.lag)
        require(self.huber > 0, "huber", "a number above 0", self.huber)
        for name in ("motion_noise_scale", "sensor_noise_scale"):
            value = getattr(self, name)
            require(0 < value < 1e6, name, "over 0 and under 1e6", value)
        require(
            len(self.start_sigma) == 3 and all(0 <= s < 1e6 for s in self.start_sigma),
            "start_sigma",
            "three numbers from 0 to under 1e6",
            self.start_sigma,
        )
        require(self.iterations >= 1, "iterations", "at least 1", self.iterations)


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
        self, log: LandmarkLog, filtered: SlamResult, config: SmoothConfig, motion: Motion | None
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
        spread = np.diag(np.square(self.config.start_sigma))
        self.graph.add(self.gtsam.PriorFactorPose2(self.pose_key(0), start, self._noise(spread)))
        for step in steps.tolist():
            moved, _, Fu = self.motion(np.zeros(3), self.log.control[step])
            A = _rotation(-moved[2]) @ Fu  # GTSAM has errors in the frame of the later pose
            spread = A @ self.log.control_covariance[step] @ A.T
            along, left, turn = spread.diagonal()
            spread += ISOTROPIC_NOISE**2 * np.diag([along + left, along + left, turn])
            self.graph.add(
                self.gtsam.BetweenFactorPose2(
                    self.pose_key(self.variable[step]),
                    self.pose_key(self.variable[step + 1]),
                    self.gtsam.Pose2(*moved),
                    self._noise(spread * self.config.motion_noise_scale**2),
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
