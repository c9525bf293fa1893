"""Notices that the robot is lost, and finds it again in its map.

A scan is compared with the landmarks that are expected in view: how often each is observed there
was counted before. Once the scans of a few steps fit a robot anywhere better than one where the
filter believes it, the filter stops, and hypotheses of the pose are followed until one is left.
"""

from dataclasses import replace

import numpy as np

from saccade._jit import share
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
from saccade.slam.checkpoint import Arrays, merge, select
from saccade.slam.consistency import chi_square_gate
from saccade.slam.culling import Culling
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.state import scalars
from saccade.slam.models import Motion, wrap
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
FOUND = 0.999
"""Probability from which a hypothesis is right."""
MIN_MATCHED = 3
"""Observed points that must be landmarks of the map for the robot to be found."""
SCANS_IN_AGREEMENT = 3
"""Scans in a row after which one hypothesis must be right for the robot to be found."""
PRIOR_WEIGHT, MIN_HEADING_SIGMA = 9.0, 0.03
"""Of the prior of a pose that is found, relative to its covariance: the observations that follow
dominate it, but it is narrow enough that they are linear; and the heading's, in radians."""
SCALARS = tuple(name for name, _ in EvidenceScalars._fields_)
SAME_POSE = chi_square_gate(3, 0.999)
"""Squared Mahalanobis distance within which the robot is found where it was believed to be."""


