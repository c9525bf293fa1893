"""Active gaze: the next direction of view of a robot's camera, chosen in the map.

The winner-take-all network of the saliency map attends to the most salient position of an image,
and inhibition of return moves attention on. Here both meet SLAM: directions of view compete in the
map, by the landmarks that they let the robot observe, and landmarks that were just looked at are
inhibited.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, cos, exp, pi, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.extras import import_function
from saccade.landmark_names import parse_labels
from saccade.slam.filter.robot_models import (
    as_relative_pose,
    compose,
    observe_with_errors,
    stack_jacobians,
    wrap,
)
from saccade.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from saccade.slam import Slam

HORIZON = 2.0
"""Duration of the rollout in seconds."""
ROLLOUT_POSES = 4
"""Number of poses in the rollout, even."""
MAX_LANDMARKS = 24
"""Largest number of landmarks in a decision, the nearest ones, of which no two share a square
meter."""
RELATIVE_RANGE_SIGMA = 0.03
"""Default standard deviation of a range, as a fraction of the range."""
BEARING_SIGMA = 0.01
"""Default standard deviation of a bearing, in radians."""
VIEW_MARGIN = 0.05
"""Width of the margin at each side of the field of view, as a fraction; nothing in it is seen."""
AREA = 1.0
"""Weight in nats of a view whose whole area is new."""
TEMPERATURE = 0.05
"""Temperature of the softmax that draws a pan, in nats."""
GOAL_DURATION = 0.8
"""Duration in seconds for which a drawn pan is kept."""
INHIBITION_TIME = 10.0
"""Time constant of the inhibition of return, in seconds."""
MISS_MEMORY = 30.0
"""Time constant of the decay of the number of misses of a landmark, in seconds."""
PAN_TOLERANCE = 0.05
"""Largest distance of a measured pan from the limits, in radians."""
SWEEP_RATE = 0.5
"""Rate of a sweep in radians per second, slow enough to track points."""


@dataclass(frozen=True)
class Look:
    """A direction of view."""

    pan: float
    """Radians to the left of the robot's heading."""
    tilt: float
    """Radians up; 0, as the map is planar."""
    target: tuple[float, float]
    """x, y in the map of the point on the optical axis at half the largest range, in meters."""
    reason: str
    """Reason of the choice."""


