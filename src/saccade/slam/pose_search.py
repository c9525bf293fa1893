"""The search of a kidnapped robot for its pose in its own map."""

from dataclasses import replace

import numpy as np

from saccade.plane import rotations
from saccade.slam.association.outcomes import UNUSED
from saccade.slam.consistency import chi_square_gate, normalized_squared
from saccade.slam.filter.ekf import EkfSlam
from saccade.slam.filter.robot_models import pose_difference
from saccade.slam.relocalization import Relocalizer
from saccade.slam.results import PoseHypotheses
from saccade.types import FloatArray, IntArray

PRIOR_WEIGHT = 9.0
"""Covariance of the prior of a new pose, as a multiple of the covariance of the hypothesis: wide
enough for later observations to dominate, narrow enough for linear updates."""
MIN_HEADING_SIGMA = 0.03
"""Least standard deviation of the heading of this prior, in radians."""
MIN_LABELED = 2
"""Minimum number of matched points with labels."""
SAME_POSE = chi_square_gate(3, 0.999)
"""Largest squared Mahalanobis distance of equal poses."""
MAX_SLIP_DISTANCE = 100.0
"""Largest squared Mahalanobis distance of a position that wrong odometry explains; a robot farther
away was carried."""


class PoseSearch:
    """The search for the pose in a map, until one hypothesis is left.

    The search uses the landmarks with ids `landmarks` (n,), ascending, and does not change the map.
    Unless the robot may be `anywhere`, the pose of the filter is one hypothesis. The robot is found
    when a hypothesis has `min_probability` and `min_matched` points in `scans` successive scans.
    Two points suffice if they have labels, whose probability of being wrong is `wrong_label`, see
    `Relocalizer`; the labels of descriptors do not. Most labels must agree: in another building
    with the same labels, some pairs of them lie as far apart as in the map.
    """

    def __init__(
        self,
        ekf: EkfSlam,
        landmarks: IntArray,
        *,
        anywhere: bool,
        min_matched: int = 3,
        scans: int = 3,
        min_probability: float = 0.999,
        wrong_label: float = 1.0,
    ) -> None:
        self._ekf, self.landmarks, self.anywhere = ekf, landmarks, anywhere
        self._min_matched, self._scans = min_matched, scans
        self._min_probability = min_probability
        self._has_labels = wrong_label < 1
        self._min_labeled = MIN_LABELED if self._has_labels else min_matched
        self.agreeing = 0
        """Number of successive scans that leave one hypothesis."""
        covariance, r = ekf.marginal(landmarks), len(ekf.robot_state)
        positions = ekf.landmarks[np.searchsorted(ekf.ids, landmarks)]
        self._search = Relocalizer(positions, covariance[r:, r:], wrong_label=wrong_label)
        if not anywhere:
            self._search.propose(ekf.pose)
        self._used = np.empty(0, np.bool_)  # observations of the last scan
        self.hypotheses: PoseHypotheses | None = None
        """Hypotheses of the pose at the last scan, with the ids of landmarks."""

    def predict(self, u: FloatArray, U: FloatArray) -> None:
        """Moves the hypotheses by a control (c,) with its covariance (c, c)."""
        self._search.predict(u, U)

    def add(self, z: FloatArray, R: FloatArray, labeled: IntArray) -> PoseHypotheses:
        """Updates the hypotheses by a scan, with ids `labeled` (k,) of labels, -1 for none.

        `UNUSED` leaves an observation out.
        """
        self._used = labeled != UNUSED
        z, R, labeled = z[self._used], R[self._used], labeled[self._used]
        row = np.searchsorted(self.landmarks, labeled).clip(0, len(self.landmarks) - 1)
        rows = np.where(self.landmarks[row] == labeled, row, -1)
        R = R + self._ekf.range_error_variances(z)[:, None, None] * np.diag([1.0, 0.0])
        found = self._search.add(self._ekf.without_range_errors(z), R, rows)
        ids = np.append(self.landmarks, -1)  # the last element stands for no landmark
        self.hypotheses = found = replace(found, association=ids[found.association])
        if len(z) > 0:
            self.agreeing = self.agreeing + 1 if self.is_sure else 0
        return found

    @property
    def is_sure(self) -> bool:
        """Whether the last scan leaves one hypothesis, with enough points."""
        found = self.hypotheses
        if found is None or len(found) == 0 or found.probability[0] < self._min_probability:
            return False
        matched = found.association[0] >= 0
        labeled = np.count_nonzero(matched & self._search.labeled)
        if self._has_labels and 2 * labeled <= np.count_nonzero(self._search.labeled) > 0:
            return False
        return bool(matched.sum() >= self._min_matched or labeled >= self._min_labeled)

    @property
    def is_found(self) -> bool:
        """Whether the robot is found."""
        return self.agreeing >= self._scans

    @property
    def latest(self) -> IntArray:
        """(k,) landmark of each observation of the last scan by the first hypothesis, else -1."""
        assert self.hypotheses is not None
        found = np.full(len(self._used), -1)
        found[self._used] = self.hypotheses.association[0][self._search.latest]
        return found

    def is_elsewhere(self) -> bool:
        """Whether the most probable pose differs from the pose of the filter."""
        assert self.hypotheses is not None
        error = pose_difference(self.hypotheses.pose[0], self._ekf.pose)
        S = self._ekf.pose_covariance + self.hypotheses.covariance[0]
        return self.anywhere or bool(normalized_squared(error, S) > SAME_POSE)

    def is_slip(self) -> bool:
        """Whether wrong odometry explains the most probable pose."""
        assert self.hypotheses is not None
        S = self._ekf.pose_covariance + self.hypotheses.covariance[0]
        error = pose_difference(self.hypotheses.pose[0], self._ekf.pose)
        return bool(normalized_squared(error[:2], S[:2, :2]) <= MAX_SLIP_DISTANCE)

    def correct_pose(self) -> FloatArray:
        """Moves the robot of the filter to the most probable pose, as by unknown odometry.

        In contrast to `reset_pose`, the new pose still depends on the map, which the observations
        that follow correct, too. Returns the displacement (3,), in the frame of the robot.
        """
        assert self.hypotheses is not None
        pose, C = self._ekf.pose, np.array(self.hypotheses.covariance[0])
        turn = rotations(-pose[2])
        moved = pose_difference(self.hypotheses.pose[0], pose)
        moved[:2] = turn @ moved[:2]
        C[:2] = turn @ C[:2]
        C[:, :2] = C[:, :2] @ turn.T
        wide = np.diag([*np.full(2, C[:2, :2].trace() / 2), MIN_HEADING_SIGMA**2])
        self._ekf.predict(moved, PRIOR_WEIGHT * (C + wide), np.zeros((3, 3)), checked=True)
        return moved

    def reset_pose(self) -> None:
        """Gives the filter the most probable pose.

        The prior is wide compared with the covariances of landmarks and hypothesis. The points of
        the last scans then update it, which correlates the pose with the landmarks.
        """
        assert self.hypotheses is not None
        pose, association = self.hypotheses.pose[0], self.hypotheses.association[0]
        association = np.where(np.isin(association, self._ekf.ids), association, -1)
        used = np.searchsorted(self._ekf.ids, association[association >= 0])
        position = self._ekf.landmark_covariances[used].trace(axis1=1, axis2=2).mean()
        wide = np.diag([position, position, MIN_HEADING_SIGMA**2])
        self._ekf.reset_pose(pose, PRIOR_WEIGHT * (self.hypotheses.covariance[0] + wide))
        z, R = self._search.observations
        self._ekf.update(self._ekf.with_range_errors(z), R, association)  # C.10-C.14