class Recovery:
    """Whether the robot is lost, and the search for it.

    Args:
        enabled: whether this is tested at all.
        gate: probability with which an observation of a landmark is inside its gate.
        motion: the motion model.
    """

    def __init__(self, enabled: bool, gate: float, motion: Motion) -> None:
        self.rule = LostRule(enabled, LIMIT, chi_square_gate(2, gate))
        self.evidence = _new_evidence()
        self._motion = motion
        self._search: Relocalizer | None = None
        self._landmarks, self._agreeing, self._scans = np.empty(0, np.int64), 0, 0
        self._anywhere = False
        self.hypotheses: PoseHypotheses | None = None
        """Of the pose at the last scan; None for a robot that is not lost."""

    @property
    def lost(self) -> bool:
        """Whether the robot is lost."""
        return self._search is not None

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
        f, confirmed = ekf.view, culling.in_view.confirmed
        others, known = len(ekf) - f.now.landmarks, ekf.to_view(named)
        return contradicts(f, self.evidence, self.rule, scan.z, scan.R, confirmed, known, others)

    def begin_if_lost(
        self, ekf: EkfSlam, confirmed: BoolArray, scan: Scan, named: IntArray
    ) -> None:
        """Begin to search among `confirmed` landmarks if the evidence is enough."""
        now = self.evidence.now
        if now.total >= self.rule.limit:
            self.begin(ekf, confirmed, anywhere=False)
            now.total = self.rule.limit
            self.search(scan.z, scan.R, named)

    def begin(self, ekf: EkfSlam, confirmed: BoolArray, *, anywhere: bool) -> None:
        """Begin to search among `confirmed` landmarks.

        Args:
            ekf: the filter.
            confirmed: (N,) of its landmarks.
            anywhere: whether nothing is known of the pose; else the search is given up if scans
                agree again with the pose of the filter.
        """
        self._landmarks, self._anywhere = np.flatnonzero(confirmed), anywhere
        self._search = search_among(ekf, self._landmarks, self._motion)
        if not anywhere:
            self._search.propose(ekf.pose)
        self._agreeing = self._scans = 0

    def locate(
        self, ekf: EkfSlam, confirmed: BoolArray, scan: Scan, named: IntArray
    ) -> PoseHypotheses:
        """Hypotheses of a robot that is anywhere, with numbers of the filter's landmarks."""
        if not self.lost:
            self.begin(ekf, confirmed, anywhere=True)
        self.search(scan.z, scan.R, named)
        assert self.hypotheses is not None
        rows = np.append(self._landmarks, -1)  # the last is for none
        return replace(self.hypotheses, association=rows[self.hypotheses.association])

    def follow(self, ekf: EkfSlam, culling: Culling, scan: Scan, named: IntArray) -> IntArray:
        """Follow the hypotheses of a lost robot through a step, which may find it.

        Returns:
            (k,) landmark of each observation, -1 for none.
        """
        assert self._search is not None
        if scan.control is not None:
            self._search.predict(*scan.control)
        if len(scan.z) == 0:
            return np.empty(0, np.int64)
        self.contradicts(ekf, culling, scan, named)
        self.search(scan.z, scan.R, named)
        return self._resume_if_found(ekf)

    def search(self, z: FloatArray, R: FloatArray, named: IntArray) -> None:
        """Weight the hypotheses of a lost robot by a scan, and look for others.

        Args:
            z: (k, 2).
            R: (k, 2, 2).
            named: (k,) landmark that each observation names, -1 for none.
        """
        if self._search is not None:
            self.hypotheses = self._search.add(z, R, self._searched(named))

    def _resume_if_found(self, ekf: EkfSlam) -> IntArray:
        """Reset the pose of the filter and end the search if one hypothesis is left.

        The points of the last scans update the new pose, so that it has its covariance with the
        landmarks.

        Returns:
            (k,) landmark of each observation of the last scan, -1 for none.
        """
        assert self._search is not None
        assert self.hypotheses is not None
        now = self.evidence.now
        now.total = min(now.total, self.rule.limit)
        self._scans = 0 if now.left_out else self._scans + 1
        agrees = now.total < REGAINED or self._scans > MAX_SCANS
        if agrees and not self._anywhere:
            none = np.full(len(self._search.latest), -1)
            self._end()
            return none
        found, latest = self.hypotheses, self._search.latest
        association = found.association[0] if len(found) else np.empty(0, np.int64)
        sure = len(found) > 0 and found.probability[0] >= FOUND
        sure = sure and np.count_nonzero(association >= 0) >= MIN_MATCHED
        self._agreeing = self._agreeing + 1 if sure else 0
        if self._agreeing < SCANS_IN_AGREEMENT:
            return np.full(len(latest), -1)
        association = np.where(association >= 0, self._landmarks[association], -1)
        error = found.pose[0] - ekf.pose
        error[2] = float(wrap(error[2]))
        S = ekf.pose_covariance + found.covariance[0]
        if self._anywhere or error @ np.linalg.solve(S, error) > SAME_POSE:
            ekf.reset_pose(found.pose[0], prior_of(ekf, found.covariance[0], association))
            ekf.update_scan(*self._search.observations, association)  # C.10-C.14
        self._end()
        return np.asarray(association[latest], np.int64)

    def _end(self) -> None:
        self._search = self.hypotheses = None
        now = self.evidence.now
        now.total = now.latest = 0.0
        now.left_out = 0
        self.evidence.points[:] = 0.0

    def _searched(self, named: IntArray) -> IntArray:
        """Numbers of landmarks (k,) among those that are searched, -1 for others."""
        place = np.searchsorted(self._landmarks, named).clip(0, len(self._landmarks) - 1)
        return np.where(self._landmarks[place] == named, place, -1)

    def to_arrays(self) -> Arrays:
        """Its state as named arrays."""
        search = {} if self._search is None else merge({"search": self._search.to_arrays()})
        own = {
            "lost": np.array(self.lost),
            "landmarks": self._landmarks,
            "scans": np.array([self._agreeing, self._scans, self._anywhere]),
        }
        evidence = {
            name: getattr(self.evidence, name) for name in ("expected", "observed", "points")
        }
        now = np.array([float(getattr(self.evidence.now, name)) for name in SCALARS])
        return {**evidence, "now": now, **own, **search}

    def from_arrays(self, arrays: Arrays, ekf: EkfSlam) -> None:
        """Restore what `to_arrays` gave, with the filter of the same step."""
        now = scalars(EvidenceScalars, arrays["now"])
        fields = (arrays[name] for name in ("expected", "observed", "points"))
        self.evidence = share(bind_evidence, *fields, now)
        self._landmarks = arrays["landmarks"]
        self._agreeing, self._scans, anywhere = arrays["scans"].tolist()
        self._anywhere = bool(anywhere)
        self._search, self.hypotheses = None, None
        if arrays["lost"]:
            self._search = search_among(ekf, self._landmarks, self._motion)
            self._search.from_arrays(select(arrays, "search"))


def _new_evidence() -> LostEvidence:
    cells = (RANGES, BEARINGS)
    now = EvidenceScalars(clutter=1.0, scale=4.0, squares=10.0, variance=1.0)
    return share(bind_evidence, np.zeros(cells), np.zeros(cells), np.zeros((POINTS, 3)), now)


def search_among(ekf: EkfSlam, landmarks: IntArray, motion: Motion) -> Relocalizer:
    """A search of the pose among some landmarks (k,) of a filter."""
    r = len(ekf.robot_state)
    covariance = ekf.marginal(landmarks)[r:, r:]
    return Relocalizer(ekf.landmarks[landmarks], covariance, motion=motion)


def prior_of(ekf: EkfSlam, covariance: FloatArray, association: IntArray) -> FloatArray:
    """(3, 3) covariance that is wide beside a hypothesis and the landmarks it is based on.

    The updates that follow give the pose its covariance with the map.
    """
    used = association[association >= 0]
    position = ekf.landmark_covariances[used].trace(axis1=1, axis2=2).mean()
    wide = covariance + np.diag([position, position, MIN_HEADING_SIGMA**2])
    return np.asarray(PRIOR_WEIGHT * wide)
