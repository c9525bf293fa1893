"""Detects a kidnapped robot, and finds it again in its map.

A scan is compared with the landmarks that are expected in view: how often each is observed there
was counted before. When the scans of a few steps fit a robot anywhere better than one where the
filter believes it, the filter stops, and hypotheses of the pose are followed until one is left.
"""

import numpy as np

from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.landmark_evidence import LandmarkEvidence
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

MIN_LANDMARKS = 8
"""Size of the smallest map that is tested; in a smaller one a robot cannot be found again."""
MIN_CONTRADICTION = 1.5
"""Evidence of a scan from which it contradicts the believed pose."""
MIN_CUMULATIVE = 4.0
"""Cumulative evidence from which a scan without labels contradicts the believed pose: gates protect
the filter from most of a single wrong scan."""
MIN_CONTRADICTED_LABELS = 3
"""Labels of a scan whose landmarks are not where the filter expects them for the scan to
contradict the believed pose; fewer are rejected one by one."""


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
        self.evidence = 0.0
        """Cumulative evidence."""
        self.landmark_evidence = LandmarkEvidence(chi_square_gate(2, gate))
        """Evidence of landmarks."""
        self._agreeing = 0  # successive scans without evidence against the believed pose

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
        self.evidence = max(self.evidence + evidence, 0.0)

    def discount(self, factor: float) -> None:
        """Multiplies the evidence, when a frame continues the last one."""
        self.evidence *= factor

    def reset(self) -> None:
        """Forgets the evidence."""
        self.evidence, self.contradicted = 0.0, False
        self.landmark_evidence.points.clear()

    def update(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan) -> None:
        """Adds the evidence of a scan of landmarks, before the filter is updated by it.

        A scan that does not contradict the believed pose tells which landmarks are detected.
        """
        self.contradicted, self.blocks_update = False, self.lost
        if not self.enabled or len(scan.z) == 0 or len(ekf) < MIN_LANDMARKS:
            return
        f, confirmed, landmarks = ekf.active, table.counts.confirmed, self.landmark_evidence
        if ekf.submap is not None:
            confirmed = confirmed[table.rows(ekf.active_ids)]
        compared = landmarks.compare(f, scan, confirmed, ekf.rows(table.landmarks_of(scan.labels)))
        latest = landmarks.evaluate(f, compared)
        self.add(latest)
        if self.evidence == 0:
            landmarks.points.clear()
        enough = self.evidence >= MIN_CUMULATIVE
        if compared.has_labels:
            enough = compared.num_contradicted_labels >= MIN_CONTRADICTED_LABELS
        self.contradicted = latest >= MIN_CONTRADICTION and enough
        if not self.contradicted:
            landmarks.learn(compared)
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
        self.evidence = min(self.evidence, self.limit)
        if begins:
            return none
        self._agreeing = 0 if self.contradicted else self._agreeing + 1
        agrees = self.evidence < REGAINED or self._agreeing > MAX_AGREEING_SCANS
        if agrees and not search.anywhere:
            self.end()
        elif search.is_found:
            if search.is_elsewhere():
                search.reset_pose()
            self.end()
            return search.latest
        return none
