"""Several association hypotheses at once, for landmarks closer than the uncertainty of the pose.

After Reid (1979), "An algorithm for tracking multiple targets": every hypothesis is a filter with
a map of its own. Where a scan has several alternatives, its hypothesis is split, and the most
probable ones are kept. The alternatives are joint associations of the scan (Neira & Tardos 2001).
"""

import copy
from dataclasses import dataclass, field

import numpy as np

from saccade.plane import rotations
from saccade.slam.association.alternatives import Alternatives, log_determinant
from saccade.slam.association.outcomes import NEW
from saccade.slam.consistency import normalized_squared
from saccade.slam.filter._kernels import write_pose
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.predictions import Innovations, new_innovations
from saccade.slam.filter.robot_models import pose_difference, wrap
from saccade.slam.landmarks import LandmarkTable
from saccade.slam.scans import Scan
from saccade.types import FloatArray, IntArray

PRUNED = 8.0
"""Largest log-likelihood ratio of the most probable hypothesis to a hypothesis that is kept."""
TEMPER = 0.5
"""Power of the likelihood of a scan, and of its missed landmarks, in the weight of a hypothesis:
successive scans from nearly the same pose are not independent."""
SYSTEMATIC = 0.5
"""Systematic errors of the sensor, as a fraction of its noise, by which two estimates of one
landmark may differ: averaging does not make them smaller."""
MAX_CO_OBSERVED = 0.1
"""Largest fraction of the observations of two landmarks in common scans for them to be one."""
MIN_MERGE_GAIN = 3.0
"""Minimum log-likelihood ratio for two landmarks to be one."""
MORE_GAIN = 1.5
"""Increase of the log-likelihood ratio before a rejected merge is proposed again."""
MAX_EXPECTED = 10.0
"""Largest contribution of expected detections to the log-likelihood ratio of a merge."""
MAX_JOINED = 4
"""Largest number of hypotheses that one hypothesis becomes after a scan."""
MERGE_SIGMAS = 4.0
"""Largest distance of two landmarks that may be one, in standard deviations."""
EQUAL_SIGMAS = 0.5
"""Largest difference of poses and landmarks of equal hypotheses, in standard deviations: they
differ in the observations of few scans, not in the map."""
EQUAL_MAP = 1.5
"""Difference of landmarks that is always tolerated, in standard deviations of an observation."""
EQUAL_HEADING = 0.005
"""Difference of headings that is always tolerated, in radians."""
NO_MATCHES = np.empty(0, np.int64), new_innovations(0)
"""Matches and innovations of a step without observations."""
MAX_LANDMARKS = 24
"""Largest map with several hypotheses: in larger maps they cost more than a step, and associations
are seldom ambiguous."""


