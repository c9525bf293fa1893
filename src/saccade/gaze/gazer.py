"""Gaze by the map: the directions in which a camera looks next.

The winner-take-all network of the saliency map attends to the strongest position and inhibits it
for a while, so that attention moves on. Here the same happens in the map of the robot instead of
an image: a direction competes by what its landmarks would tell about the pose, by the area that
was never seen there, and by the salience of landmarks that were not looked at for long.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, cos, hypot, pi, sin

import numpy as np

from saccade.errors import require
from saccade.slam import Slam
from saccade.slam.filter.models import control_bias
from saccade.types import BoolArray, FloatArray, IntArray

POLICIES = ("fixed", "sweep", "random", "salient", "active")
"""The policies by name."""
Policy = Callable[["Gazer"], float]
"""A policy of one's own: from the gazer to a pan in radians."""
NUM_DIRECTIONS = 25
"""Pans that compete."""
MAX_LANDMARKS = 40
"""The nearest landmarks, those that a decision looks at."""
RANGE_SIGMA, BEARING_SIGMA = 0.1, 0.02
"""Of an observation that is expected, as a fraction of the range, and in radians."""


@dataclass(frozen=True)
class Look:
    """Where the camera looks."""

    pan: float
    """Radians to the left of the robot's heading."""
    tilt: float
    """Radians upwards; 0: the map is of the plane."""
    target: tuple[float, float]
    """x, y of the point in the map on which the camera is centered, in metres."""
    reason: str
    """Why, in a sentence."""


