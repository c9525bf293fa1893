"""Detects a kidnapped robot, and finds it again in its map.

A scan is compared with the landmarks that are expected in view, with detection rates of earlier
scans. When the scans of a few steps contradict the estimated pose, the filter stops, and hypotheses
of the pose are tracked until one is left.

A label that contradicts the estimated pose has two explanations: its landmark has moved, or the
robot has. Landmarks of a given map stand still, so that the robot has moved. While mapping the
landmark has moved, until another pose explains two labels of this and other scans. If wrong
odometry explains this pose, it replaces the estimated one; if not, the robot was carried away.
"""

import numpy as np

from saccade.slam.association.labels import loop_gate
from saccade.slam.association.nearest_neighbor import compare
from saccade.slam.consistency import chi_square_gate
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.landmark_evidence import LandmarkEvidence, ScanComparison
from saccade.slam.landmarks import LandmarkTable
from saccade.slam.pose_search import PoseSearch
from saccade.slam.results import PoseHypotheses
from saccade.slam.scans import Scan
from saccade.types import IntArray

MIN_KIDNAPPING_EVIDENCE = 14.0
"""Minimum evidence (a log-likelihood ratio) for a robot to be kidnapped, reached by five scans."""
REGAINED = 7.0
"""Largest evidence of scans that agree with the estimated pose again."""
MAX_AGREEING_SCANS = 20
"""Largest number of successive scans that agree with the estimated pose during a search."""

MIN_LANDMARKS = 8
"""Size of the smallest map in which a robot can be relocalized; smaller maps are not tested."""
MIN_CONTRADICTION = 1.5
"""Minimum evidence of a scan that contradicts the estimated pose."""
MIN_CUMULATIVE = 4.0
"""Minimum cumulative evidence for a scan without labels to contradict the estimated pose: gates
protect the filter from most of a single wrong scan."""
MIN_CONTRADICTED_LABELS = 3
"""Minimum number of contradicted labels for a scan to contradict the estimated pose, if landmarks
may have moved; fewer are rejected one by one."""
MIN_AGREEING = 2
"""Minimum number of successive scans whose labels agree with another pose for it to replace the
estimated one."""