@dataclass
class Hypothesis:
    """One association of all observations, with its filter and its landmarks.

    Without alternatives there is one hypothesis; it keeps only the filter, the landmarks and the
    last scan.
    """

    ekf: EkfSlam
    table: LandmarkTable
    weight: float = 0.0
    """Log probability, relative to the most probable hypothesis."""
    history: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) id of the landmark of each observation so far, -1 if it was not used."""
    co_observations: IntArray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(N, N) number of scans in which both landmarks were observed."""
    merge_threshold: dict[tuple[int, int], float] = field(default_factory=dict)
    """Minimum log-likelihood ratio for a merge of two landmarks, by ids, over `MIN_MERGE_GAIN`."""
    matches: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) id of the landmark of each observation of the last scan, negative if it was not used."""
    innovations: Innovations = field(default_factory=lambda: new_innovations(0))
    """Innovations of the last scan, see `Innovations`."""
    culled: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(g,) ids of landmarks that were removed after the last scan."""
    updated: bool = False
    """Whether the last scan has updated the filter."""
    _visible: tuple[IntArray, FloatArray] | None = None
    _to_cull: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def copy(self) -> "Hypothesis":
        """An independent hypothesis that is equal."""
        new = copy.copy(self)
        new.ekf, new.table = self.ekf.copy(), self.table.copy()
        new.co_observations = self.co_observations.copy()
        new.merge_threshold = self.merge_threshold.copy()
        return new

    def predict(self, scan: Scan) -> None:
        """Moves the robot (C.5-C.9)."""
        if scan.control is not None:
            self.ekf.predict(*scan.control, checked=True)
        k = len(scan.z)
        self.matches, self.innovations = (np.full(k, -1), new_innovations(k)) if k else NO_MATCHES
        self.culled, self.updated = NO_MATCHES[0], False

    def update(self, scan: Scan, matches: IntArray) -> None:
        """Updates the filter by a scan (C.10-C.14).

        Args:
            scan: the scan.
            matches: (k,) id of the landmark of each observation, `NEW` or `DROPPED`. Landmarks with
                ids from `next_id` on are added in the order of the scan, so that its later
                observations correct them.
        """
        ekf, table, first = self.ekf, self.table, self.ekf.next_id
        self.matches, self.updated = matches, True
        self._visible = table.predict_visible(ekf, scan.complete.z)
        self.innovations = ekf.update(scan.z, scan.R, matches, checked=True)
        if ekf.next_id > first:
            table.add(np.arange(first, ekf.next_id), confirmed=True)

    def augment(self, scan: Scan) -> None:
        """Adds the landmarks of new observations as candidates (C.15-C.18)."""
        if NEW in (matches := self.matches.tolist()):
            new = [k for k, match in enumerate(matches) if match == NEW]
            self.matches[new] = [self.ekf.augment(scan.z[k], scan.R[k], checked=True) for k in new]
            self.table.add(self.matches[new], confirmed=False)

    def count(self) -> None:
        """Counts observed and missed landmarks, and chooses those to be culled."""
        before = self.table.log_likelihood
        self._to_cull = self.table.count(self.matches, self._visible)
        self.weight += TEMPER * (self.table.log_likelihood - before)

    def cull(self) -> None:
        """Removes the landmarks that are to be removed."""
        if len(self._to_cull) > 0:
            self.remove(self._to_cull)
            self.culled, self._to_cull = self._to_cull, self._to_cull[:0]

    def remove(self, landmarks: IntArray) -> None:
        """Removes landmarks (k,) by their ids."""
        if len(self.co_observations) > 0:
            kept = np.flatnonzero(~np.isin(self.ekf.ids, landmarks))
            self.co_observations = self.co_observations[np.ix_(kept, kept)]
        self.ekf.remove(landmarks)
        self.table.remove(landmarks)

    def split(self, count: int, point_sigma: float, new_cost: float) -> list["Hypothesis"]:
        """Joins landmarks that are probably one; the hypothesis is split where they may be two.

        Args:
            count: number of observations of the last scan; they include one of the two landmarks.
            point_sigma: standard deviation of the position of an observed point, in meters.
            new_cost: cost of an observation of a new landmark, see `Alternatives`.

        Returns:
            This hypothesis, with the landmarks joined, and others.
        """
        added = len(self.ekf) - len(self.co_observations)
        if added > 0:
            self.co_observations = np.pad(self.co_observations, (0, added))
        used = self.table.rows(self.matches[self.matches >= 0])
        self.co_observations[np.ix_(used, used)] += 1
        ids, found = self.ekf.ids, [self]
        for each in found:  # the list grows inside the loop
            while (pair := each._duplicate(count, point_sigma, new_cost)) is not None:
                gain, i, j = pair
                if len(found) < MAX_JOINED:
                    separate = each.copy()
                    separate.merge_threshold[i, j] = gain + MORE_GAIN
                    found.append(separate)
                each._join(gain, i, j)
        for each in found:
            each.cull()
            each.culled = ids[~np.isin(ids, each.ekf.ids)]
        return found

    def _duplicate(
        self, count: int, point_sigma: float, new_cost: float
    ) -> tuple[float, int, int] | None:
        """Log-likelihood ratio and ids of the two landmarks that are most probably one.

        The last `count` observations include one of the two.
        """
        ids, points, co_observations = self.ekf.ids, self.ekf.landmarks, self.co_observations
        seen, table, best = co_observations.diagonal(), self.table.counts, None
        deviation = np.sqrt(self.ekf.landmark_covariances.trace(0, 1, 2))  # (N,)
        systematic = (SYSTEMATIC * point_sigma) ** 2 * np.eye(2)
        observed = np.flatnonzero(np.isin(ids, self.history[-count:]) & table.confirmed)
        for j in observed.tolist():
            apart = co_observations[j] <= MAX_CO_OBSERVED * np.minimum(seen, seen[j])
            d = points - points[j]
            bound = MERGE_SIGMAS * (deviation + deviation[j] + SYSTEMATIC * point_sigma)
            near = np.flatnonzero(table.confirmed & apart & (np.hypot(d[:, 0], d[:, 1]) < bound))
            if len(near) == 0:
                continue
            C = self.ekf.marginal(ids[np.append(near, j)])
            blocks = C[-2 * len(near) - 2 :, -2 * len(near) - 2 :].reshape(len(near) + 1, 2, -1, 2)
            k = np.arange(len(near))
            cross = blocks[k, :, -1]  # (k, 2, 2)
            S = blocks[k, :, k] + blocks[-1, :, -1] - cross - cross.transpose(0, 2, 1) + systematic
            nis = normalized_squared(d[near], S)
            gain = (new_cost - nis - log_determinant(S) + 4 * np.log(point_sigma)) / 2
            gain += np.minimum(np.minimum(table.expected[near], table.expected[j]), MAX_EXPECTED)
            pairs = [(min(i, j), max(i, j)) for i in near.tolist()]
            pairs = [(int(ids[i]), int(ids[j])) for i, j in pairs]
            threshold = np.array([self.merge_threshold.get(pair, 0.0) for pair in pairs])
            gain[(nis > MERGE_SIGMAS**2) | (gain < threshold)] = -np.inf
            i = int(gain.argmax())
            if gain[i] > (MIN_MERGE_GAIN if best is None else best[0]):
                best = float(gain[i]), *pairs[i]
        return best

    def _join(self, gain: float, kept: int, removed: int) -> None:
        """Joins two landmarks, by their ids."""
        self.weight += gain
        i, j = self.table.rows(np.array([kept, removed])).tolist()
        self.table.join(kept, removed)
        self.history = np.where(self.history == removed, kept, self.history)
        self.co_observations[i] += self.co_observations[j]
        self.co_observations[:, i] += self.co_observations[:, j]
        self.ekf.join(kept, removed)
        self.remove(np.union1d(self._to_cull, removed))
        self._to_cull = self._to_cull[:0]

    def equals(self, other: "Hypothesis", point_sigma: float) -> bool:
        """Whether the poses and the maps are nearly equal."""
        variance = np.maximum(self.ekf.pose_covariance.diagonal(), 0.0)
        tolerance = np.maximum(
            EQUAL_SIGMAS * np.sqrt(variance), [point_sigma, point_sigma, EQUAL_HEADING]
        )
        if (np.abs(pose_difference(self.ekf.pose, other.ekf.pose)) > tolerance).any():
            return False
        confirmed = other.table.counts.confirmed
        one, two = self.ekf.landmarks[self.table.counts.confirmed], other.ekf.landmarks[confirmed]
        if len(one) != len(two) or len(one) == 0:
            return len(one) == len(two)
        deviation = np.sqrt(other.ekf.landmark_covariances[confirmed].trace(0, 1, 2) / 2)
        distance = np.abs(one[:, None] - two).max(2)
        equal = distance < np.maximum(EQUAL_MAP * point_sigma, EQUAL_SIGMAS * deviation)
        return bool(equal.any(0).all() and equal.any(1).all())