class Gazer:
    """Decides where the camera of a robot looks next.

    Args:
        slam: of the robot, live or with a loaded map.
        fov: horizontal field of view of the camera, in radians.
        reach: metres within which landmarks are observed.
        pan: least and greatest pan, in radians to the left of the heading.
        rate: radians per second at which the camera turns.
        period: seconds from one step of the robot to the next.
        policy: a name of `POLICIES`, or a function from the gazer to a pan.
        seed: of the policy "random".

    Raises:
        ConfigError: an argument is out of its range.
    """

    def __init__(
        self,
        slam: Slam,
        fov: float,
        reach: float,
        pan: tuple[float, float] = (-2.4, 2.4),
        rate: float = 2.0,
        *,
        period: float = 0.1,
        policy: str | Policy = "active",
        seed: int = 0,
    ) -> None:
        require(0 < fov <= 2 * pi, "fov", "over 0 and up to 2 pi", fov)
        require(reach > 0, "reach", "over 0", reach)
        require(-pi <= pan[0] <= pan[1] <= pi, "pan", "ascending, within pi", pan)
        require(rate > 0, "rate", "over 0", rate)
        require(period > 0, "period", "over 0", period)
        known = callable(policy) or policy in POLICIES
        require(known, "policy", ", ".join(POLICIES), policy)
        self.slam, self.fov, self.reach, self.limits = slam, fov, reach, pan
        self.rate, self.period = rate, period
        self.pan = float(np.clip(0.0, *pan))
        """Of the camera, in radians."""
        self.U = np.diag([1e-4, 1e-5])
        self.time = 0.0
        """Seconds since the first decision."""
        self.config = GazeConfig()
        self._policy: Policy = policy if callable(policy) else getattr(self, f"_{policy}")
        self._rng = np.random.default_rng(seed)
        self._seen_cells: set[tuple[int, int]] = set()
        self._last_seen: dict[object, float] = {}
        self._salience: dict[object, float] = {}
        self._plan = np.zeros((0, 2))
        self._reason = ""
        cells = np.arange(-ceil(reach), ceil(reach) + 1) + 0.0
        grid = np.stack(np.meshgrid(cells, cells), -1).reshape(-1, 2)
        self._offsets = grid[np.hypot(*grid.T) <= reach]

    def next(
        self, plan: FloatArray | None = None, salience: Mapping[object, float] | None = None
    ) -> Look:
        """The next look; the camera turns towards it as far as a step lets it.

        Args:
            plan: (h, 2) distance and turn of the next steps; by default straight on, by the last
                plan.
            salience: of landmarks by name, 1 for those without; remembered.
        """
        if plan is not None:
            self._plan = np.asarray(plan, np.float64).reshape(-1, 2)
        self._salience.update(salience or {})
        self._reason = "as the policy of the user says"
        goal = float(np.clip(self._policy(self), *self.limits))
        most = self.rate * self.period
        self.pan += float(np.clip(goal - self.pan, -most, most))
        self.time += self.period
        x, y, heading = self.slam.ekf.pose.tolist()
        direction = heading + self.pan
        target = x + self.reach / 2 * cos(direction), y + self.reach / 2 * sin(direction)
        return Look(self.pan, 0.0, target, self._reason)

    def observed(self, pan: float, names: object = ()) -> None:
        """Note what was seen: for inhibition of return, and the area that was never seen.

        Args:
            pan: of the camera.
            names: of the landmarks that were observed.
        """
        self.pan = float(pan)
        for name in np.asarray(names).ravel().tolist():
            self._last_seen[name] = self.time
        pose = self.slam.ekf.pose
        cells = self._cells(pose)
        bearing = wrapped(np.arctan2(*self._offsets.T[::-1]) - pose[2] - pan)
        self._seen_cells.update(map(tuple, cells[np.abs(bearing) <= self.fov / 2].tolist()))

    def _cells(self, pose: FloatArray) -> IntArray:
        """(c, 2) cells of a square metre within reach of a pose (3,)."""
        return np.floor(pose[:2] + self._offsets).astype(np.int64)

    def _fixed(self, _: "Gazer") -> float:
        """Straight ahead."""
        self._reason = "straight ahead"
        return 0.0

    def _sweep(self, _: "Gazer") -> float:
        """To and fro between the limits."""
        low, high = self.limits
        self._reason = "to and fro"
        phase = self.time * self.rate / max(high - low, 1e-9) % 2
        return low + (high - low) * (phase if phase < 1 else 2 - phase)

    def _random(self, _: "Gazer") -> float:
        """Another direction each second."""
        self._reason = "at random"
        if self.time % 1 < self.period:
            self._goal = float(self._rng.uniform(*self.limits))
        return self._goal

    def _salient(self, _: "Gazer") -> float:
        """To the most salient landmarks that were not looked at for long."""
        scene = self._scene()
        scores = scene.visible @ self._memory(scene)
        self._reason = "to salient landmarks that were not looked at for long"
        return scene.best(scores)

    def _active(self, _: "Gazer") -> float:
        """To what tells most: about the pose, of the area never seen, of remembered landmarks."""
        scene, config = self._scene(), self.config
        terms = {
            "landmarks that tell most about the pose": self._information(scene),
            "area that was never seen": config.area * self._new_area(scene),
            "salient landmarks that were not looked at for long": config.memory
            * (scene.visible @ self._memory(scene)),
        }
        scores = sum(terms.values())
        best = int(np.argmax(scores - config.turn * np.abs(scene.pan - self.pan)))
        self._reason = "to " + max(terms, key=lambda name: float(terms[name][best]))
        return float(scene.pan[best])

    def _scene(self) -> "Scene":
        """What is around the pose that the robot will have when the camera has turned."""
        low, high = self.limits
        pan = np.linspace(low, high, NUM_DIRECTIONS)
        ekf, motion = self.slam.ekf, self.slam.motion
        pose, r = ekf.pose, len(ekf.robot_state)
        F, Q = np.eye(r), np.zeros((r, r))
        for u in self._plan[: self.config.steps]:
            D = control_bias(u, r)
            pose, Fx, Fu = motion(pose, u)
            A = np.eye(r)
            A[:3, :3], A[:3, 3:] = Fx, Fu @ D
            F, Q = A @ F, A @ Q @ A.T
            Q[:3, :3] += Fu @ self.U @ Fu.T
        rows = np.flatnonzero(self.slam.confirmed)
        d = ekf.landmarks[rows] - pose[:2]
        away = np.hypot(d[:, 0], d[:, 1])
        near = np.flatnonzero(away <= self.reach)
        near = near[np.argsort(away[near])[:MAX_LANDMARKS]]
        bearing = wrapped(np.arctan2(d[near, 1], d[near, 0]) - pose[2])
        off = np.abs(wrapped(bearing - pan[:, None]))
        return Scene(pan, pose, F, Q, rows[near], off <= 0.45 * self.fov)

    def _information(self, scene: "Scene") -> FloatArray:
        """(c,) nats about the pose to come by the landmarks in view of each pan."""
        ekf, rows = self.slam.ekf, scene.rows
        gains = np.zeros(len(scene.pan))
        if len(rows) == 0:
            return gains
        r, C = len(ekf.robot_state), ekf.marginal(rows)
        C[:r], C[:, :r] = scene.F @ C[:r], (scene.F @ C[:r]).T if False else C[:, :r] @ scene.F.T
        C[:r, :r] = scene.F @ ekf.marginal(rows[:0]) @ scene.F.T + scene.Q
        C[r:, :r] = C[:r, r:].T
        robot = ekf.robot_state
        robot[:3] = scene.pose
        z, H = ekf.sensor.observe(robot, ekf.landmarks[rows])
        J = np.zeros((len(rows), 2, len(C)))
        J[..., :r] = H[..., :r]
        for k in range(len(rows)):
            J[k, :, r + 2 * k : r + 2 * k + 2] = H[k, :, r:]
        J = J.reshape(-1, len(C))
        cross = J @ C[:, :3]  # (2k, 3)
        noise = np.tile([RANGE_SIGMA, BEARING_SIGMA], len(rows))
        S = J @ C @ J.T + np.diag(np.square(noise)) / self.config.frames
        P = C[:3, :3] + np.diag([1e-8, 1e-8, 1e-10])
        before = np.linalg.slogdet(P)[1]
        patterns, which = np.unique(scene.visible, axis=0, return_inverse=True)
        for i, visible in enumerate(patterns):
            v = np.repeat(visible, 2)
            if v.any():
                after = P - cross[v].T @ np.linalg.solve(S[np.ix_(v, v)], cross[v])
                gains[which.ravel() == i] = (before - np.linalg.slogdet(after)[1]) / 2
        return gains

    def _new_area(self, scene: "Scene") -> FloatArray:
        """(c,) fraction of the area in view of each pan that was never seen."""
        cells = self._cells(scene.pose)
        new = np.array([cell not in self._seen_cells for cell in map(tuple, cells.tolist())])
        bearing = wrapped(np.arctan2(*self._offsets.T[::-1]) - scene.pose[2])
        view = np.abs(wrapped(bearing - scene.pan[:, None])) <= self.fov / 2
        return np.asarray((view & new).sum(1) / (len(cells) * self.fov / (2 * pi)))

    def _memory(self, scene: "Scene") -> FloatArray:
        """(k,) salience of the landmarks, inhibited where they were seen lately."""
        names = self.slam.landmark_names[scene.rows].tolist()
        salience = np.array([self._salience.get(name, 1.0) for name in names])
        since = np.array([self.time - self._last_seen.get(name, -np.inf) for name in names])
        return np.asarray(salience * (1 - np.exp(-since / self.config.inhibition)))


