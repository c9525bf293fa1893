"""Several association hypotheses at once, for landmarks closer than the uncertainty of the pose.

After Reid (1979), "An algorithm for tracking multiple targets": every hypothesis is a filter with
a map of its own. Where a scan has several alternatives, its hypothesis is split, and the most
probable ones are kept. The alternatives are joint associations of the scan (Neira & Tardos 2001).
"""

import copy
from dataclasses import dataclass, field

import numpy as np

from saccade.io.checkpoint import (
    Arrays,
    arrays_of,
    attribute_arrays,
    merge,
    restore_attributes,
    select,
)
from saccade.slam.association._kernels import NEW
from saccade.slam.association.alternatives import Alternatives, log_determinant
from saccade.slam.consistency import normalized_squared
from saccade.slam.culling import Culling, numbers_of_kept
from saccade.slam.filter._range_bearing_kernels import (
    Innovations,
    augment_range_bearing,
    write_pose,
)
from saccade.slam.filter.ekf import EkfSlam, join_landmarks
from saccade.slam.filter.models import new_innovations, predict, update
from saccade.slam.models import wrap
from saccade.slam.scans import Scan
from saccade.types import FloatArray, IntArray

PRUNED = 8.0
"""Log likelihood ratio to the most probable hypothesis at which another one is dropped."""
TEMPER = 0.5
"""Power of the likelihood of a scan in the weight of a hypothesis, and of that of the landmarks
that were missed: successive scans from almost the same pose are not independent."""
SYSTEMATIC = 0.5
"""Systematic errors of the sensor, as a fraction of its noise, by which two estimates of one
landmark may differ: averaging does not make them smaller."""
MAX_CO_OBSERVED = 0.1
"""Two landmarks are not one if this fraction of the observations of either were in a scan with the
other."""
MIN_GAIN = 3.0
"""Log likelihood ratio from which two landmarks may be one."""
MORE_GAIN = 1.5
"""By which it must grow for a hypothesis in which they are two to be split again."""
MAX_EXPECTED = 10.0
"""Largest log likelihood ratio by which two landmarks that are seldom observed together are one
because, of each of them, more observations were expected."""
MAX_JOINED = 4
"""Hypotheses into which one is split after a scan."""
MAX_DISTANCE = 4.0
"""Of two landmarks that may be one: standard deviations of their difference."""
EQUAL, EQUAL_MAP, MIN_HEADING = 0.5, 1.5, 0.005
"""Two hypotheses are one if they have as many landmarks, and the poses and the landmarks differ by
less than the first, a fraction of their standard deviations: then they differ in the observations
of few scans, not in what is in the map. Differences of landmarks under the second, a fraction of
the standard deviation of an observation, and of the heading under the third, in radians, never
count."""
STATE = ("weight", "wrong", "association", "co_observations", "refused")
"""Attributes of `Hypothesis` that are saved, beside its parts."""
MAX_LANDMARKS = 24
"""Of the map of the most probable hypothesis, from which it is the only one: they then cost more
than a step, and a robot that has come so far is seldom in doubt about a few."""