class Hypotheses:
    """The association hypotheses of a robot, at least one.

    Args:
        first: the initial hypothesis.
        gate: probability with which an observation of a landmark is inside its gate.
        new_gate: probability with which an observation of any landmark is inside the larger gate.
        huber: see `EkfConfig`.
        max_hypotheses: largest number of hypotheses.
    """

    def __init__(
        self, first: Hypothesis, gate: float, new_gate: float, huber: float, max_hypotheses: int
    ) -> None:
        self.alternatives = Alternatives(gate, new_gate, huber)
        self.max_hypotheses = max_hypotheses
        self.hypotheses = [first]
        """All hypotheses, the most probable first."""
        self.branching = False
        """Whether scans with several alternatives split a hypothesis."""

    @property
    def best(self) -> Hypothesis:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @property
    def _weights(self) -> FloatArray:
        """(h,) probability of each hypothesis."""
        weight = np.exp([each.weight for each in self.hypotheses])
        return np.asarray(weight / weight.sum())

    @property
    def _pose_differences(self) -> FloatArray:
        """(h, 3) pose of each hypothesis minus the pose of the best one."""
        poses = np.array([each.ekf.pose for each in self.hypotheses])
        return pose_difference(poses, self.best.ekf.pose)

    @property
    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Mean (3,) and covariance (3, 3) of the pose over all hypotheses."""
        pose, C = np.empty(3), np.empty((3, 3))
        write_pose(self.best.ekf.active, pose, C)
        if len(self.hypotheses) > 1:
            weight, difference = self._weights, self._pose_differences
            mean = weight @ difference
            pose += mean
            pose[2], difference = wrap(pose[2]), difference - mean
            C = np.tensordot(weight, [each.ekf.pose_covariance for each in self.hypotheses], 1)
            C += (weight * difference.T) @ difference
        return pose, C

    def keep_best(self) -> None:
        """Keeps only the best hypothesis, and gives its pose the uncertainty of all hypotheses."""
        if self.branching:
            best, weight, difference = self.best, self._weights, self._pose_differences
            turn = rotations(best.ekf.pose[2])
            difference[:, :2] = difference[:, :2] @ turn  # in the robot's frame
            spread = (weight * difference.T) @ difference
            if spread.any():
                best.ekf.predict(np.zeros(3), spread)
            best.co_observations, best.merge_threshold = np.zeros((0, 0), np.int64), {}
            self.hypotheses, self.branching = [best], False

    @property
    def is_large(self) -> bool:
        """Whether the map of the best hypothesis has more than `MAX_LANDMARKS` landmarks."""
        counts = self.best.table.counts
        return len(counts) > MAX_LANDMARKS and int(counts.confirmed.sum()) > MAX_LANDMARKS

    def predict(self, scan: Scan) -> None:
        """Moves the robot in each hypothesis (C.5-C.9)."""
        for each in self.hypotheses:
            each.predict(scan)

    def branch(self, scan: Scan) -> list[tuple[Hypothesis, IntArray]]:
        """Splits the hypotheses by the alternatives of a scan.

        Returns:
            Hypotheses, with the (k,) landmarks of the observations: twice as many as are kept, as
            some become equal.
        """
        new_cost = self.alternatives.new_cost(_point_sigma(scan))
        options = [
            (hypothesis.weight - TEMPER * alternative.cost / 2, i, alternative)
            for i, hypothesis in enumerate(self.hypotheses)
            for alternative in self.alternatives(hypothesis.ekf, scan.z, scan.R, new_cost)
        ]
        options.sort(key=lambda option: -option[0])
        least = options[0][0] - PRUNED
        options = [each for each in options if each[0] > least][: 2 * self.max_hypotheses]
        left = [i for _, i, _ in options]
        found: list[tuple[Hypothesis, IntArray]] = []
        for weight, i, alternative in options:
            left.remove(i)
            hypothesis = self.hypotheses[i].copy() if i in left else self.hypotheses[i]
            hypothesis.weight = weight
            found.append((hypothesis, alternative.association.copy()))
        self.hypotheses = [hypothesis for hypothesis, _ in found]
        return found

    def reduce(self, scan: Scan) -> None:
        """Joins and removes landmarks, and keeps the most probable hypotheses after a scan."""
        if not self.branching:
            self.best.cull()
            return
        for each in self.hypotheses:
            each.history = np.append(each.history, np.maximum(each.matches, -1))
        if not self.best.updated:
            return
        point_sigma = _point_sigma(scan)
        new_cost = self.alternatives.new_cost(point_sigma)
        found: list[Hypothesis] = []
        for each in self.hypotheses:
            found += each.split(len(scan.z), point_sigma, new_cost)
        found.sort(key=lambda each: -each.weight)
        kept: list[Hypothesis] = []
        for each in found:
            if each.weight < found[0].weight - PRUNED or len(kept) == self.max_hypotheses:
                break
            if not any(each.equals(better, point_sigma) for better in kept):
                kept.append(each)
        for each in reversed(kept):
            each.weight -= kept[0].weight
        self.hypotheses = kept


def _point_sigma(scan: Scan) -> float:
    """Standard deviation of the position of an observed point, in meters."""
    z, R = scan.complete.z, scan.complete.R
    return float(np.exp(log_determinant(R).mean() / 4) * np.sqrt(z[:, 0].mean()))
