"""Gaze by the map: the directions in which a camera looks next.

The winner-take-all network of the saliency map attends to the strongest position and inhibits it
for a while, so that attention moves on. Here the same happens in the map of the robot instead of
an image: directions compete by what their landmarks would tell about the pose, by the area that
was never seen there, and by the salience of landmarks that were not looked at for long.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, cos, pi, sin

import numpy as np

from saccade.errors import require
from saccade.slam import Slam
from saccade.slam.filter.models import control_bias
from saccade.slam.models import wrap
from saccade.types import FloatArray, IntArray

POLICIES = ("fixed", "sweep", "random", "salient", "active")
"""The policies by name."""
HORIZON, SAMPLES = 2.0, 5
"""Seconds that a decision looks ahead, and times within them at which views are predicted."""
MAX_LANDMARKS = 24
"""The nearest landmarks, those that a decision considers."""
RANGE_SIGMA, BEARING_SIGMA = 0.03, 0.01
"""Of a landmark that is observed all the time of the horizon: as a fraction of the range, and in
radians."""
MARGIN = 0.05
"""Fraction of the view at each side that does not count."""
AREA, MEMORY = 3.0, 0.2
"""Nats that a view is worth if all of it was never seen, and if it has one landmark, of salience 1,
that was never looked at."""
INHIBITION = 10.0
"""Seconds after which a landmark that was looked at is two thirds as attractive as before."""
SWEEP_RATE = 0.5
"""Radians per second of a sweep, slow enough that points are tracked."""


@dataclass(frozen=True)
class Look:
    """Where the camera looks next."""

    pan: float
    """Radians to the left of the robot's heading."""
    tilt: float
    """Radians up; 0: the map is of the plane."""
    target: tuple[float, float]
    """x, y in the map of the point before the camera at half its reach, in metres."""
    reason: str
    """Why, in a sentence."""


