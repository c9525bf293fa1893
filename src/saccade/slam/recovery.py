"""Notices that the robot is lost, and finds it again in its map.

A scan is compared with the landmarks that are expected in view: how often each is observed there
was counted before. Once the scans of a few steps fit a robot anywhere better than one where the
filter believes it, the filter stops, and hypotheses of the pose are followed until one is left.
"""

from dataclasses import replace

import numpy as np

from saccade._jit import share
from saccade.io.checkpoint import Arrays, merge, select
from saccade.slam._recovery_kernels import (
    BEARINGS,
    POINTS,
    RANGES,
    EvidenceScalars,
    LostEvidence,
    LostRule,
    bind_evidence,
    contradicts,
)
from saccade.slam.consistency import chi_square_gate
from saccade.slam.culling import Culling
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import numbers_of, set_numbers
from saccade.slam.models import wrap
from saccade.slam.relocalization import Relocalizer
from saccade.slam.results import PoseHypotheses
from saccade.slam.scans import Scan
from saccade.types import BoolArray, FloatArray, IntArray

LIMIT = 14.0
"""Cumulative log likelihood ratio from which a robot is lost: five scans of the most evidence."""
REGAINED = 7.0
"""Cumulative evidence at which scans agree again with where the robot was believed to be."""
MAX_SCANS = 20
"""Scans in a row without evidence against the belief after which a search is given up."""
PRIOR_WEIGHT, MIN_HEADING_SIGMA = 9.0, 0.03
"""Of the prior of a pose that is found, relative to its covariance: the observations that follow
dominate it, but it is narrow enough that they are linear; and the heading's, in radians."""
LEARNT = ("expected", "observed", "points")
"""Arrays of `LostEvidence`."""
SAME_POSE = chi_square_gate(3, 0.999)
"""Squared Mahalanobis distance within which the robot is found where it was believed to be."""


class PoseSearch:
    """The search of a lost robot for its pose in a map, until one hypothesis is left.

    Args:
        ekf: the filter, whose map stays as it is.
        landmarks: (n,) numbers of those among which the pose is searched, ascending.
        anywhere: whether nothing is known of the pose; else that of the filter is a hypothesis.
        min_matched: observed points that must be landmarks of the map for the robot to be found.
        scans: in a row after which one hypothesis must be right for the robot to be found.
        found: probability from which a hypothesis is right.
    """

    def __init__(
        self,
        ekf: EkfSlam,
        landmarks: IntArray,
        *,
        anywhere: bool,
        min_matched: int = 3,
        scans: int = 3,
        found: float = 0.999,
    ) -> None:
        self._ekf, self.landmarks, self.anywhere = ekf, landmarks, anywhere
        self._min_matched, self._scans, self._found = min_matched, scans, found
        self._agreeing = 0
        covariance = ekf.marginal(landmarks)[len(ekf.robot_state) :, len(ekf.robot_state) :]
        self._search = Relocalizer(ekf.landmarks[landmarks], covariance)
        if not anywhere:
            self._search.propose(ekf.pose)
        self.hypotheses: PoseHypotheses | None = None
        """Of the pose at the last scan, with numbers of the filter's landmarks."""

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Move the hypotheses by a control (c,) with its covariance (c, c)."""
        self._search.predict(u, U)

    def add(self, z: FloatArray, R: FloatArray, named: IntArray) -> PoseHypotheses:
        """Weight the hypotheses by a scan, and look for others.

        Args:
            z: (k, 2).
            R: (k, 2, 2) their covariances.
            named: (k,) landmark that each observation names, -1 for none.
        """
        place = np.searchsorted(self.landmarks, named).clip(0, len(self.landmarks) - 1)
        rows = np.where(self.landmarks[place] == named, place, -1)
        found = self._search.add(z, R, rows)
        numbers = np.append(self.landmarks, -1)  # the last is for none
        self.hypotheses = found = replace(found, association=numbers[found.association])
        sure = len(found) > 0 and found.probability[0] >= self._found
        sure = sure and np.count_nonzero(found.association[0] >= 0) >= self._min_matched
        self._agreeing = self._agreeing + 1 if sure else 0
        return found

    @property
    def is_found(self) -> bool:
        """Whether one hypothesis is left."""
        return self._agreeing >= self._scans

    def latest(self, hypothesis: int | None) -> IntArray:
        """(k,) landmark of each observation of the last scan by a hypothesis, -1 for none."""
        if hypothesis is None or self.hypotheses is None:
            return np.full(len(self._search.latest), -1)
        return np.asarray(self.hypotheses.association[hypothesis][self._search.latest], np.int64)

    def is_elsewhere(self) -> bool:
        """Whether the most probable pose is not that of the filter."""
        assert self.hypotheses is not None
        error = self.hypotheses.pose[0] - self._ekf.pose
        error[2] = float(wrap(error[2]))
        S = self._ekf.pose_covariance + self.hypotheses.covariance[0]
        return self.anywhere or bool(error @ np.linalg.solve(S, error) > SAME_POSE)

    def reset_pose(self) -> None:
        """Give the filter the most probable pose.

        The points of the last scans update it, so that it has its covariance with the landmarks:
        its own before that is wide beside theirs and that of the hypothesis.
        """
        assert self.hypotheses is not None
        pose, association = self.hypotheses.pose[0], self.hypotheses.association[0]
        used = association[association >= 0]
        position = self._ekf.landmark_covariances[used].trace(axis1=1, axis2=2).mean()
        wide = np.diag([position, position, MIN_HEADING_SIGMA**2])
        self._ekf.reset_pose(pose, PRIOR_WEIGHT * (self.hypotheses.covariance[0] + wide))
        self._ekf.update_scan(*self._search.observations, association)  # C.10-C.14

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        own = {"landmarks": self.landmarks, "agreeing": np.array(self._agreeing)}
        return {**own, "anywhere": np.array(self.anywhere), **self._search.to_arrays()}

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore what `to_arrays` of a search among the same landmarks gave."""
        self._agreeing, self.anywhere = int(arrays["agreeing"]), bool(arrays["anywhere"])
        self._search.from_arrays(arrays)