class Gazer:
    """Chooses the next direction of view of a robot's camera.

    Args:
        slam: SLAM of the robot, live or with a loaded map; only read.
        fov: horizontal field of view of the camera, in radians.
        max_range: largest range of an observation, in meters.
        pan: least and greatest pan, in radians to the left of the heading.
        rate: angular rate of the camera, in radians per second.
        policy: a name in `POLICIES`; or a function from the gazer to a pan in radians, or its name
            as module:function.
        period: seconds between decisions, and of one control of a plan.
        seed: seed of the policy "random".
        odometry: standard deviations of the motion after one meter, in meters and radians.
        pan_sigma: standard deviation of the measured pan, in radians.
        sensor: function from ranges (k,) in meters to the standard deviations (k, 2) of ranges and
            bearings that are measured there, without the error of the pan.

    Raises:
        ConfigError: an argument is out of its range, or the policy unknown.

    Examples:
        >>> import numpy as np
        >>> from saccade.gaze import Gazer
        >>> from saccade.slam import Slam
        >>> slam = Slam()
        >>> R = np.diag([0.1, 0.02]) ** 2
        >>> _ = slam.step(0.0, z=np.array([[4.0, 1.5]]), R=R, labels=[7])
        >>> gazer = Gazer(slam, fov=0.9, max_range=8.0, policy="salient", period=1.0)
        >>> gazer.next().pan > 1
        True
    """

    def __init__(
        self,
        slam: "Slam",
        fov: float,
        max_range: float,
        pan: tuple[float, float] = (-2.4, 2.4),
        rate: float = 2.0,
        policy: "str | Policy" = "active",
        *,
        period: float = 0.1,
        seed: int = 0,
        odometry: tuple[float, float] = (0.02, 0.02),
        pan_sigma: float = 0.0,
        sensor: "Sensor | None" = None,
    ) -> None:
        require(0 < fov <= 2 * pi, "fov", "over 0 and up to 2 pi", fov)
        require(0 < max_range < 1e3, "max_range", "over 0 and under 1000", max_range)
        require(-2 * pi <= pan[0] <= pan[1] <= 2 * pi, "pan", "ascending, within 2 pi", pan)
        require(rate > 0, "rate", "over 0", rate)
        require(0 < period <= HORIZON, "period", f"over 0 and up to {HORIZON}", period)
        require(0 <= pan_sigma <= 1, "pan_sigma", "from 0 to 1", pan_sigma)
        self.slam, self.fov, self.max_range, self.limits = slam, fov, max_range, pan
        self.rate, self.period = rate, period
        self.pan = float(np.clip(0.0, *pan))
        """Present pan in radians."""
        self.time = 0.0
        """Seconds since the first decision."""
        self.plan = np.zeros((0, 2))
        """(h, c) controls of the next periods."""
        self.salience: dict[object, float] = {}
        """Salience of landmarks by label; 1 for others."""
        self.last_seen: dict[object, float] = {}
        """Time of the last observation of each landmark, by label."""
        self.misses: dict[object, tuple[float, float]] = {}
        """Decayed number of misses of each landmark and the time of the last one, by label."""
        self.candidates = np.linspace(*pan, max(1, ceil(3 * (pan[1] - pan[0]) / fov)) + 1)
        """(c,) candidate pans, at most a third of the field of view apart."""
        self._policy: Policy = policy_of(policy)
        self._reason = "a custom policy"
        self._rng = np.random.default_rng(seed)
        self._goal, self._decided = 0.0, -np.inf
        self._odometry, self._pan_sigma = odometry, pan_sigma
        self._sensor: Sensor = sensor or _default_sensor
        self._seen_cells: set[tuple[int, int]] = set()
        cells = np.arange(-ceil(max_range), ceil(max_range) + 1)
        self._around = np.stack(np.meshgrid(cells, cells), -1).reshape(-1, 2)

    def next(
        self, plan: FloatArray | None = None, salience: Mapping[object, float] | None = None
    ) -> Look:
        """Turns the camera towards the goal of the policy, as far as its rate allows.

        Args:
            plan: (h, c) controls of the next periods, in the convention of the motion model; the
                last one is repeated. By default the robot goes straight on as in the last plan.
            salience: salience of landmarks by label, in [0, 1]; kept for later decisions.
        """
        if plan is not None:
            self.plan = np.asarray(plan, np.float64)
        elif len(self.plan):
            self.plan = self.plan[:1] * (np.arange(self.plan.shape[1]) == 0)
        self.salience.update(salience or {})
        goal = float(np.clip(self._policy(self), *self.limits))
        turn = self.rate * self.period
        self.pan = float(np.clip(self.pan + np.clip(goal - self.pan, -turn, turn), *self.limits))
        self.time += self.period
        x, y, heading = self.slam.filter.pose.tolist()
        direction, half = heading + self.pan, self.max_range / 2
        target = x + half * cos(direction), y + half * sin(direction)
        return Look(self.pan, 0.0, target, self._reason)

    def record(self, *, pan: float, labels: npt.ArrayLike = (), missed: npt.ArrayLike = ()) -> None:
        """Records an observation, for the inhibition of return, the misses and the new area.

        Args:
            pan: measured pan of the camera, in radians, within its limits widened by
                `PAN_TOLERANCE` and five `pan_sigma`.
            labels: (k,) labels of the observed landmarks.
            missed: (m,) labels of landmarks that were expected in view and not found.

        Raises:
            ConfigError: the pan is outside these limits.
        """
        low, high = self.limits
        tolerance = PAN_TOLERANCE + 5 * self._pan_sigma
        inside = low - tolerance <= pan <= high + tolerance
        require(inside, "pan", f"radians from {low:g} to {high:g}", pan)
        self.pan = float(pan)
        self.last_seen |= dict.fromkeys(parse_labels(np.ravel(labels)), self.time)
        for label in parse_labels(np.ravel(missed)):
            self.misses[label] = self._misses_of(label) + 1, self.time
        pose = self.slam.filter.pose
        cells = self._cells(pose)
        seen = self._sees(pose[None], np.array([[self.pan]]), cells + 0.5)[0, 0]
        self._seen_cells.update(map(tuple, cells[seen].tolist()))

    def add_pan_error(self, R: FloatArray) -> FloatArray:
        """Covariances (k, 2, 2) of ranges and bearings of one scan, with the error of the pan.

        All k bearings share it: each gets k times its variance, so that together they carry the
        information of one measurement of the pan.
        """
        return np.asarray(R + len(R) * np.diag([0.0, self._pan_sigma**2]))

    def _fixed(self) -> float:
        self._reason = "straight ahead"
        return 0.0

    def _sweep(self) -> float:
        self._reason = "to and fro"
        low, high = self.limits
        span = max(high - low, 1e-9)
        phase = (SWEEP_RATE * self.time - low) % (2 * span)
        return low + min(phase, 2 * span - phase)

    def _random(self) -> float:
        self._reason = "at random"
        if self.time % 1 < self.period:
            self._goal = float(self._rng.choice(self.candidates))
        return self._goal

    def _salient(self) -> float:
        """The pan with the most remembered salience; of equal ones, the nearest."""
        self._reason = "salient landmarks"
        salience = self._remembered_salience(self._roll_out())
        return float(
            self.candidates[np.argmax(salience - 1e-3 * np.abs(self.candidates - self.pan))]
        )

    def _active(self) -> float:
        """A pan drawn by its information about the pose and its new area, and kept for a while."""
        if self.time - self._decided < GOAL_DURATION - 1e-6:
            return self._goal
        view = self._roll_out()
        terms = {"informative landmarks": self._information(view)}
        if self.slam.mode != "localize":  # a fixed map gains nothing from new area
            terms["new area"] = AREA * self._new_area(view)
        score = np.sum(list(terms.values()), axis=0)
        probability = np.exp((score - score.max()) / TEMPERATURE)
        drawn = int(self._rng.choice(len(score), p=probability / probability.sum()))
        lead = {name: float(term[drawn] - term.mean()) for name, term in terms.items()}
        self._reason = max(lead, key=lambda name: lead[name])
        self._goal, self._decided = float(self.candidates[drawn]), self.time
        return self._goal

    def _roll_out(self) -> "View":
        """The next `HORIZON` seconds: the robot follows its plan, the camera turns to each pan."""
        ekf, table = self.slam.filter, self.slam.landmarks
        start = ekf.pose
        known = table.counts.confirmed | table.labeled  # includes landmarks that were seen once
        ids, xy = ekf.ids[known], ekf.landmarks[known]
        steps = np.minimum(np.arange(ceil(HORIZON / self.period)), len(self.plan) - 1)
        controls = self.plan[steps] if len(self.plan) else np.zeros((0, 2))
        poses, F, Q = [start], np.eye(3), np.zeros((3, 3))
        for i, u in enumerate(np.array_split(controls, ROLLOUT_POSES)):
            if len(u) == 0:
                poses.append(poses[-1])
                continue
            u = u.sum(0)
            sigma = np.append(np.full(len(u) - 1, self._odometry[0]), self._odometry[1])
            step, U, _ = as_relative_pose(u, np.diag(sigma**2 * abs(u[0])), self.slam.motion)
            moved, Fx, Fu = compose(poses[-1], step)
            poses.append(moved)
            if i < ROLLOUT_POSES // 2:
                F, Q = Fx @ F, Fx @ Q @ Fx.T + Fu @ U @ Fu.T
        sampled, center = np.array(poses[1:]), poses[ROLLOUT_POSES // 2]
        near = self._select(ids, xy, center)
        turn = self.rate * HORIZON * np.arange(1, ROLLOUT_POSES + 1)[:, None] / ROLLOUT_POSES
        pan = self.pan + np.clip(self.candidates - self.pan, -turn, turn)  # (s, c)
        seen = self._sees(sampled, pan, xy[near]).mean(0)
        return View(center, F, Q, ids[near], xy[near], seen)

    def _select(self, ids: IntArray, xy: FloatArray, pose: FloatArray) -> IntArray:
        """Rows of the nearest landmarks (n,) at (n, 2), one in each square meter.

        Each square meter is represented by its landmark with the fewest misses.
        """
        distance = np.hypot(*(xy - pose[:2]).T)
        near = np.flatnonzero(distance < 2 * self.max_range)
        misses = [
            self._misses_of(label) for label in self.slam.landmarks.labels_of(ids[near].tolist())
        ]
        near = near[np.lexsort((distance[near], misses))]
        cells = np.floor(xy[near]).astype(np.int64)
        near = near[np.unique(cells, axis=0, return_index=True)[1]]
        return near[np.argsort(distance[near], kind="stable")[:MAX_LANDMARKS]]

    def _sees(self, poses: FloatArray, pan: FloatArray, points: npt.NDArray[Any]) -> BoolArray:
        """(s, c, k) whether points (k, 2) are in view from poses (s, 3) with pans (s, c)."""
        offset = points - poses[:, None, :2]
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) - poses[:, 2, None]
        inside = np.abs(wrap(bearing[:, None] - pan[..., None])) < (0.5 - VIEW_MARGIN) * self.fov
        near = np.hypot(offset[..., 0], offset[..., 1]) < self.max_range
        return np.asarray(inside & near[:, None])

    def _information(self, view: "View") -> FloatArray:
        """(c,) mutual information of the pose and the expected observations, in nats.

        It is (log det S - log det S given the pose) / 2 = (log det P - log det P given the
        observations) / 2, with the covariances S of the observations and P of the pose. With the
        joint covariance, common errors of pose and landmarks carry no information. Landmarks that
        were expected in view and missed count less.
        """
        seen, k = view.seen, len(view.landmarks)
        if k == 0:
            return np.zeros(len(seen))
        ekf = self.slam.filter
        P = ekf.marginal(view.landmarks)
        P[:3] = view.F @ P[:3]
        P[:, :3] = P[:, :3] @ view.F.T
        P[:3, :3] += view.Q + 1e-12 * np.eye(3)  # a pose that is known exactly is regular, too
        robot = np.append(view.pose, ekf.robot_state[3:])
        z, H = observe_with_errors(robot, view.xy, ekf.range_errors)
        J = stack_jacobians(H)
        labels = self.slam.landmarks.labels_of(view.landmarks.tolist())
        found = seen / (1 + np.array([self._misses_of(label) for label in labels]))  # (c, k)
        sigma = np.broadcast_to(self._sensor(z[:, 0]), (len(seen), k, 2)).copy()
        sigma[..., 1] = np.hypot(sigma[..., 1], np.sqrt(found.sum(1))[:, None] * self._pan_sigma)
        B = (np.sqrt(found)[..., None] / sigma).reshape(len(seen), 2 * k)  # root of R's inverse
        G = B[..., None] * (J @ P[:, :3])  # (c, 2k, 3), covariance of observations and pose
        S = np.eye(2 * k) + B[..., None] * (J @ P @ J.T) * B[:, None]
        explained = np.linalg.solve(P[:3, :3], G.swapaxes(1, 2) @ np.linalg.solve(S, G))
        return np.asarray(-np.linalg.slogdet(np.eye(3) - explained)[1] / 2)

    def _misses_of(self, label: object) -> float:
        """Decayed number of misses of a landmark."""
        if label not in self.misses:
            return 0.0
        count, time = self.misses[label]
        return count * exp((time - self.time) / MISS_MEMORY)

    def _new_area(self, view: "View") -> FloatArray:
        """(c,) fraction of the area of each view that was never seen."""
        cells = self._cells(view.pose)
        new = np.array([cell not in self._seen_cells for cell in map(tuple, cells.tolist())])
        inside = self._sees(view.pose[None], self.candidates[None], cells + 0.5)[0]
        return np.asarray((inside & new).sum(1) / inside.sum(1).clip(1))

    def _remembered_salience(self, view: "View") -> FloatArray:
        """(c,) salience of the landmarks of each view, inhibited where they were looked at."""
        labels = self.slam.landmarks.labels_of(view.landmarks.tolist())
        salience = np.array([self.salience.get(label, 1.0) for label in labels])
        since = np.array([self.time - self.last_seen.get(label, -np.inf) for label in labels])
        return np.asarray(view.seen @ (salience * -np.expm1(-since / INHIBITION_TIME)))

    def _cells(self, pose: FloatArray) -> IntArray:
        """(n, 2) cells of a square meter around a pose (3,), by their smallest x and y."""
        return np.floor(pose[:2]).astype(np.int64) + self._around


