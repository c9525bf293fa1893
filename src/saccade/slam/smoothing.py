"""The whole drive at once: what the filter associated, smoothed by GTSAM with robust noise.

Every pose and every landmark is a variable of one least-squares problem (Dellaert & Kaess 2006,
"Square root SAM"). An observation that does not fit counts less, after Huber (1964), instead
of not at all.
"""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from saccade.errors import LogError, require
from saccade.extras import import_optional
from saccade.slam.models import Motion
from saccade.slam.run import SlamResult, motion_of
from saccade.slam.wheels import unbiased
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap, Trajectory

STIFF = 1e-4
"""Metres and radians of noise that everything has: without any its weight would be infinite."""
EVEN = 1e-2
"""Noise of a control in every direction, by its largest in metres and in radians: GTSAM gives
up where weights differ by more than about four thousand in root."""
RELATIVE_CHANGE = 1e-6
"""Of the error, below which an iteration is the last."""
MOST_NAMED = 5
"""Variables that a complaint names before it only counts them."""


@dataclass(frozen=True)
class SmoothConfig:
    """How a drive is smoothed."""

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
    """Of Levenberg and Marquardt's method, at most."""

    def __post_init__(self) -> None:
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
    """Where the robot was and where the landmarks are, given all that the log says."""

    trajectory: Trajectory
    """(t + 1) poses with covariance, each as it is believed at the end of the log."""
    map: LandmarkMap
    """The filter's landmarks, with covariance."""
    weight: FloatArray
    """(k,) how much each observation counts, from 0 to 1; NaN where it was not used."""
    iterations: int
    """Until it converged."""

    def __repr__(self) -> str:
        return f"SmoothResult({self.trajectory!r}, {self.map!r}, {self.iterations} iterations)"


def smooth(
    log: LandmarkLog,
    filtered: SlamResult,
    config: SmoothConfig = SmoothConfig(),
    motion: Motion | None = None,
) -> SmoothResult:
    """Smooth a log over the association that the filter found.

    What the filter found the odometry to be off by is taken from the controls.

    Args:
        log: controls and observations of range and bearing.
        filtered: of the same log; where the smoothing begins.
        config: noise.
        motion: what the controls mean; the log says it unless told otherwise. One whose way does
            not depend on where it begins.

    Returns:
        Trajectory, map, and the weight of each observation.

    Raises:
        LogError: the log leaves variables undetermined; names them.
        ConfigError: GTSAM is not installed.
    """
    if filtered.odometry_bias is not None:
        log = replace(log, control=unbiased(log.control, filtered.odometry_bias))
    return _Graph(log, filtered, config, motion_of(log, motion)).solve()