@dataclass(frozen=True)
class GazeConfig:
    """Weights of the policy "active"; all terms are of a look."""

    area: float = 3.0
    """Of a view of which all was never seen, in nats."""
    memory: float = 0.2
    """Of a salient landmark that was never looked at, in nats."""
    turn: float = 0.1
    """Nats that a turn of the camera by a radian costs."""
    inhibition: float = 10.0
    """Seconds after which a landmark is two thirds as attractive again as before."""
    steps: int = 10
    """Of the plan, after which the camera looks there."""
    frames: int = 5
    """Observations of a landmark in a look."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The pans that compete, and the landmarks around."""

    pan: FloatArray
    """(c,) radians."""
    pose: FloatArray
    """(3,) of the robot then."""
    F: FloatArray
    """(r, r) Jacobian of the robot then by that of now."""
    Q: FloatArray
    """(r, r) noise of the motion in between."""
    rows: IntArray
    """(k,) numbers of the landmarks."""
    visible: BoolArray
    """(c, k) whether each is in view."""

    def best(self, scores: FloatArray) -> float:
        """The pan with the best score (c,)."""
        return float(self.pan[int(np.argmax(scores))])


def wrapped(angle: FloatArray) -> FloatArray:
    """The same angles in [-pi, pi)."""
    return (angle + pi) % (2 * pi) - pi