class Recovery:
    """Whether the robot is lost by its landmarks, and the search for it.

    Args:
        enabled: whether this is tested at all.
        gate: probability with which an observation of a landmark is inside its gate.
    """

    def __init__(self, enabled: bool, gate: float) -> None:
        self.rule = LostRule(enabled, LIMIT, chi_square_gate(2, gate))
        self.evidence = _new_evidence()
        self._search: PoseSearch | None = None
        self._scans = 0  # in a row without evidence against the belief

    @property
    def lost(self) -> bool:
        """Whether the robot is lost."""
        return self._search is not None

    @property
    def hypotheses(self) -> PoseHypotheses | None:
        """Of the pose at the last scan; None for a robot that is not lost."""
        return None if self._search is None else self._search.hypotheses

    def contradicts(self, ekf: EkfSlam, culling: Culling, scan: Scan, named: IntArray) -> bool:
        """Whether a scan contradicts that the robot is where the filter believes; see the kernel.

        Args:
            ekf: the filter, before the update.
            culling: which of its landmarks are confirmed.
            scan: the scan.
            named: (k,) landmark that each observation names, -1 for none.
        """
        if not self.rule.enabled:
            return False
        f, confirmed = ekf.view, culling.confirmed_in_view(ekf)
        others, known = len(ekf) - f.now.landmarks, ekf.to_view(named)
        return contradicts(f, self.evidence, self.rule, scan.z, scan.R, confirmed, known, others)

    def begin_if_lost(
        self, ekf: EkfSlam, confirmed: BoolArray, scan: Scan, named: IntArray
    ) -> bool:
        """Begin to search among `confirmed` landmarks (N,) if the evidence is enough.

        Returns:
            Whether the robot is lost.
        """
        now = self.evidence.now
        if now.total < self.rule.limit:
            return False
        now.total, self._scans = self.rule.limit, 0
        self._search = PoseSearch(ekf, np.flatnonzero(confirmed), anywhere=False)
        self._search.add(scan.z, scan.R, named)
        return True

    def locate(
        self, ekf: EkfSlam, confirmed: BoolArray, scan: Scan, named: IntArray
    ) -> PoseHypotheses:
        """Hypotheses of a robot that is anywhere among `confirmed` landmarks (N,)."""
        if self._search is None:
            self._search = PoseSearch(ekf, np.flatnonzero(confirmed), anywhere=True)
        return self._search.add(scan.z, scan.R, named)

    def follow(self, ekf: EkfSlam, culling: Culling, scan: Scan, named: IntArray) -> IntArray:
        """Follow the hypotheses of a lost robot through a step, which may find it.

        The search ends if one hypothesis is left, or if scans agree again with the pose of the
        filter.

        Returns:
            (k,) landmark of each observation, -1 for none.
        """
        search = self._search
        assert search is not None
        if scan.control is not None:
            search.predict(*scan.control)
        if len(scan.z) == 0:
            return np.empty(0, np.int64)
        self.contradicts(ekf, culling, scan, named)
        search.add(scan.z, scan.R, named)
        now = self.evidence.now
        now.total = min(now.total, self.rule.limit)
        self._scans = 0 if now.left_out else self._scans + 1
        agrees = now.total < REGAINED or self._scans > MAX_SCANS
        if agrees and not search.anywhere:
            self._end()
        elif search.is_found:
            if search.is_elsewhere():
                search.reset_pose()
            self._end()
            return search.latest(0)
        return search.latest(None)

    def _end(self) -> None:
        self._search = None
        now = self.evidence.now
        now.total = now.latest = 0.0
        now.left_out = 0
        self.evidence.points[:] = 0.0

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        search = {} if self._search is None else merge({"search": self._search.to_arrays()})
        numbers = {"now": numbers_of(self.evidence.now), "scans": np.array(self._scans)}
        return {name: getattr(self.evidence, name) for name in LEARNT} | numbers | search

    def from_arrays(self, arrays: Arrays, ekf: EkfSlam) -> None:
        """Restore what `to_arrays` gave, with the filter of the same step."""
        for name in LEARNT:
            getattr(self.evidence, name)[:] = arrays[name]
        set_numbers(self.evidence.now, arrays["now"])
        self._scans, self._search = int(arrays["scans"]), None
        if search := select(arrays, "search"):
            self._search = PoseSearch(ekf, search["landmarks"], anywhere=True)
            self._search.from_arrays(search)


def _new_evidence() -> LostEvidence:
    cells = (RANGES, BEARINGS)
    now = EvidenceScalars(clutter=1.0, scale=4.0, squares=10.0, variance=1.0)
    return share(bind_evidence, np.zeros(cells), np.zeros(cells), np.zeros((POINTS, 3)), now)
