"""EKF-SLAM playground: a simulated robot and one filter of each kind on the same measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from saccade.errors import LogError, Settings, require, setting
from saccade.serving.recent import Recent
from saccade.serving.requests import chosen
from saccade.settings import settings_from, update_settings
from saccade.slam import ERRORS, EkfConfig, Slam
from saccade.slam.consistency import chi_square_gate, normalized_squared, pose_nees
from saccade.slam.filter.robot_models import turn_then_translate, wrap
from saccade.types import THREE_SIGMA_2D, FloatArray, IntArray, Trajectory

MAX_WORLD_LANDMARKS = 60
"""Maximum number of landmarks in a world."""
START = (0.0, -10.0, 0.0)
"""True first pose."""
MIN_OBSERVED_RANGE = 0.1
"""Minimum range of an observation, in meters."""
RINGS = ((8.0, 7), (12.0, 9))
"""Radius in meters and number of landmarks of each initial ring."""
MAX_SESSIONS = 64
"""Maximum number of sessions in memory, least recently used dropped first."""
MAX_LANDMARK_COORDINATE = 100.0
"""Maximum coordinate of a landmark along each axis, in meters."""
MAX_STEPS = 5000
"""Maximum number of steps in a session."""
MAX_STEPS_AT_ONCE = 50
"""Maximum number of steps in a request."""
MAX_STEP_DISTANCE = 2.0
"""Maximum distance of one step in meters."""
MAX_TURN = np.pi
"""Maximum turn of one step in radians."""
SURE_AND_WRONG = 0.999
"""Quantile of the NEES for the verdict "sure and wrong"."""


@dataclass(frozen=True)
class PlaygroundNoise(Settings):
    """Noise of the odometry and the sensor of the simulated robot."""

    distance_percent: float = setting(10.0, 0, 20)
    """Standard deviation of the odometry's distance, in percent of it."""
    turn_sigma_deg: float = setting(6.0, 0, 10)
    """Standard deviation of the odometry's turn in a step, in degrees."""
    range_percent: float = setting(5.0, 0.5, 20)
    """Standard deviation of a range, in percent of it."""
    bearing_sigma_deg: float = setting(3.0, 0.2, 10)
    """Standard deviation of a bearing, in degrees."""
    max_range: float = setting(4.0, 1, 20)
    """Maximum range of an observation, in meters."""
    assumed_factor: float = setting(1.0, 0.2, 5)
    """Ratio of the standard deviations assumed by the filters to the true values."""


class Scan(NamedTuple):
    """Odometry of a step and the observations after it."""

    control: FloatArray | None
    """(2,) distance and turn; None if the robot stood still."""
    U: FloatArray | None
    """(2, 2) covariance of the control."""
    z: FloatArray
    """(k, 2) range and bearing."""
    R: FloatArray
    """(k, 2, 2) covariances of the observations."""
    labels: IntArray
    """(k,) labels of the landmarks."""