class _Graph:
    """The log as GTSAM has it: variables x0, x1, ... and l0, l1, ..., a factor a measurement."""

    def __init__(
        self, log: LandmarkLog, filtered: SlamResult, config: SmoothConfig, motion: Motion
    ) -> None:
        self.gtsam = import_optional("gtsam", "smooth")
        self.log, self.filtered, self.config, self.motion = log, filtered, config, motion
        self.used = np.flatnonzero(filtered.association >= 0)
        self.graph = self.gtsam.NonlinearFactorGraph()
        self.values = self.gtsam.Values()
        moves = log.control.any(1) | log.control_covariance.any((1, 2))  # (t,)
        self.variable = np.concatenate([[0], np.cumsum(moves)])  # (t + 1,) to stand is one pose
        self._add_variables()
        self._add_controls(np.flatnonzero(moves))
        self._add_sightings()

    def solve(self) -> SmoothResult:
        parameters = self.gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(self.config.iterations)
        parameters.setRelativeErrorTol(RELATIVE_CHANGE)
        optimizer = self.gtsam.LevenbergMarquardtOptimizer(self.graph, self.values, parameters)
        best = optimizer.optimize()
        self._check(best)
        return self._result(best, optimizer.iterations())

    def _add_variables(self) -> None:
        pose = self.filtered.trajectory.pose
        for number, step in enumerate(np.unique(self.variable, return_index=True)[1].tolist()):
            self.values.insert(self._x(number), self.gtsam.Pose2(*pose[step]))
        for number, xy in enumerate(self.filtered.map.xy):
            self.values.insert(self._l(number), xy)

    def _add_controls(self, steps: IntArray) -> None:
        start = self.gtsam.Pose2(*self.log.start)
        spread = np.diag(np.square(self.config.start_sigma))
        self.graph.add(self.gtsam.PriorFactorPose2(self._x(0), start, self._noise(spread)))
        for step in steps.tolist():
            moved, _, Fu = self.motion(np.zeros(3), self.log.control[step])
            A = _turned(-moved[2]) @ Fu  # GTSAM has errors in the frame of the later pose
            spread = A @ self.log.control_covariance[step] @ A.T
            along, left, turn = spread.diagonal()
            spread += EVEN**2 * np.diag([along + left, along + left, turn])
            self.graph.add(
                self.gtsam.BetweenFactorPose2(
                    self._x(self.variable[step]),
                    self._x(self.variable[step + 1]),
                    self.gtsam.Pose2(*moved),
                    self._noise(spread * self.config.motion_noise_scale**2),
                )
            )

    def _add_sightings(self) -> None:
        huber = self.gtsam.noiseModel.mEstimator.Huber.Create(self.config.huber)
        R = self.log.observation_covariance[:, ::-1, ::-1]  # GTSAM puts the bearing first
        for k in self.used.tolist():
            distance, bearing = self.log.observation[k].tolist()
            noise = self._noise(R[k] * self.config.sensor_noise_scale**2)
            self.graph.add(
                self.gtsam.BearingRangeFactor2D(
                    self._x(self.variable[self.log.observation_pose[k]]),
                    self._l(self.filtered.association[k]),
                    self.gtsam.Rot2(bearing),
                    distance,
                    self.gtsam.noiseModel.Robust.Create(huber, noise),
                )
            )

    def _check(self, best: Any) -> None:
        """Whether all variables are determined: the optimizer itself hides it if not."""
        graph = self.gtsam.NonlinearFactorGraph(self.graph)
        named: list[str] = []
        while len(named) <= MOST_NAMED:
            try:
                graph.linearize(best).optimize()
                break
            except RuntimeError as error:
                found = re.search(r"Symbol: ([xl])(\d+)", str(error))
                if found is None:
                    raise LogError(f"smoothing: {' '.join(str(error).split())}") from error
                kind, number = found[1], int(found[2])
                named.append(self._name(kind, number))
                self._hold(graph, best, kind, number)
        if named:
            more = " and others" if len(named) > MOST_NAMED else ""
            raise LogError(
                f"smoothing: expected measurements that determine every pose and landmark, found "
                f"that they leave open {', '.join(named[:MOST_NAMED])}{more}; "
                "are deviations in the log too large, or of very different size?"
            )

    def _name(self, kind: str, number: int) -> str:
        if kind == "x":
            step = int(np.searchsorted(self.variable, number))
            return f"pose {step} (at {self.log.time[step]:g})"
        seen = int((self.filtered.association == number).sum())
        return f"landmark {self.filtered.map.id[number]} (seen {seen} time{'s' * (seen != 1)})"

    def _hold(self, graph: Any, best: Any, kind: str, number: int) -> None:
        """Fix a variable, so that the next one that is not determined shows."""
        if kind == "x":
            key, noise = self._x(number), self._noise(np.zeros((3, 3)))
            graph.add(self.gtsam.PriorFactorPose2(key, best.atPose2(key), noise))
        else:
            key, noise = self._l(number), self._noise(np.zeros((2, 2)))
            graph.add(self.gtsam.PriorFactorPoint2(key, best.atPoint2(key), noise))

    def _result(self, best: Any, iterations: int) -> SmoothResult:
        marginals = self.gtsam.Marginals(self.graph, best)
        pose, spread = np.empty((self.variable[-1] + 1, 3)), np.empty((self.variable[-1] + 1, 3, 3))
        for number in range(len(pose)):
            found = best.atPose2(self._x(number))
            turn = _turned(found.theta())
            pose[number] = found.x(), found.y(), found.theta()
            spread[number] = turn @ marginals.marginalCovariance(self._x(number)) @ turn.T
        before = self.filtered.map
        landmarks = [self._l(number) for number in range(len(before))]
        weight = np.full(len(self.log.observation), np.nan)
        weight[self.used] = self._weights(best)
        return SmoothResult(
            trajectory=Trajectory(self.log.time, pose[self.variable], spread[self.variable]),
            map=replace(
                before,
                xy=np.array([best.atPoint2(key) for key in landmarks]).reshape(-1, 2),
                covariance=np.array(
                    [marginals.marginalCovariance(key) for key in landmarks]
                ).reshape(-1, 2, 2),
            ),
            weight=weight,
            iterations=iterations,
        )

    def _weights(self, best: Any) -> FloatArray:
        """Of each observation, from its loss: k e - k^2 / 2 beyond e = k."""
        k = self.config.huber
        first = self.graph.size() - len(self.used)
        loss = np.array([self.graph.at(first + i).error(best) for i in range(len(self.used))])
        return np.where(loss <= k * k / 2, 1.0, k / (loss / k + k / 2))

    def _noise(self, covariance: FloatArray) -> Any:
        return self.gtsam.noiseModel.Gaussian.Covariance(
            covariance + STIFF**2 * np.eye(len(covariance))
        )

    def _x(self, number: int) -> int:
        return int(self.gtsam.symbol("x", int(number)))

    def _l(self, number: int) -> int:
        return int(self.gtsam.symbol("l", int(number)))


def _turned(angle: float) -> FloatArray:
    """A pose's frame turned by an angle, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