class KidnappingDetector:
    """CUSUM test (Page 1954) of the hypothesis that the estimated pose is wrong.

    Evidence is the log-likelihood ratio of a robot anywhere to a robot at the estimated pose; its
    cumulative sum is never negative. `update` adds the evidence of a scan of landmarks. A camera
    calls `add` for a frame that contradicts the estimated pose, with the ratio of this frame;
    `discount` for a frame that continues the last one; `reset` when landmarks agree with the
    estimated pose. Once the sum reaches `limit` the robot is kidnapped: `begin` starts the search
    for its pose, and the robot is `lost` until `end`.

    A step calls `update`, for a lost robot `relocalize`, and updates the filter by the scan unless
    `blocks_update`.

    Args:
        enabled: whether scans of landmarks are tested.
        gate: probability with which an observation of a landmark is inside its gate.
        limit: minimum evidence for the robot to be kidnapped.
        standing: whether the landmarks are known not to move.
        label_gate: probability with which an observation of the landmark of its label is inside its
            gate.
    """

    def __init__(
        self,
        enabled: bool,
        gate: float,
        limit: float = MIN_KIDNAPPING_EVIDENCE,
        *,
        standing: bool = False,
        label_gate: float = 0.99999,
    ) -> None:
        self.enabled, self.limit, self._standing = enabled, limit, standing
        self._label_gate = chi_square_gate(2, label_gate)
        self.search: PoseSearch | None = None
        """The search for the pose of a lost robot."""
        self.contradicted = False
        """Whether the last scan contradicts the estimated pose."""
        self.blocks_update = False
        """Whether the last scan must not update the filter."""
        self.correction = np.zeros(3)
        """(3,) displacement by which labels corrected the pose before the last scan, else zero."""
        self.evidence = 0.0
        """Cumulative evidence."""
        self.landmark_evidence = LandmarkEvidence(chi_square_gate(2, gate))
        """Evidence of landmarks."""
        self._agreeing = 0  # successive scans that agree with the estimated pose
        self._doubt: PoseSearch | None = None  # search since a label contradicts the estimated pose

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
        """Adds evidence from any source; negative evidence supports the estimated pose."""
        self.evidence = max(self.evidence + evidence, 0.0)

    def discount(self, factor: float) -> None:
        """Multiplies the cumulative evidence by a factor."""
        self.evidence *= factor

    def reset(self) -> None:
        """Forgets the evidence."""
        self.evidence, self.contradicted, self._doubt = 0.0, False, None
        self.landmark_evidence.points.clear()

    def update(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan) -> None:
        """Adds the evidence of a scan of landmarks, before the filter is updated by it.

        A scan that does not contradict the estimated pose updates the averages.
        """
        self.contradicted, self.blocks_update = False, self.lost
        self.correction = np.zeros(3)
        if self._doubt is not None and scan.control is not None:
            self._doubt.predict(*scan.control[:2])
        if not self.enabled or len(scan.z) == 0:
            return
        labeled = table.landmarks_of(scan.labels)
        if len(ekf) < MIN_LANDMARKS and not (self._standing and (labeled >= 0).any()):
            return
        f, confirmed, landmarks = ekf.active, table.counts.confirmed, self.landmark_evidence
        if ekf.submap is not None:
            confirmed = confirmed[table.rows(ekf.active_ids)]
        counts = table.detection_counts
        compared = landmarks.compare(f, scan, confirmed, ekf.rows(labeled), counts)
        if compared.num_contradicted_labels > 0:
            compared = self._without_accepted(ekf, labeled, compared)
        standing = self._are_labels_evidence(ekf, table, scan, compared)
        doubt = self._doubt
        if doubt is not None and standing and not self._standing and self._is_slip(doubt):
            self.correction = doubt.correct_pose()
            self.reset()
            return
        latest = landmarks.evaluate(f, compared, standing=standing)
        self.add(latest)
        if self.evidence == 0:
            landmarks.points.clear()
            self._doubt = None
        enough = self.evidence >= MIN_CUMULATIVE
        if compared.num_labeled > 0:
            enough = standing or compared.num_contradicted_labels >= MIN_CONTRADICTED_LABELS
        self.contradicted = latest >= MIN_CONTRADICTION and enough
        if not self.contradicted and not self.lost:
            landmarks.learn(compared)
        self.blocks_update = self.contradicted or self.lost

    def _is_slip(self, search: PoseSearch) -> bool:
        """Whether labels agree with a pose that wrong odometry explains."""
        return search.agreeing >= MIN_AGREEING and search.is_slip()

    def _without_accepted(
        self, ekf: EkfSlam, labeled: IntArray, compared: ScanComparison
    ) -> ScanComparison:
        """The comparison, in which labels of landmarks (k,) that are accepted are no evidence."""
        far = compared.labeled & (compared.density == 0)
        nis, ratio = compare(ekf, compared.z, compared.R, np.where(far, labeled, -1))
        gates = [loop_gate(each, self._label_gate) for each in ratio.tolist()]
        accepted = far & (nis <= gates)
        return compared._replace(
            density=np.where(accepted, 1 / compared.view, compared.density),
            num_contradicted_labels=int(np.count_nonzero(far & ~accepted)),
        )

    def _are_labels_evidence(
        self, ekf: EkfSlam, table: LandmarkTable, scan: Scan, compared: ScanComparison
    ) -> bool:
        """Whether the contradicting labels of a scan are of landmarks that stand still.

        They must outnumber those that agree. While mapping, another pose must explain two labels.
        """
        doubtful = 2 * compared.num_contradicted_labels > compared.num_labeled
        if self.lost:
            return doubtful and self._standing
        if doubtful and self._doubt is None:
            self._doubt = self._search_in(ekf, table)
        if self._doubt is None:
            return doubtful and self._standing
        self._doubt.add(scan.z, scan.R, table.searched_for(scan.labels))
        elsewhere = self._doubt.is_sure and self._doubt.is_elsewhere()
        return doubtful and (self._standing or elsewhere)

    def _search_in(self, ekf: EkfSlam, table: LandmarkTable) -> PoseSearch | None:
        """A search of the pose in the map, from the estimated pose on; None without a map."""
        landmarks = table.counts.id[table.in_map]
        if len(landmarks) < (1 if self._standing else MIN_LANDMARKS):
            return None
        wrong = self.landmark_evidence.wrong_label
        return PoseSearch(ekf, landmarks, anywhere=False, wrong_label=wrong)

    def begin(self, search: PoseSearch) -> None:
        """Begins the search for the pose."""
        self.search, self._agreeing = search, 0

    def end(self) -> None:
        """Ends the search, and forgets the evidence."""
        self.search = None
        self.reset()

    def relocalize(self, ekf: EkfSlam, table: LandmarkTable, scan: Scan) -> IntArray:
        """Updates the hypotheses of a lost robot's pose by a step, which may end the search.

        The search begins when the evidence reaches its limit. It ends if one hypothesis is left,
        which becomes the pose of the filter, or if scans agree with the estimated pose again.

        Returns:
            (k,) id of the landmark of each observation if the robot was found, else -1.
        """
        none = np.full(len(scan.z), -1)
        begins = not self.lost
        if begins:
            search = self._doubt or self._search_in(ekf, table)
            if search is None:  # no map: nothing that the scan could contradict
                self.reset()
                return none
            if self._doubt is None and len(scan.z) > 0:
                search.add(scan.z, scan.R, table.searched_for(scan.labels))
            self.begin(search)
            self._doubt = None
            self.evidence = min(self.evidence, self.limit)
            return none
        search = self.search
        assert search is not None
        if scan.control is not None:
            search.predict(*scan.control[:2])
        if len(scan.z) == 0:
            return none
        search.add(scan.z, scan.R, table.searched_for(scan.labels))
        self.evidence = min(self.evidence, self.limit)
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
