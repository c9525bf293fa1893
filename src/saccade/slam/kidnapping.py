"""Detects a kidnapped robot, and finds it again in its map.

A scan is compared with the landmarks that are expected in view: how often each is observed there
was counted before. When the scans of a few steps fit a robot anywhere better than one where the
filter believes it, the filter stops, and hypotheses of the pose are followed until one is left.
"""

import numpy as np

from saccade._jit import share
from saccade.slam._kidnapping_kernels import (
    BEARINGS,
    POINTS,
    RANGES,
    EvidenceScalars,
    LandmarkEvidence,
    bind_evidence,
    update_evidence,
)
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.landmarks import LandmarkTable
from saccade.slam.pose_search import PoseSearch
from saccade.slam.results import PoseHypotheses
from saccade.slam.scans import Scan
from saccade.types import IntArray

LIMIT = 14.0
"""Evidence (a log-likelihood ratio) from which a robot is kidnapped: five scans of the most."""
REGAINED = 7.0
"""Evidence at which scans agree again with where the robot was believed to be."""
MAX_AGREEING_SCANS = 20
"""Successive scans without evidence against the believed pose after which a search ends."""


class KidnappingDetector:
    """Cumulative evidence that the robot is not where the filter believes it (CUSUM, Page 1954).

    Evidence is a log-likelihood ratio of a robot anywhere to one at the believed pose. `update`
    adds that of a scan of landmarks. A camera adds its own: `add` for a frame that contradicts the
    believed pose, with the ratio of this frame; `discount` for one that continues the last frame;
    `reset` when landmarks agree on the believed pose. From `limit` on the robot is kidnapped:
    `begin` starts the search for its pose, and until it has ended the robot is `lost`. The sum is
    never negative, whatever the evidence is from, and `end` forgets it.

    A step calls `update`, for a lost robot `relocalize`, and updates the filter by the scan unless
    `blocks_update`.

    Args:
        enabled: whether scans of landmarks are tested at all.
        gate: probability with which an observation of a landmark is inside its gate.
        limit: evidence from which the robot is kidnapped.
    """

    def __init__(self, enabled: bool, gate: float, limit: float = LIMIT) -> None:
        self.enabled, self.limit = enabled, limit
        self.search: PoseSearch | None = None
        """The search for the pose of a lost robot."""
        self.contradicted = False
        """Whether the last scan contradicts the believed pose."""
        self.blocks_update = False
        """Whether the last scan must not update the filter."""
        self._gate = chi_square_gate(2, gate)
        self._agreeing = 0  # successive scans without evidence against the believed pose
        cells = (RANGES, BEARINGS)
        now = EvidenceScalars(clutter=1.0, scale=4.0, squares=10.0, variance=1.0)
        arrays = np.zeros(cells), np.zeros(cells), np.zeros((POINTS, 3))
        self.landmark_evidence: LandmarkEvidence = share(bind_evidence, *arrays, now)
        """Detection rates, and unexplained points, that the evidence of landmarks is by."""

    @property
    def evidence(self) -> float:
        """Cumulative evidence."""
        return float(self.landmark_evidence.now.total)

    @property
    def kidnapped(self) -> bool:
        """Whether the evidence suffices."""
        return self.evidence >= self.limit

    @property
    def lost(self) -> bool:
        """Whether the pose is being searched."""
        return self.search is not None

    @property
    def hypotheses(self) -> PoseHypotheses | None:
        """Hypotheses of the pose at the last scan; None for a robot that is not lost."""
        return None if self.search is None else self.search.hypotheses

    def add(self, evidence: float) -> None:
        """Adds evidence, of any source; negative for the believed pose."""
        now = self.landmark_evidence.now
        now.total = max(now.total + evidence, 0.0)

    def discount(self, factor: float) -> None:
        """Multiplies the evidence, when a frame continues the last one."""
        self.landmark_evidence.now.total *= factor

    def reset(self) -> None:
        """Forgets the evidence."""
        now, self.contradicted = self.landmark_evidence.now, False
        now.total = now.latest = 0.0
        self.landmark_evidence.points[:] = 0.0

    def update(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan) -> None:
        """Adds the evidence of a scan of landmarks; see `update_evidence`.

        Args:
            ekf: the filter, before the update.
            table: its landmarks.
            scan: the scan.
        """
        self.contradicted, self.blocks_update = False, self.lost
        if not self.enabled or len(scan.z) == 0:
            return
        f, confirmed = ekf.active, table.counts.confirmed
        if ekf.submap is not None:
            confirmed = confirmed[table.rows(ekf.active_ids)]
        others = len(ekf) - f.now.landmarks
        self.contradicted = update_evidence(
            *(f, self.landmark_evidence, self._gate, scan.z, scan.R),
            *(confirmed, ekf.rows(table.landmarks_of(scan.labels)), others),
        )
        self.blocks_update = self.contradicted or self.lost

    def begin(self, search: PoseSearch) -> None:
        """Begins the search for the pose."""
        self.search, self._agreeing = search, 0

    def end(self) -> None:
        """Ends the search, and forgets the evidence."""
        self.search = None
        self.reset()

    def relocalize(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan) -> IntArray:
        """Follows the hypotheses of a lost robot through a step, which may find it.

        The search begins with the scan from which the robot is kidnapped. It ends if one hypothesis
        is left, which becomes the pose of the filter, or if scans agree again with that pose.

        Returns:
            (k,) id of the landmark of each observation by which the robot was found, else -1.
        """
        none = np.full(len(scan.z), -1)
        begins = not self.lost
        if begins:
            self.begin(PoseSearch(ekf, table.counts.id[table.in_map], anywhere=False))
        search = self.search
        assert search is not None
        if scan.control is not None and not begins:
            search.predict(*scan.control)
        if len(scan.z) == 0:
            return none
        search.add(scan.z, scan.R, table.landmarks_of(scan.labels))
        now = self.landmark_evidence.now
        now.total = min(now.total, self.limit)
        if begins:
            return none
        self._agreeing = 0 if self.contradicted else self._agreeing + 1
        agrees = now.total < REGAINED or self._agreeing > MAX_AGREEING_SCANS
        if agrees and not search.anywhere:
            self.end()
        elif search.is_found:
            if search.is_elsewhere():
                search.reset_pose()
            self.end()
            return search.latest
        return none