class Gazer:
    """Decides where the camera of a robot looks next.

    Args:
        slam: of the robot, live or with a loaded map; it is only read.
        fov: horizontal field of view of the camera, in radians.
        reach: metres within which landmarks are observed.
        pan: least and greatest pan, in radians to the left of the heading.
        rate: radians per second at which the camera turns.
        period: seconds from one decision to the next, and of one step of a plan.
        policy: a name of `POLICIES`, or a function from the gazer to a pan in radians.
        seed: of the policy "random".
        odometry: standard deviations of distance and turn after a metre, in metres and radians.
        drift: from pans (c,) to factors (c,) on the covariance of the motion, where the camera
            itself measures the motion; None where it does not.

    Raises:
        ConfigError: an argument is out of its range.

    Examples:
        >>> from math import radians
        >>> import numpy as np
        >>> from saccade.gaze import Gazer
        >>> from saccade.slam import Slam
        >>> slam = Slam()
        >>> R, names = np.diag([0.1, 0.02])[None] ** 2, [7]
        >>> _ = slam.step(0.0, z=np.array([[4.0, 1.5]]), R=R, names=names)
        >>> gazer = Gazer(slam, fov=radians(50), reach=8.0, policy="salient", period=1.0)
        >>> gazer.next().pan > 1
        True
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
        policy: "str | Policy" = "active",
        seed: int = 0,
        odometry: tuple[float, float] = (0.02, 0.02),
        drift: Callable[[FloatArray], FloatArray] | None = None,
    ) -> None:
        require(0 < fov <= 2 * pi, "fov", "over 0 and up to 2 pi", fov)
        require(0 < reach < 1e3, "reach", "over 0 and under 1000", reach)
        require(-2 * pi <= pan[0] <= pan[1] <= 2 * pi, "pan", "ascending, within 2 pi", pan)
        require(rate > 0, "rate", "over 0", rate)
        require(0 < period <= HORIZON, "period", f"over 0 and up to {HORIZON}", period)
        known = callable(policy) or policy in POLICIES
        require(known, "policy", f"one of {', '.join(POLICIES)}", policy)
        self.slam, self.fov, self.reach, self.limits = slam, fov, reach, pan
        self.rate, self.period = rate, period
        self.pan = float(np.clip(0.0, *pan))
        """Of the camera, in radians."""
        self.time = 0.0
        """Seconds since the first decision."""
        self.candidates = np.linspace(*pan, max(1, ceil(3 * (pan[1] - pan[0]) / fov)) + 1)
        """(c,) pans that compete, a third of the view apart."""
        self._policy: Policy = policy if callable(policy) else getattr(self, f"_{policy}")
        self._reason = "as its own policy says" if callable(policy) else ""
        self._rng, self._goal = np.random.default_rng(seed), 0.0
        self._odometry, self._drift = odometry, drift
        self.plan = np.zeros((0, 2))
        """(h, c) controls that come."""
        self.salience: dict[object, float] = {}
        """Of landmarks by name; 1 of those that are missing."""
        self.last_seen: dict[object, float] = {}
        """Time at which each landmark was last looked at, by name."""
        self._seen_cells: set[tuple[int, int]] = set()
        cells = np.arange(-ceil(reach), ceil(reach) + 1) + 0.0
        grid = np.stack(np.meshgrid(cells, cells), -1).reshape(-1, 2)
        self._offsets = grid[np.hypot(*grid.T) <= reach]

    def next(
        self, plan: FloatArray | None = None, salience: Mapping[object, float] | None = None
    ) -> Look:
        """The next look: as far towards where the policy wants as the camera turns in a period.

        Args:
            plan: (h, c) controls of the next steps, as those of the motion model, and then always
                the last of them; by default straight on as in the last plan.
            salience: of landmarks by name, from 0 to 1; remembered. It is 1 of all others.
        """
        if plan is not None:
            self.plan = np.asarray(plan, np.float64)
        elif len(self.plan):
            self.plan = self.plan[:1] * (np.arange(self.plan.shape[1]) == 0)
        self.salience.update(salience or {})
        goal = float(np.clip(self._policy(self), *self.limits))
        most = self.rate * self.period
        pan = self.pan + float(np.clip(goal - self.pan, -most, most))
        self.pan = pan
        self.time += self.period
        x, y, heading = self.slam.ekf.pose.tolist()
        half = self.reach / 2
        target = x + half * cos(heading + pan), y + half * sin(heading + pan)
        return Look(pan, 0.0, target, self._reason)

    def observed(self, pan: float, names: object = ()) -> None:
        """Note what was seen: for inhibition of return, and for the area that was never seen.

        Args:
            pan: of the camera as measured, in radians.
            names: (k,) of the landmarks that were observed.
        """
        self.pan = float(pan)
        for name in np.asarray(names).ravel().tolist():
            self.last_seen[name] = self.time
        pose = self.slam.ekf.pose
        off = wrap(np.arctan2(*self._offsets.T[::-1]) - pose[2] - pan)
        cells = self._cells(pose)[np.abs(off) <= self.fov / 2]
        self._seen_cells.update(map(tuple, cells.tolist()))

    def _fixed(self, _: "Gazer") -> float:
        self._reason = "straight ahead"
        return 0.0

    def _sweep(self, _: "Gazer") -> float:
        self._reason = "to and fro"
        low, high = self.limits
        span = max(high - low, 1e-9)
        phase = (SWEEP_RATE * self.time - low) % (2 * span)
        return low + (phase if phase < span else 2 * span - phase)

    def _random(self, _: "Gazer") -> float:
        self._reason = "at random, for a second"
        if self.time % 1 < self.period:
            self._goal = float(self._rng.choice(self.candidates))
        return self._goal

    def _salient(self, _: "Gazer") -> float:
        view = self._view()
        return self._best({"salient landmarks not looked at for long": self._memory(view)})

    def _active(self, _: "Gazer") -> float:
        """To what tells most: of the pose, of area never seen, of landmarks remembered."""
        view = self._view()
        return self._best(
            {
                "landmarks that tell most of the pose": self._information(view),
                "area that was never seen": AREA * self._new_area(view),
                "salient landmarks not looked at for long": MEMORY * self._memory(view),
            }
        )

    def _best(self, terms: dict[str, FloatArray]) -> float:
        """The pan with the greatest sum of terms (c,), of equal ones the nearest."""
        total = np.sum(list(terms.values()), axis=0)
        best = int(np.argmax(total - 1e-3 * np.abs(self.candidates - self.pan)))
        lead = {name: float(term[best] - term.mean()) for name, term in terms.items()}
        self._reason = "to " + max(lead, key=lambda name: lead[name])
        return float(self.candidates[best])

    def _view(self) -> "View":
        """What each pan lets the robot see while it drives on and the camera turns there."""
        ekf, motion = self.slam.ekf, self.slam.motion
        pose, r = ekf.pose, len(ekf.robot_state)
        steps = ceil(HORIZON / self.period)
        rows = np.minimum(np.arange(steps), len(self.plan) - 1)
        F, Q, poses, middle = np.eye(r), np.zeros((r, r)), [pose], None
        for i, u in enumerate(self.plan[rows] if len(self.plan) else ()):
            moved, Fx, Fu = motion(pose, u)
            A = np.eye(r)
            A[:3, :3], A[:3, 3:] = Fx, Fu @ control_bias(u, r)
            sigma = np.append(np.full(len(u) - 1, self._odometry[0]), self._odometry[1])
            F, Q = A @ F, A @ Q @ A.T
            Q[:3, :3] += (Fu * (sigma**2 * abs(u[0]))) @ Fu.T
            pose = moved
            poses.append(pose)
            if i + 1 == steps // 2:
                middle = F, Q
        at = np.linspace(steps / SAMPLES, steps, SAMPLES)
        sampled = np.array(poses)[np.minimum(at.round().astype(int), len(poses) - 1)]
        center = poses[min(steps // 2, len(poses) - 1)]
        landmarks = np.flatnonzero(self.slam.confirmed)
        away = np.hypot(*(ekf.landmarks[landmarks] - center[:2]).T)
        near = np.argsort(away, kind="stable")[:MAX_LANDMARKS]
        landmarks = landmarks[near[away[near] < 2 * self.reach]]
        turned = self.rate * self.period * at[:, None]
        pan = self.pan + np.clip(self.candidates - self.pan, -turned, turned)  # (s, c)
        offset = ekf.landmarks[landmarks] - sampled[:, None, :2]  # (s, k, 2)
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) - sampled[:, 2, None]
        off = np.abs(wrap(bearing[:, None] - pan[..., None]))  # (s, c, k)
        near_enough = np.linalg.norm(offset, axis=2) < self.reach
        seen = (off < (0.5 - MARGIN) * self.fov) & near_enough[:, None]
        return View(center, *(middle or (F, Q)), landmarks, seen.mean(0))

    def _information(self, view: "View") -> FloatArray:
        """(c,) nats by which the entropy of the pose falls: mutual information, less drift.

        By the joint covariance of pose and landmarks: a landmark that is as uncertain as the pose,
        and by it, tells nothing.
        """
        ekf, landmarks, seen = self.slam.ekf, view.landmarks, view.seen
        robot, k = ekf.robot_state, len(view.landmarks)
        r = len(robot)
        C = ekf.marginal(landmarks)
        C[:r] = view.F @ C[:r]
        C[:, :r] = C[:, :r] @ view.F.T
        P = C[:3, :3] + np.diag([1e-8, 1e-8, 1e-10])  # regular at the start, which is certain
        factor = np.ones(1) if self._drift is None else self._drift(self.candidates)
        Q = view.Q * factor[:, None, None]
        without, before = np.linalg.slogdet(P + view.Q[:3, :3])[1], P + Q[:, :3, :3]
        if k == 0:
            return np.broadcast_to((without - np.linalg.slogdet(before)[1]) / 2, len(seen))
        robot[:3] = view.pose
        z, H = ekf.sensor.observe(robot, ekf.landmarks[landmarks])
        by_each = np.zeros((k, 2, len(C)))
        by_each[..., :r] = H[..., :r]
        for i in range(k):
            by_each[i, :, r + 2 * i : r + 2 * i + 2] = H[i, :, r:]
        J = by_each.reshape(2 * k, len(C))
        JQ = J[:, :r] @ Q
        S, X = J @ C @ J.T + JQ @ J[:, :r].T, J @ C[:, :3] + JQ[..., :3]
        sigma = np.stack([RANGE_SIGMA * z[:, 0], np.full(k, BEARING_SIGMA)], 1)
        B = (np.sqrt(seen)[..., None] / sigma).reshape(len(seen), 2 * k)
        BX = B[..., None] * X
        M = np.eye(2 * k) + B[..., None] * S * B[:, None]
        after = before - BX.swapaxes(1, 2) @ np.linalg.solve(M, BX)
        return np.asarray((without - np.linalg.slogdet(after)[1]) / 2)

    def _new_area(self, view: "View") -> FloatArray:
        """(c,) fraction of each view that was never seen."""
        cells = map(tuple, self._cells(view.pose).tolist())
        new = np.array([cell not in self._seen_cells for cell in cells])
        bearing = np.arctan2(*self._offsets.T[::-1]) - view.pose[2]
        inside = np.abs(wrap(bearing - self.candidates[:, None])) <= self.fov / 2
        return np.asarray((inside & new).sum(1) / inside.sum(1).clip(1))

    def _memory(self, view: "View") -> FloatArray:
        """(c,) salience of the landmarks of each view, less where they were just looked at."""
        names = self.slam.landmark_names[view.landmarks].tolist()
        salience = np.array([self.salience.get(name, 1.0) for name in names])
        since = np.array([self.time - self.last_seen.get(name, -np.inf) for name in names])
        return np.asarray(view.seen @ (salience * -np.expm1(-since / INHIBITION)))

    def _cells(self, pose: FloatArray) -> IntArray:
        """(n, 2) square metres of the map within reach of a pose (3,)."""
        return np.asarray(np.floor(pose[:2] + self._offsets), np.int64)


Policy = Callable[[Gazer], float]
"""A policy of one's own: from the gazer to a pan in radians."""


@dataclass(frozen=True, eq=False)
class View:
    """The landmarks around the robot, as each of c pans lets it see them within the horizon."""

    pose: FloatArray
    """(3,) in the middle of the horizon."""
    F: FloatArray
    """(r, r) Jacobian of the robot then by that of now."""
    Q: FloatArray
    """(r, r) noise of the motion in between."""
    landmarks: IntArray
    """(k,) their numbers."""
    seen: FloatArray
    """(c, k) fraction of the horizon in which each is in view and in reach."""