Policy = Callable[[Gazer], float]
"""A custom policy: from the gazer to a pan in radians."""


class GazePolicy(NamedTuple):
    """A row of the table of gaze policies."""

    name: str
    """Name that a user gives."""
    summary: str
    """Direction of the camera, for help texts and the documentation."""
    pan: Policy
    """Function from the gazer to a pan in radians."""


POLICIES: dict[str, GazePolicy] = {
    row.name: row
    for row in (
        GazePolicy("fixed", "straight ahead", Gazer._fixed),
        GazePolicy("sweep", "to and fro, at 29 degrees a second", Gazer._sweep),
        GazePolicy("random", "at random, for a second", Gazer._random),
        GazePolicy(
            "salient", "at salient landmarks that were not looked at for long", Gazer._salient
        ),
        GazePolicy(
            "active",
            "where it expects the most information about the pose, and new area",
            Gazer._active,
        ),
    )
}
"""The policies by name."""


def policy_of(policy: str | Policy) -> Policy:
    """The policy of a name in `POLICIES`, or a function itself or by its name as module:function.

    Raises:
        ConfigError: an unknown name, neither a name nor a function, or a failed import.
    """
    if callable(policy):
        return policy
    if isinstance(policy, str) and ":" in policy:
        return import_function("gaze policy", policy)
    known = isinstance(policy, str) and policy in POLICIES
    names = f"{', '.join(POLICIES)}, module:function, or a function"
    require(known, "gaze policy", names, policy)
    return POLICIES[policy].pan


Sensor = Callable[[FloatArray], FloatArray]
"""Standard deviations (k, 2) of ranges and bearings that are measured at ranges (k,)."""


def _default_sensor(ranges: FloatArray) -> FloatArray:
    return np.stack([RELATIVE_RANGE_SIGMA * ranges, np.full(len(ranges), BEARING_SIGMA)], 1)


@dataclass(frozen=True, eq=False)
class View:
    """The rollout of a decision: visibility of k landmarks with c candidate pans."""

    pose: FloatArray
    """(3,) pose in the middle of the rollout."""
    F: FloatArray
    """(3, 3) Jacobian of this pose by the present pose."""
    Q: FloatArray
    """(3, 3) covariance of the motion in between."""
    landmarks: IntArray
    """(k,) ids of the landmarks."""
    xy: FloatArray
    """(k, 2) their positions."""
    seen: FloatArray
    """(c, k) fraction of the rollout in which each is in view."""
