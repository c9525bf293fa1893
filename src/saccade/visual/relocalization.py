"""The search of a lost robot in the map of its drive, by the points of its camera."""

import numpy as np

from saccade.plane import steps_between
from saccade.slam.consistency import normalized_squared
from saccade.slam.filter.robot_models import pose_difference
from saccade.slam.kidnapping import KidnappingDetector
from saccade.slam.pose_search import PRIOR_WEIGHT, SAME_POSE, PoseSearch
from saccade.slam.results import PoseHypotheses
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion
from saccade.visual.lost import ImageEvidence
from saccade.visual.optical_flow import PreparedFrame
from saccade.visual.points import TrackedPoints
from saccade.visual.reidentification import descriptor_matches, has_same_height
from saccade.visual.visual_map import VisualMap

MAX_IMAGE_EVIDENCE = 4.0
"""Largest evidence from images of a robot that is not kidnapped. It is smaller than for landmark
scans, since frames contradict the motion more rarely than scans contradict the map."""
MIN_LANDMARKS = 8
"""Minimum number of landmarks of a map in which a lost robot can be found."""
MIN_POSITION_SIGMA = 1.0
"""Least standard deviation of the position of a lost robot, in meters."""
CARRIED_SPEED = 1.0
"""Standard deviation of the speed of a robot without sight whose odometry stands, in m/s."""
CARRIED_TURN_RATE = 1.0
"""Standard deviation of its turn rate, in rad/s."""
MIN_MATCHED = 5
"""Minimum number of landmarks that must agree with a hypothesis for the robot to be found."""
MIN_AGREEING_FRAMES = 2
"""Successive frames with detections in which they must agree."""
UNKNOWN_HEADING = np.pi / 3**0.5
"""Standard deviation of a heading that is unknown, in radians."""


