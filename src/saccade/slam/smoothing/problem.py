"""A drive as a least-squares problem in GTSAM's terms: its variables, its factors, and its errors.

Every pose and every landmark is a variable (Dellaert & Kaess 2006, "Square root SAM"). An
observation that does not fit counts less, after Huber (1964), instead of not at all.
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

STIFF = 1e-4
"""Metres and radians of noise that everything has: without any its weight would be infinite."""
EVEN = 1e-2
"""Noise of a control in every direction, by its largest in metres and in radians: GTSAM gives
up where weights differ by more than about four thousand in root."""
MAX_NAMED = 5
"""Variables that a complaint names before it only counts them."""


@dataclass(frozen=True)
class SmoothConfig:
    """How a drive is smoothed."""

    method: Literal["batch", "fixed-lag"] = "batch"
    """All of the drive at once, or each pose by what is seen until a while after it."""
    lag: float = 60.0
    """Of "fixed-lag": units of the log's time for which a pose may still change. One that is
    shorter than the loops of the drive keeps the drift that they would have closed."""
    huber: float = 1.345
    """Normalized error beyond which an observation counts less; the usual value keeps 95 % of
    the efficiency where all is well."""
    motion_noise_scale: float = 1.0
    """Factor on the standard deviations of the controls."""
    sensor_noise_scale: float = 1.0
    """Factor on the standard deviations of the observations."""
    start_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Standard deviation of the first pose: metres, metres, radians."""
    iterations: int = 100
    """Of Levenberg and Marquardt's method, at most; "batch" only."""

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
    """Where the robot was and where the landmarks are, given what the log says later too."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, each as it is believed at the end of the log, or at the end
    of the lag after it."""
    map: LandmarkMap
    """The filter's landmarks, with covariance."""
    weight: FloatArray
    """(k,) how much each observation counts, from 0 to 1; NaN where it was not used."""
    iterations: int
    """Until it converged; of a fixed lag, how often the window was moved on."""

    def __repr__(self) -> str:
        return f"SmoothResult({self.trajectory!r}, {self.map!r}, {self.iterations} iterations)"


class SmoothingProblem:
    """The log as GTSAM has it: variables x0, x1, ... and l0, l1, ..., a factor a measurement.

    Args:
        log: controls and observations of range and bearing.
        filtered: of the same log; its bias of the odometry is taken from the controls.
        config: noise.
        motion: what the controls mean; the log says it unless told otherwise.

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
        """(u,) observations that are part of it."""
        moves = log.control.any(1) | log.control_covariance.any((1, 2))  # (t,)
        self.variable = np.concatenate([[0], np.cumsum(moves)])
        """(t + 1,) of each pose; to stand is one variable."""
        self.first = np.unique(self.variable, return_index=True)[1]
        """(v,) the first pose of each variable."""
        self.graph = self.gtsam.NonlinearFactorGraph()
        self._add_controls(np.flatnonzero(moves))
        self._add_observations()

    def __len__(self) -> int:
        return len(self.first)

    def control_factor(self, number: int) -> Any:
        """The factor that leads to a pose variable; the prior for the first."""
        return self.graph.at(number)

    def observation_factor(self, number: int) -> Any:
        """The factor of an observation, by its place in `used`."""
        return self.graph.at(len(self) + number)

    def estimates(self) -> Any:
        """The filter's, as GTSAM's values."""
        values = self.gtsam.Values()
        for number, pose in enumerate(self.filtered.trajectory.pose[self.first]):
            values.insert(self.pose_key(number), self.gtsam.Pose2(*pose))
        for number, xy in enumerate(self.filtered.map.xy):
            values.insert(self.landmark_key(number), xy)
        return values

    def weight(self, number: int, values: Any) -> float:
        """Of an observation by its place in `used`, from its loss: k e - k^2 / 2 beyond e = k."""
        k, loss = self.config.huber, self.observation_factor(number).error(values)
        return 1.0 if loss <= k * k / 2 else k / (loss / k + k / 2)

    def pose(self, number: int, values: Any, covariance: Any) -> tuple[FloatArray, FloatArray]:
        """A pose (3,) and its covariance (3, 3) from GTSAM's, whose errors are in its own frame."""
        found = values.atPose2(self.pose_key(number))
        turn = _turned(found.theta())
        return np.array([found.x(), found.y(), found.theta()]), turn @ covariance @ turn.T

    def result(
        self,
        poses: tuple[FloatArray, FloatArray],
        landmarks: tuple[FloatArray, FloatArray],
        weights: FloatArray,
        iterations: int,
    ) -> SmoothResult:
        """Of the variables' values and covariances, and the weights (u,)."""
        weight = np.full(len(self.log.observation), np.nan)
        weight[self.used] = weights
        pose, spread = (each[self.variable] for each in poses)
        return SmoothResult(
            trajectory=Trajectory(self.log.time, pose, spread),
            map=replace(self.filtered.map, xy=landmarks[0], covariance=landmarks[1]),
            weight=weight,
            iterations=iterations,
        )

    def check(self, values: Any) -> None:
        """Raise unless all variables are determined: the optimizer itself hides it if not."""
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
        """The variable that GTSAM names; raise its words in one line if it names none."""
        found = re.search(r"Symbol: ([xl])(\d+)", str(error))
        if found is None:
            raise LogError(f"smoothing: {' '.join(str(error).split())}") from error
        return found[1], int(found[2])

    def name(self, kind: str, number: int) -> str:
        """A variable in the words of the log."""
        if kind == "x":
            step = int(self.first[number])
            return f"pose {step} (at {self.log.time[step]:g})"
        seen = int((self.filtered.association == number).sum())
        return f"landmark {self.filtered.map.id[number]} (seen {seen} time{'s' * (seen != 1)})"

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
            A = _turned(-moved[2]) @ Fu  # GTSAM has errors in the frame of the later pose
            spread = A @ self.log.control_covariance[step] @ A.T
            along, left, turn = spread.diagonal()
            spread += EVEN**2 * np.diag([along + left, along + left, turn])
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
        """Fix a variable, so that the next one that is not determined shows."""
        if kind == "x":
            key, noise = self.pose_key(number), self._noise(np.zeros((3, 3)))
            graph.add(self.gtsam.PriorFactorPose2(key, values.atPose2(key), noise))
        else:
            key, noise = self.landmark_key(number), self._noise(np.zeros((2, 2)))
            graph.add(self.gtsam.PriorFactorPoint2(key, values.atPoint2(key), noise))

    def _noise(self, covariance: FloatArray) -> Any:
        return self.gtsam.noiseModel.Gaussian.Covariance(
            covariance + STIFF**2 * np.eye(len(covariance))
        )


def _turned(angle: float) -> FloatArray:
    """A pose's frame turned by an angle, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