@dataclass
class Hypothesis:
    """One association of all observations, and the filter that follows from it.

    A robot that follows no alternatives has one hypothesis, of which nothing but the filter and
    the counts of its landmarks is kept.
    """

    ekf: EkfSlam
    culling: Culling
    weight: float = 0.0
    """Log probability, relative to that of the most probable hypothesis."""
    co_observations: IntArray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(N, N) number of scans in which both landmarks were observed; of one, on the diagonal."""
    association: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) landmark of each observation of the log so far, -1 if it is not used."""
    innovations: Innovations = field(default_factory=lambda: new_innovations(0))
    """Those of the present scan, see `Innovation`."""
    wrong: float = 0.0
    """Expected number of wrong associations if the map is right."""
    culled: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(g,) landmarks that were removed after the present scan."""
    refused: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """(N, N) log likelihood ratio from which two landmarks may be one; 0 for `MIN_GAIN`."""

    def copy(self) -> "Hypothesis":
        """An independent one that is equal."""
        return copy.deepcopy(self)

    def predict(self, scan: Scan) -> None:
        """Move the robot (C.5-C.9)."""
        if scan.control is not None:
            predict(self.ekf.view, *scan.control)

    def observe(
        self,
        z: FloatArray,
        R: FloatArray,
        association: IntArray,
        *,
        may_cull: bool = True,
    ) -> IntArray:
        """Process a scan: update (C.10-C.14), augment (C.15-C.18), count what was missed.

        Args:
            z: (k, 2) observations.
            R: (k, 2, 2) their covariances.
            association: (k,) numbers of landmarks, `NEW` and `DROPPED`; those of new landmarks are
                filled in.
            may_cull: whether there may be a landmark to cull.

        Returns:
            (g,) landmarks that are to be culled.
        """
        ekf = self.ekf
        predicted = self.culling.predict_visible(ekf, z, may_cull=may_cull)
        local = ekf.to_view(association)
        ekf.mark_observed(local)
        self.innovations = update(ekf.view, z, R, local)
        mapped = len(ekf)
        for k in np.flatnonzero(association == NEW).tolist():  # candidates
            association[k] = len(ekf)
            augment_range_bearing(ekf.view, z[k], R[k])
        return self.culling.count_scan(ekf, predicted, mapped, association)

    def split(
        self, z: FloatArray, R: FloatArray, association: IntArray, size: float, new_cost: float
    ) -> list["Hypothesis"]:
        """Process a scan, and cull landmarks.

        Args:
            z: (m, 2) observations.
            R: (m, 2, 2) their covariances.
            association: (m,) numbers of landmarks, `NEW` and `DROPPED`.
            size: metres, standard deviation of the position of an observed point.
            new_cost: of an observation of a new landmark, see `Alternatives`.

        Returns:
            This hypothesis, and others in which two of its landmarks are one.
        """
        association, before = association.copy(), self.culling.log_likelihood
        self.ekf.reserve(len(z))
        self.observe(z, R, association)
        added = len(self.ekf) - len(self.refused)
        if added > 0:
            self.co_observations = np.pad(self.co_observations, (0, added))
            self.refused = np.pad(self.refused, (0, added))
        used = association[association >= 0]
        self.co_observations[np.ix_(used, used)] += 1
        self.weight += TEMPER * (self.culling.log_likelihood - before)
        self.association = np.append(self.association, np.maximum(association, -1))
        ids, found = self.ekf.ids, [self]
        for each in found:  # those that are found on the way are looked at, too
            while (pair := each._duplicate(len(z), size, new_cost)) is not None:
                gain, i, j = pair
                if len(found) < MAX_JOINED:
                    separate = each.copy()
                    separate.refused[[i, j], [j, i]] = gain + MORE_GAIN
                    found.append(separate)
                each._join(gain, i, j)
        for each in found:
            each._remove(np.zeros(0, np.int64))
            each.culled = np.flatnonzero(~np.isin(ids, each.ekf.ids))
        return found

    def _duplicate(self, count: int, size: float, new_cost: float) -> tuple[float, int, int] | None:
        """Log likelihood ratio and numbers of the two landmarks that are most probably one.

        One of them is among the last `count` observations.
        """
        points, seen, best = self.ekf.landmarks, self.co_observations.diagonal(), None
        confirmed = self.culling.confirmed(len(points))
        deviation = np.sqrt(self.ekf.landmark_covariances.trace(0, 1, 2))  # (N,)
        systematic = (SYSTEMATIC * size) ** 2 * np.eye(2)
        observed = np.unique(self.association[-count:])
        observed = observed[observed >= 0]  # not those that were removed
        for j in observed[confirmed[observed]].tolist():
            apart = self.co_observations[j] <= MAX_CO_OBSERVED * np.minimum(seen, seen[j])
            d = points - points[j]
            bound = MAX_DISTANCE * (deviation + deviation[j] + SYSTEMATIC * size)
            near = np.flatnonzero(confirmed & apart & (np.hypot(d[:, 0], d[:, 1]) < bound))
            if len(near) == 0:
                continue
            C = self.ekf.marginal(np.append(near, j))
            blocks = C[-2 * len(near) - 2 :, -2 * len(near) - 2 :].reshape(len(near) + 1, 2, -1, 2)
            k = np.arange(len(near))
            cross = blocks[k, :, -1]  # (k, 2, 2)
            S = blocks[k, :, k] + blocks[-1, :, -1] - cross - cross.transpose(0, 2, 1) + systematic
            nis = normalized_squared(d[near], S)
            gain = (new_cost - nis - log_determinant(S) + 4 * np.log(size)) / 2
            expected = np.minimum(self.culling.expected[near], self.culling.expected[j])
            gain += np.minimum(expected, MAX_EXPECTED)
            gain[(nis > MAX_DISTANCE**2) | (gain < self.refused[j, near])] = -np.inf
            i = int(gain.argmax())
            if gain[i] > (MIN_GAIN if best is None else best[0]):
                best = float(gain[i]), min(int(near[i]), j), max(int(near[i]), j)
        return best

    def _join(self, gain: float, kept: int, removed: int) -> None:
        """Take two landmarks for one."""
        self.weight += gain
        join_landmarks(self.ekf, kept, removed)
        self.culling.join(kept, removed)
        self.association[self.association == removed] = kept
        self.co_observations[kept] += self.co_observations[removed]
        self.co_observations[:, kept] += self.co_observations[:, removed]
        self._remove(np.array([removed]))

    def _remove(self, landmarks: IntArray) -> None:
        """Remove landmarks, and those that are to be culled."""
        removed = self.culling.remove_culled(landmarks)
        if len(removed) > 0:
            is_kept = np.ones(len(self.ekf), np.bool_)
            is_kept[removed] = False
            kept = np.flatnonzero(is_kept)
            self.association = numbers_of_kept(is_kept)[self.association]
            self.co_observations = self.co_observations[np.ix_(kept, kept)]
            self.refused = self.refused[np.ix_(kept, kept)]
            self.ekf.remove(removed)

    def equals(self, other: "Hypothesis", size: float) -> bool:
        """Whether the poses and the maps are almost the same."""
        variance = np.maximum(self.ekf.pose_covariance.diagonal(), 0.0)
        tolerance = np.maximum(EQUAL * np.sqrt(variance), [size, size, MIN_HEADING])
        difference = self.ekf.pose - other.ekf.pose
        difference[2] = wrap(difference[2])
        if (np.abs(difference) > tolerance).any():
            return False
        (one, two), deviation = (self.points, other.points), other.deviations
        if len(one) != len(two) or len(one) == 0:
            return len(one) == len(two)
        distance = np.abs(one[:, None] - two).max(2)
        equal = distance < np.maximum(EQUAL_MAP * size, EQUAL * deviation)
        return bool(equal.any(0).all() and equal.any(1).all())

    @property
    def points(self) -> FloatArray:
        """(n, 2) landmarks of the map."""
        return self.ekf.landmarks[self.culling.confirmed(len(self.ekf))]

    @property
    def deviations(self) -> FloatArray:
        """(n,) standard deviations of their coordinates."""
        covariance = self.ekf.landmark_covariances[self.culling.confirmed(len(self.ekf))]
        return np.asarray(np.sqrt(covariance.trace(0, 1, 2) / 2), np.float64)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, between two steps."""
        parts = {"ekf": arrays_of("ekf", self.ekf), "culling": arrays_of("culling", self.culling)}
        return merge(parts) | attribute_arrays(self, *STATE)

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.ekf.from_arrays(select(arrays, "ekf"))
        self.culling.from_arrays(select(arrays, "culling"))
        restore_attributes(self, {name: arrays[name] for name in STATE})