class Relocalization:
    """Whether the robot is lost, and the search for it in its map, which meanwhile stays."""

    def __init__(self, visual_map: VisualMap, config: VisualConfig) -> None:
        self._map, self._motion, self._config = visual_map, visual_map.motion, config
        self._detector = KidnappingDetector(False, config.gate, MAX_IMAGE_EVIDENCE)
        self._evidence = ImageEvidence(self._detector, config.acceleration_sigma)
        self._hypotheses: PoseHypotheses | None = None  # of a frame with detections
        self._blind = 0.0  # seconds without sight and motion
        self._first_doubtful = 0  # id of the first landmark that was initialized with evidence
        self._extent = 0.0  # meters, of the map of a lost robot
        self.by_tags = False
        """Whether tags alone begin a search: they contradict the pose more reliably than images."""

    @property
    def lost(self) -> bool:
        """Whether the robot is lost."""
        return self._detector.lost

    @property
    def hypotheses(self) -> PoseHypotheses | None:
        """Hypotheses of the pose of a lost robot; None for one that is not lost.

        Without any, the pose of the filter with probability 0.
        """
        if not self.lost or (self._hypotheses is not None and len(self._hypotheses)):
            return self._hypotheses
        pose, covariance = self._map.ekf.pose[None], self._map.ekf.pose_covariance[None]
        return PoseHypotheses(pose, covariance, np.zeros(1), np.empty((1, 0), np.int64))

    @property
    def extra_covariance(self) -> FloatArray:
        """(3, 3) additional covariance of the pose."""
        position = CARRIED_SPEED * self._blind
        heading = min(CARRIED_TURN_RATE * self._blind, UNKNOWN_HEADING)
        if self.lost:
            position, heading = max(position, self._extent, MIN_POSITION_SIGMA), UNKNOWN_HEADING
        return np.diag(np.square([position, position, heading]))

    def add_motion(
        self,
        frame: PreparedFrame,
        motion: Egomotion | None,
        points: int,
        previous: FloatArray,
    ) -> bool:
        """Tests the motion to a frame, after the prediction; returns whether the robot is lost.

        `points` is the number of points tracked in the last frame, `previous` (3,) its pose.
        """
        odometry, seconds = self._motion.measured(None), self._motion.seconds
        measured = None if motion is None else self._motion.measured(motion)
        self._mark_landmarks()
        blind = frame.is_blank and self._evidence.is_standing(odometry[0])
        inliers = 0 if motion is None else int(motion.inliers.sum())
        continued = self._evidence.add_motion(frame, odometry, measured, seconds, points, inliers)
        self._blind = self._blind + seconds if blind else 0.0 if continued else self._blind
        self._hypotheses = None
        search = self._detector.search
        if search is None:
            self._begin_if_lost()
        else:
            step = steps_between(np.stack([previous, self._map.ekf.pose]))[0]
            search.predict(step, (odometry if measured is None else measured)[1])
            if not self._detector.kidnapped:
                self._end()
        return self.lost

    def add_landmarks(self, expected: int, found: int, elsewhere: int) -> bool:
        """`ImageEvidence.add_landmarks`; returns whether the robot is lost."""
        self._mark_landmarks()
        self._evidence.add_landmarks(expected, found, elsewhere)
        if self._detector.evidence == 0.0:
            self._blind = 0.0
        self._begin_if_lost()
        return self.lost

    def search(self, points: TrackedPoints) -> None:
        """Searches a lost robot by k points of known depth, labeled by their descriptors."""
        search, landmarks = self._detector.search, self._map.landmarks
        assert search is not None
        observations, usable = self._map.observe(points)
        natural = np.flatnonzero(~landmarks.is_tag)
        descriptors = landmarks.descriptor[natural]
        index, matched = descriptor_matches(points.keypoints, descriptors, self._config.ratio).T
        rows = natural[matched]
        keep = usable[index] & has_same_height(observations[index], landmarks.height[rows])
        index, rows = index[keep], rows[keep]
        z, R = observations.z[index], observations.covariance[index]
        self._hypotheses = search.add(z, R, landmarks.id[rows])
        if search.is_found:
            search.reset_pose()
            self._end()

    def contradict(self) -> None:
        """Begins the search, since tags agree on another pose."""
        if self._config.recover and not self.lost:
            self._detector.add(MAX_IMAGE_EVIDENCE)
            self._begin()

    def confirm(self) -> None:
        """Forgets the evidence, since tags agree with the pose."""
        self._detector.reset()
        self._blind, self._first_doubtful = 0.0, self._map.next_id

    def locate(self, pose: FloatArray, covariance: FloatArray) -> None:
        """Ends the search at a pose (3,) with covariance (3, 3) that was found by tags.

        The filter keeps its own pose if it agrees.
        """
        ekf = self._map.ekf
        error = pose_difference(pose, ekf.pose)
        if normalized_squared(error, ekf.pose_covariance + covariance) > SAME_POSE:
            ekf.reset_pose(pose, PRIOR_WEIGHT * covariance)
        self._end()

    def _mark_landmarks(self) -> None:
        """Marks the landmarks that are initialized from now on, unless there is evidence."""
        if self._detector.evidence == 0.0 and not self.by_tags:
            self._first_doubtful = self._map.next_id

    def _begin_if_lost(self) -> None:
        """Begins the search; landmarks initialized since there is evidence leave the map."""
        if not self._detector.kidnapped or not self._config.recover:
            return
        ids = self._map.landmarks.id
        if self.by_tags or np.count_nonzero(ids < self._first_doubtful) < MIN_LANDMARKS:
            self._evidence.reset()
            return
        self._begin()

    def _begin(self) -> None:
        """Begins the search in the landmarks that were initialized without evidence."""
        ids = self._map.landmarks.id
        self._map.remove(np.flatnonzero(ids >= self._first_doubtful))
        ekf = self._map.ekf
        self._extent = float(np.ptp(np.vstack([ekf.landmarks, ekf.pose[:2]]), axis=0).max()) / 2
        search = PoseSearch(
            *(ekf, ekf.ids),
            anywhere=False,
            min_matched=MIN_MATCHED,
            scans=MIN_AGREEING_FRAMES,
        )
        self._detector.begin(search)

    def _end(self) -> None:
        """Ends the search."""
        self._detector.end()
        self._hypotheses, self._blind = None, 0.0
        self._evidence.reset()
