"""Several association hypotheses at once, for landmarks closer than the uncertainty of the pose.

After Reid (1979), "An algorithm for tracking multiple targets": every hypothesis is a filter with
a map of its own. Where a scan has several alternatives, its hypothesis is split, and the most
probable ones are kept. The alternatives are joint associations of the scan (Neira & Tardos 2001).
"""

import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from saccade.slam._step_kernels import StepResults, Steps
from saccade.slam.association._kernels import NEW
from saccade.slam.association.alternatives import Alternatives, log_determinant
from saccade.slam.checkpoint import Arrays, arrays_of, merge, select
from saccade.slam.consistency import normalized_squared
from saccade.slam.filter._range_bearing_kernels import Innovations
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.joining import join_landmarks
from saccade.slam.map_management.culling import Culling
from saccade.slam.models import wrap
from saccade.slam.online import Slam
from saccade.slam.results import check_diverged, new_innovations
from saccade.types import FloatArray, IntArray

PRUNED = 16.0
"""Log likelihood ratio to the most probable hypothesis at which another one is dropped."""
TEMPER = 0.5
"""Power of the likelihood of a scan in the weight of a hypothesis: the noise of successive scans
from almost the same pose is not independent."""
SYSTEMATIC = 0.5
"""Systematic errors of the sensor, as a fraction of its noise, by which two estimates of one
landmark may differ: averaging does not make them smaller."""
MAX_TOGETHER = 0.05
"""Two landmarks are not one if this fraction of the observations of either were in a scan with the
other."""
MIN_GAIN = 3.0
"""Log likelihood ratio from which two landmarks are one."""
MAX_DISTANCE = 4.0
"""Of two landmarks that may be one: standard deviations of their difference."""
EQUAL_POSE, EQUAL_MAP, MIN_HEADING = 0.5, 1.5, 0.005
"""Two hypotheses are one if their poses differ by less than this fraction of their standard
deviation, their landmarks by less than this one of an observation's, and their headings by less
than so many radians."""


@dataclass
class Hypothesis:
    """One association of all observations, and the filter that follows from it."""

    ekf: EkfSlam
    culling: Culling
    weight: float = 0.0
    """Log probability, relative to that of the most probable hypothesis."""
    together: IntArray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    """(N, N) number of scans in which both landmarks were observed; of one, on the diagonal."""
    association: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(k,) landmark of each observation of the `Steps` so far, -1 if it is not used."""
    innovations: Innovations = field(default_factory=lambda: new_innovations(0))
    """Those of the present scan, see `Innovation`."""
    culled: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    """(g,) landmarks that were removed after the present scan."""

    def copy(self) -> "Hypothesis":
        """An independent one that is equal."""
        ekf, culling = copy.copy(self.ekf), copy.copy(self.culling)
        for part in (ekf, culling):
            part.from_arrays({name: array.copy() for name, array in part.to_arrays().items()})
        return Hypothesis(ekf, culling, self.weight, self.together.copy(), self.association.copy())

    def observe(self, z: FloatArray, R: FloatArray, association: IntArray, size: float) -> None:
        """Update by a scan (C.10-C.18), then join and cull landmarks.

        Args:
            z: (m, 2) observations.
            R: (m, 2, 2) their covariances.
            association: (m,) numbers of landmarks and `NEW`.
            size: metres, standard deviation of the position of an observed point.
        """
        ekf, mapped = self.ekf, len(self.ekf)
        predicted = ekf.predict_observations().z if self.culling.is_due() else None
        new = association == NEW
        association = np.where(new, mapped + np.cumsum(new) - 1, association)
        self.innovations = ekf.update_scan(z, R, association)
        self.together = np.pad(self.together, (0, len(ekf) - len(self.together)))
        self.together[np.ix_(association, association)] += 1
        self.culling.update(ekf, predicted, mapped, float(z[:, 0].max()), association)
        self.association = np.append(self.association, association)
        ids = ekf.ids
        while (pair := self._duplicate(self.association[-len(z) :], size)) is not None:
            self._join(*pair)
        self._remove(np.zeros(0, np.int64))
        self.culled = np.flatnonzero(~np.isin(ids, ekf.ids))

    def _duplicate(self, observed: IntArray, size: float) -> tuple[float, int, int] | None:
        """Log likelihood ratio and numbers of the two landmarks that are most probably one."""
        points, count, best = self.ekf.landmarks, self.together.diagonal(), None
        confirmed = self.culling.confirmed(len(points))
        deviation = np.sqrt(self.ekf.landmark_covariances.trace(0, 1, 2))  # (N,)
        systematic = (SYSTEMATIC * size) ** 2 * np.eye(2)
        observed = np.unique(observed[observed >= 0])  # not those that were removed
        for j in observed[confirmed[observed]].tolist():
            apart = self.together[j] <= MAX_TOGETHER * np.minimum(count, count[j])
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
            gain = (Alternatives.new_cost - nis - log_determinant(S) + 4 * np.log(size)) / 2
            gain[nis > MAX_DISTANCE**2] = -np.inf
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
        self.together[kept] += self.together[removed]
        self.together[:, kept] += self.together[:, removed]
        self._remove(np.array([removed]))

    def _remove(self, landmarks: IntArray) -> None:
        """Remove landmarks, and those that are to be culled."""
        removed = self.culling.remove_culled(landmarks)
        if len(removed) > 0:
            kept = np.setdiff1d(np.arange(len(self.ekf)), removed)
            number = np.full(len(self.ekf) + 1, -1)  # the last is for none
            number[kept] = np.arange(len(kept))
            self.association = number[self.association]
            self.together = self.together[np.ix_(kept, kept)]
            self.ekf.remove(removed)

    def equals(self, other: "Hypothesis", size: float) -> bool:
        """Whether the poses and the maps are almost the same."""
        variance = np.maximum(self.ekf.pose_covariance.diagonal(), 0.0)
        tolerance = np.maximum(EQUAL_POSE * np.sqrt(variance), [size, size, MIN_HEADING])
        difference = self.ekf.pose - other.ekf.pose
        difference[2] = wrap(difference[2])
        maps = [each.ekf.landmarks[each.culling.confirmed(len(each.ekf))] for each in (self, other)]
        if (np.abs(difference) > tolerance).any() or len(maps[0]) != len(maps[1]):
            return False
        distance = np.abs(maps[0][:, None] - maps[1]).max(2)
        return len(distance) == 0 or bool(distance.min(1).max() < EQUAL_MAP * size)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays, between two steps."""
        parts = {"ekf": arrays_of("ekf", self.ekf), "culling": arrays_of("culling", self.culling)}
        arrays = {"together": self.together, "association": self.association}
        return {**merge(parts), **arrays, "weight": np.array(self.weight)}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        self.ekf.from_arrays(select(arrays, "ekf"))
        self.culling.from_arrays(select(arrays, "culling"))
        self.together, self.association = arrays["together"], arrays["association"]
        self.weight = float(arrays["weight"])