class World:
    """True pose of a robot and landmarks; generates noisy measurements."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self.pose = np.array(START)
        """(3,) x, y in meters, heading in radians."""
        self.landmarks: dict[int, FloatArray] = {}
        """Position (2,) by label."""
        self._num_added = 0

    def add(self, xy: FloatArray) -> None:
        """Add landmarks (n, 2)."""
        room = MAX_WORLD_LANDMARKS - len(self.landmarks)
        require(len(xy) <= room, "landmarks", f"at most {room} more", len(xy))
        self.landmarks |= dict(enumerate(xy, self._num_added))
        self._num_added += len(xy)

    def move(self, command: FloatArray | None, noise: PlaygroundNoise) -> Scan:
        """Executes a command (2,), distance and turn, and measures; None stands still."""
        control, U = None, None
        if command is not None:
            self.pose, _, _ = turn_then_translate(self.pose, command)
            distance = noise.distance_percent / 100 * abs(command[0])
            sigma = np.array([distance, np.deg2rad(noise.turn_sigma_deg)])
            control = command + sigma * self._rng.standard_normal(2)
            U = np.diag(np.square(noise.assumed_factor * sigma))
        labels = np.array([*self.landmarks], np.int64)
        offset = np.array([*self.landmarks.values()]).reshape(-1, 2) - self.pose[:2]
        distance = np.hypot(*offset.T)
        observed = (distance >= MIN_OBSERVED_RANGE) & (distance <= noise.max_range)
        bearing = wrap(np.arctan2(offset[:, 1], offset[:, 0]) - self.pose[2])
        z = np.stack([distance, bearing], 1)[observed]
        sigma = np.empty(z.shape)
        sigma[:, 0] = noise.range_percent / 100 * z[:, 0]
        sigma[:, 1] = np.deg2rad(noise.bearing_sigma_deg)
        z += sigma * self._rng.standard_normal(z.shape)
        z[:, 0] = np.abs(z[:, 0])
        R = np.square(noise.assumed_factor * sigma)[:, :, None] * np.eye(2)
        return Scan(control, U, z, R, labels[observed])


def rings() -> list[list[float]]:
    """Initial landmarks, inside and outside the circle through the first pose."""
    angles = [(radius, 2 * np.pi * (i + 0.25) / n) for radius, n in RINGS for i in range(n)]
    return [[radius * float(np.cos(a)), radius * float(np.sin(a))] for radius, a in angles]


class Session:
    """A world with one filter of each kind of `EkfConfig.filter`.

    Args:
        seed: seed of the noise.
        landmarks: (n, 2) positions of the landmarks.
    """

    def __init__(self, seed: int, landmarks: FloatArray) -> None:
        self.world = World(seed)
        self.world.add(landmarks)
        self.num_steps = 0
        self.filters: dict[str, Slam] = {name: Slam(_config(name), start=START) for name in ERRORS}
        self.scores: dict[str, list[tuple[float, bool]]] = {name: [] for name in ERRORS}
        """NEES of each pose by filter, NaN for a certain pose, and whether the true position was in
        the 99.7 % ellipse."""

    def step(self, command: FloatArray | None, noise: PlaygroundNoise) -> dict[str, Any]:
        """Runs a step with every filter; returns the observations and all estimates."""
        scan = self.world.move(command, noise)
        truth, time = self.world.pose, float(self.num_steps)
        estimates = {}
        for name, slam in self.filters.items():
            result = slam.step(time, *scan)
            error = result.pose - truth
            error[2] = wrap(error[2])
            estimate = Trajectory(np.zeros(1), result.pose[None], result.covariance[None])
            true = Trajectory(np.zeros(1), truth[None])
            nees = float(pose_nees(estimate, true, slam.config.errors)[0])
            inside = not np.isnan(nees) and bool(
                normalized_squared(error[:2], result.covariance[:2, :2]) <= THREE_SIGMA_2D
            )
            self.scores[name].append((nees, inside))
            estimates[name] = {
                "pose": result.pose.tolist(),
                "error": error.tolist(),
                "sigma": np.sqrt(np.diagonal(result.covariance).clip(0)).tolist(),
                "nees": _finite(nees),
            }
        self.num_steps += 1
        return {"truth": truth.tolist(), "observed": scan.labels.tolist(), "filters": estimates}

    def map_of(self, name: str) -> dict[str, Any]:
        """Landmarks of one filter, and the correlation matrix of pose and landmarks."""
        slam = self.filters[name]
        ekf, ids = slam.filter, slam.filter.ids
        covariance = ekf.covariance
        state = np.delete(np.arange(len(covariance)), slice(3, len(ekf.robot_state)))
        sigma = np.sqrt(np.diagonal(covariance).clip(1e-300))
        correlation = (covariance / np.outer(sigma, sigma))[np.ix_(state, state)]
        blocks = ekf.landmark_covariances.reshape(-1, 4)[:, [0, 1, 3]]
        return {
            "labels": np.array(slam.landmarks.labels_of(ids.tolist()), np.int64),
            "landmarks": np.hstack([ekf.landmarks, blocks]).ravel(),
            "covariance": ekf.pose_covariance[[0, 0, 1], [0, 1, 1]],
            "correlation": correlation.ravel(),
        }

    def summary(self, name: str) -> dict[str, Any]:
        """Errors of a filter, with its estimated covariance."""
        slam, landmarks = self.filters[name], self.world.landmarks
        found, labels = slam.map, slam.map.label.tolist()
        known = [i for i, label in enumerate(labels) if label in landmarks]
        truth = np.array([landmarks[labels[i]] for i in known]).reshape(-1, 2)
        error = truth - found.xy[known]
        squared = normalized_squared(error, found.covariance[known])
        scores = np.array(self.scores[name])
        nees, inside = scores[np.isfinite(scores[:, 0])].T
        last = scores[-1, 0]
        return {
            "nees": _finite(last),
            "mean_nees": float(nees.mean()) if len(nees) else None,
            "inside_percent": 100 * float(inside.mean()) if len(nees) else None,
            "wrong": None if np.isnan(last) else bool(last > chi_square_gate(3, SURE_AND_WRONG)),
            "landmarks": len(known),
            "inside_landmarks": int((squared <= THREE_SIGMA_2D).sum()),
        }


class Playground:
    """Keeps the most recent sessions in memory and runs their steps."""

    def __init__(self) -> None:
        self.sessions: Recent[Session] = Recent(MAX_SESSIONS, "session")

    def start(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Starts a session.

        Args:
            request: "seed" of the noise, "landmarks" as pairs of meters (by default two rings), and
                the keys of `step`.

        Raises:
            SaccadeError: a value outside its range.
        """
        seed = request.get("seed", 0)
        require(type(seed) is int and 0 <= seed < 2**31, "seed", "0 to 2147483647", seed)
        landmarks = positions(request.get("landmarks", rings()), "landmarks")
        noise, name = _noise(request), chosen(request, "filter", ERRORS, "standard")
        session = Session(seed, landmarks)
        steps = [session.step(None, noise)]
        return {"session": self.sessions.add(session), **_state(session, steps, name)}

    def step(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Runs steps in a session.

        Args:
            request: "session", "commands" (each a distance in meters and a turn in radians, or
                null to stand still and observe), "add" and "remove" (positions and labels of
                landmarks), "noise" by the names of `PlaygroundNoise`, and the "filter" whose map
                is returned.

        Raises:
            KeyError: the session is not in memory.
            SaccadeError: a value outside its range, too many steps, or an estimate that diverged.
        """
        token = request.get("session")
        session = self.sessions[token]
        commands = commands_from(request.get("commands", []))
        noise, name = _noise(request), chosen(request, "filter", ERRORS, "standard")
        added = positions(request.get("add", []), "add")
        removed = request.get("remove", [])
        is_known = isinstance(removed, list) and all(
            type(each) is int and each in session.world.landmarks for each in removed
        )
        require(is_known, "remove", "labels of landmarks", removed)
        left = MAX_STEPS - session.num_steps
        require(len(commands) <= left, "commands", f"{left} more steps; start again", len(commands))
        session.world.add(added)
        for each in set(removed):
            del session.world.landmarks[each]
        try:
            steps = [session.step(each, noise) for each in commands]
        except LogError:
            self.sessions.remove(str(token))  # its filters are at different steps
            raise
        return _state(session, steps, name)

    def warm_up(self) -> None:
        """Compiles all kernels, so that the first session does not have to wait."""
        playground = Playground()
        token = playground.start({})["session"]
        playground.step({"session": token, "commands": [[0.5, 0.05], None]})


def commands_from(value: Any) -> list[FloatArray | None]:
    """The commands in a request; None stands still."""
    is_list = isinstance(value, list) and len(value) <= MAX_STEPS_AT_ONCE
    require(is_list, "commands", f"a list of at most {MAX_STEPS_AT_ONCE}", value)
    limits = f"a distance up to {MAX_STEP_DISTANCE:g} m and up to half a turn, or null"
    return [
        None
        if each is None
        else _pairs("commands", [each], 1, (MAX_STEP_DISTANCE, MAX_TURN), limits)[0]
        for each in value
    ]


def positions(value: Any, name: str) -> FloatArray:
    """(n, 2) positions in a request."""
    largest, count = MAX_LANDMARK_COORDINATE, MAX_WORLD_LANDMARKS
    limits = f"at most {count} positions within {largest:g} m along each axis"
    return _pairs(name, value, count, (largest, largest), limits)


def _pairs(
    name: str, value: Any, count: int, largest: tuple[float, float], expected: str
) -> FloatArray:
    """(n, 2) at most `count` pairs of numbers with limited magnitudes."""
    try:
        pairs = np.array(value or np.empty((0, 2)), np.float64)
    except (TypeError, ValueError, OverflowError):
        pairs = np.empty(0)
    is_valid = pairs.shape[1:] == (2,) and len(pairs) <= count and (np.abs(pairs) <= largest).all()
    require(bool(is_valid), name, expected, value)
    return pairs


def _finite(value: float) -> float | None:
    """A number for JSON, with None for NaN."""
    return float(value) if np.isfinite(value) else None


def _config(name: str) -> EkfConfig:
    """Settings of a filter with known labels; filters differ in their kind only."""
    values = {"errors": name, "association": "known", "recover": False, "huber": np.inf}
    config: EkfConfig = settings_from("slam", values, "playground")
    return config


def _state(session: Session, steps: Sequence[Mapping[str, Any]], name: str) -> dict[str, Any]:
    """The new steps, the world, the map of one filter, and all scores, for the page."""
    landmarks = session.world.landmarks
    return {
        "steps": list(steps),
        "labels": list(landmarks),
        "landmarks": [each.tolist() for each in landmarks.values()],
        "filter": name,
        "map": session.map_of(name),
        "summary": {each: session.summary(each) for each in session.filters},
    }


def _noise(request: Mapping[str, Any]) -> PlaygroundNoise:
    noise: PlaygroundNoise = update_settings(PlaygroundNoise(), request.get("noise", {}), "noise")
    return noise