class Hypotheses:
    """The hypotheses that are followed, the most probable one first; never none.

    Args:
        first: the one that is followed at first.
        gate: probability with which an observation of a landmark is inside its gate.
        new_gate: probability with which one that is not of a new landmark is inside this one.
        huber: see `EkfConfig`.
        most: hypotheses that are kept.
    """

    def __init__(
        self, first: Hypothesis, gate: float, new_gate: float, huber: float, most: int
    ) -> None:
        self.alternatives = Alternatives(gate, new_gate, huber)
        self.most = most
        self.alive = [first]
        """The most probable one first."""
        self.branching = False
        """Whether alternatives are followed."""
        self.settled = 1.0, 0.0
        """`probability` and `wrong` when the most probable one became the only one."""

    @property
    def best(self) -> Hypothesis:
        """The most probable one."""
        return self.alive[0]

    @property
    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Mean (3,) and covariance (3, 3) of the pose over all hypotheses."""
        pose, C = np.empty(3), np.empty((3, 3))
        write_pose(self.best.ekf.view, pose, C)
        if len(self.alive) > 1:
            weight = np.exp([each.weight for each in self.alive])
            weight /= weight.sum()
            difference = np.array([each.ekf.pose for each in self.alive]) - pose  # (h, 3)
            difference[:, 2] = wrap(difference[:, 2])
            mean = weight @ difference
            pose += mean
            pose[2], difference = wrap(pose[2]), difference - mean
            C = np.tensordot(weight, [each.ekf.pose_covariance for each in self.alive], 1)
            C += (weight * difference.T) @ difference
        return pose, C

    @property
    def probability(self) -> float:
        """Of the most probable hypothesis among those that are, or were, followed."""
        alive = float(1 / np.exp([each.weight for each in self.alive]).sum())
        return alive if self.branching else self.settled[0]

    @property
    def wrong(self) -> float:
        """Expected fraction of wrong associations of the most probable hypothesis.

        Those of landmarks that are next to one another, and those that are other ones in the
        hypotheses that are, or were, followed beside it.
        """
        if not self.branching:
            return self.settled[1]
        used = self.best.association >= 0
        landmark, share = self.best.association[used], 0.0
        if len(landmark) == 0:
            return 0.0
        for each in self.alive[1:]:
            counts = np.zeros((len(self.best.ekf), len(each.ekf) + 1))
            np.add.at(counts, (landmark, each.association[used]), 1)
            share += float(np.exp(each.weight)) * (1 - counts.max(1).sum() / len(landmark))
        return share * self.probability + self.best.wrong / len(landmark)

    def settle(self) -> None:
        """Follow the most probable one alone from now on."""
        if self.branching:
            self.settled = self.probability, self.wrong
        self.alive, self.branching = [Hypothesis(self.best.ekf, self.best.culling)], False

    @property
    def is_large(self) -> bool:
        """Whether the map of the most probable one is so large that it is to be the only one."""
        return len(self.best.ekf) > MAX_LANDMARKS and len(self.best.points) > MAX_LANDMARKS

    def predict(self, scan: Scan) -> None:
        """Move the robots (C.5-C.9); for the first there is room already."""
        self.best.predict(scan)
        for each in self.alive[1:]:
            each.ekf.inflate_heading_covariance()
            each.ekf.reserve()
            each.predict(scan)

    def leave_out(self, count: int) -> None:
        """Use none of the observations of a scan of so many."""
        for each in self.alive if self.branching else []:
            each.association = np.append(each.association, np.full(count, -1))

    def branch(self, z: FloatArray, R: FloatArray) -> None:
        """Split the hypotheses by the alternatives of a scan, and keep the most probable ones."""
        size = float(np.exp(log_determinant(R).mean() / 4) * np.sqrt(z[:, 0].mean()))
        new_cost = self.alternatives.new_cost(size)
        options = [
            (hypothesis.weight - TEMPER * alternative.cost / 2, i, alternative)
            for i, hypothesis in enumerate(self.alive)
            for alternative in self.alternatives(hypothesis.ekf, z, R, new_cost)
        ]
        options.sort(key=lambda option: -option[0])
        # twice as many as are kept: some become equal, and they would displace what differs
        options = [each for each in options if each[0] > options[0][0] - PRUNED][: 2 * self.most]
        left = [i for _, i, _ in options]
        found: list[Hypothesis] = []
        for weight, i, alternative in options:
            left.remove(i)
            hypothesis = self.alive[i].copy() if i in left else self.alive[i]
            hypothesis.weight = weight
            hypothesis.wrong += alternative.wrong
            found += hypothesis.split(z, R, alternative.association, size, new_cost)
        found.sort(key=lambda each: -each.weight)
        kept: list[Hypothesis] = []
        for each in found:
            if each.weight < found[0].weight - PRUNED or len(kept) == self.most:
                break
            if not any(each.equals(better, size) for better in kept):
                kept.append(each)
        for each in reversed(kept):
            each.weight -= kept[0].weight
        self.alive = kept

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        parts = {str(i): each.to_arrays() for i, each in enumerate(self.alive)}
        return {**merge(parts), "numbers": np.array([len(parts), self.branching, *self.settled])}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        count, branching, *settled = arrays["numbers"].tolist()
        self.alive = [self.best if i == 0 else self.best.copy() for i in range(int(count))]
        self.branching, self.settled = bool(branching), (settled[0], settled[1])
        for i, hypothesis in enumerate(self.alive):
            hypothesis.from_arrays(select(arrays, str(i)))