class MultiHypothesisSlam(Slam):
    """EKF-SLAM with several association hypotheses, each a filter with a map of its own.

    The results of a step are those of the most probable hypothesis after it, and so are the filter
    and the map. Once another one is the most probable, its map and its numbers of landmarks take
    the place of the former ones; what was reported stays.

    Names of landmarks are not used. `load` goes on with all hypotheses. In the mode "localize"
    there is one filter, with the rule "mutual".
    """

    @cached_property
    def hypotheses(self) -> list[Hypothesis]:
        """The most probable one first, which has the filter of this object."""
        return [Hypothesis(self.ekf, self.culling)]

    def advance(self, s: Steps, end: int, out: StepResults) -> list[IntArray]:
        """Take the steps before `end`; see `Slam.advance`."""
        if self.mode == "localize":
            return super().advance(s, end, out)
        start, culled = int(s.position[0]), []
        for i in range(start, end):
            scan = slice(s.edge[i], s.edge[i + 1])
            for each in self.hypotheses:
                if i == 0:
                    each.association = np.zeros(0, np.int64)
                if i >= s.still[0]:
                    each.ekf.predict(s.control[i], s.U[i])  # C.5-C.9
            if scan.stop > scan.start:
                self._observe(s.z[scan], s.R[scan])
                best = self.hypotheses[0]
                self.ekf, self.culling = best.ekf, best.culling
                s.landmark[: scan.stop] = best.association
                for array, values in zip(out.innovations, best.innovations, strict=True):
                    array[scan] = values
                culled += [best.culled] if len(best.culled) > 0 else []
            out.pose[i], out.covariance[i] = self.ekf.pose, self.ekf.pose_covariance
            s.position[0] = i + 1
        first = int(s.first[0])
        self.num_steps = first + end
        check_diverged(out.pose[start:end], first + start)
        return culled

    def _observe(self, z: FloatArray, R: FloatArray) -> None:
        """Split the hypotheses by the alternatives of a scan, and keep the most probable ones."""
        alternatives = Alternatives(self.config.gate)
        options = [
            (hypothesis.weight - TEMPER * cost / 2, i, association)
            for i, hypothesis in enumerate(self.hypotheses)
            for cost, association in alternatives(hypothesis.ekf, z, R)
        ]
        options.sort(key=lambda option: -option[0])
        likely = [each for each in options if each[0] > options[0][0] - PRUNED]
        options = likely[: self.config.max_hypotheses]
        left = [i for _, i, _ in options]
        split = []
        for weight, i, association in options:
            left.remove(i)
            hypothesis = self.hypotheses[i].copy() if i in left else self.hypotheses[i]
            hypothesis.weight = weight
            split.append((hypothesis, association))
        size = float(np.exp(log_determinant(R).mean() / 4) * np.sqrt(z[:, 0].mean()))
        for hypothesis, association in split:
            hypothesis.observe(z, R, association, size)
        split.sort(key=lambda each: -each[0].weight)
        kept: list[Hypothesis] = []
        for hypothesis, _ in split:
            if not any(hypothesis.equals(better, size) for better in kept):
                kept.append(hypothesis)
        for hypothesis in reversed(kept):
            hypothesis.weight -= kept[0].weight
        self.hypotheses = kept

    def to_arrays(self) -> Arrays:
        """Its state as named arrays; see `Slam.to_arrays`."""
        parts = {str(i): each.to_arrays() for i, each in enumerate(self.hypotheses)}
        arrays = merge({"hypotheses": {**merge(parts), "count": np.array(len(parts))}})
        return {**super().to_arrays(), **arrays}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` gave."""
        super().from_arrays(arrays)
        saved = select(arrays, "hypotheses")
        self.hypotheses = [Hypothesis(self.ekf, self.culling).copy() for _ in range(saved["count"])]
        for i, hypothesis in enumerate(self.hypotheses):
            hypothesis.from_arrays(select(saved, str(i)))
        self.ekf, self.culling = self.hypotheses[0].ekf, self.hypotheses[0].culling
