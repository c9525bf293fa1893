"""Recovery of a lost robot: its doubt about the pose, and the search for it in the map."""

import numpy as np

from saccade.io.checkpoint import Arrays, Checkpointed, select
from saccade.plane import steps_between
from saccade.slam.recovery import PoseSearch
from saccade.slam.results import PoseHypotheses
from saccade.types import FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion
from saccade.visual.lost import LostTest
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.optical_flow import PreparedFrame
from saccade.visual.reidentification import descriptor_matches, has_same_height
from saccade.visual.tables import TrackedPoints
from saccade.visual.visual_map import VisualMap

MIN_LANDMARKS = 8
"""Landmarks of a map in which a robot may be lost; in a smaller one it cannot be found again."""
MIN_DOUBT = 1.0
"""Least standard deviation of the position of a lost robot, in metres."""
CARRYING_SPEED = 1.0, 1.0
"""Standard deviations of speed (m/s) and turn rate (rad/s) of a robot that sees nothing and that
odometry believes to stand: it may be carried."""
MIN_MATCHED, FRAMES_IN_AGREEMENT = 5, 2
"""Landmarks that must agree with a hypothesis for the robot to be found, and frames with detections
in a row in which they must."""


class Recovery(Checkpointed):
    """Whether the robot is lost, and the search for it.

    Args:
        visual_map: the map, which is kept as it is while the robot is lost.
        motion: what is known of the steps.
        config: the settings.
    """

    not_state = ("_map", "_motion")

    def __init__(
        self, visual_map: VisualMap, motion: MotionEstimator, config: VisualConfig
    ) -> None:
        self._map, self._motion, self._config = visual_map, motion, config
        self.test = LostTest(config.acceleration_sigma)
        self._search: PoseSearch | None = None
        self._hypotheses: PoseHypotheses | None = None  # of a frame with detections
        self._blind = 0.0  # seconds without sight and motion
        self._first_doubtful = 0  # id of the first landmark initialized since there is evidence
        self._extent = 0.0  # metres, of the map of a lost robot

    @property
    def lost(self) -> bool:
        """Whether the robot is lost."""
        return self._search is not None

    @property
    def hypotheses(self) -> PoseHypotheses | None:
        """Of the pose of a lost robot; that of the filter, with probability 0, if there are none.

        None for a robot that is not lost.
        """
        if not self.lost or (self._hypotheses is not None and len(self._hypotheses)):
            return self._hypotheses
        pose, covariance = self._map.ekf.pose[None], self._map.ekf.pose_covariance[None]
        return PoseHypotheses(pose, covariance, np.zeros(1), np.empty((1, 0), np.int64))

    @property
    def doubt(self) -> FloatArray:
        """(3, 3) covariance of the pose beside that of the filter."""
        speed, turn_rate = CARRYING_SPEED
        position, heading = speed * self._blind, min(turn_rate * self._blind, np.pi / 3**0.5)
        if self.lost:
            position, heading = max(position, self._extent, MIN_DOUBT), np.pi / 3**0.5
        return np.diag(np.square([position, position, heading]))

    def add_motion(
        self,
        frame: PreparedFrame,
        motion: Egomotion | None,
        seconds: float,
        points: int,
        previous: FloatArray,
    ) -> bool:
        """Test the motion to a frame, after the prediction; returns whether the robot is lost.

        Args:
            frame: the frame.
            motion: by the camera.
            seconds: since the last frame.
            points: number of points tracked in the last frame.
            previous: (3,) pose at the last frame.
        """
        test, odometry = self.test, self._motion.odometry
        measured = None if motion is None else self._motion.measured(odometry, motion)
        if test.evidence == 0.0:
            self._first_doubtful = self._map.next_id
        blind = frame.is_blank and test.is_standing(odometry[0])
        inliers = 0 if motion is None else int(motion.inliers.sum())
        continued = test.add_motion(frame, odometry, measured, seconds, points, inliers)
        self._blind = self._blind + seconds if blind else 0.0 if continued else self._blind
        self._hypotheses = None
        if self._search is not None:
            step = steps_between(np.stack([previous, self._map.ekf.pose]))[0]
            self._search.predict(step, (odometry if measured is None else measured)[1])
            if not test.is_lost:
                self._end()
        else:
            self._begin_if_lost()
        return self.lost

    def add_landmarks(self, expected: int, found: int, elsewhere: int) -> bool:
        """`LostTest.add_landmarks`; returns whether the robot is lost."""
        if self.test.evidence == 0.0:
            self._first_doubtful = self._map.next_id
        self.test.add_landmarks(expected, found, elsewhere)
        if self.test.evidence == 0.0:
            self._blind = 0.0
        self._begin_if_lost()
        return self.lost

    def search(self, points: TrackedPoints) -> bool:
        """Search a lost robot by k points of known depth; returns whether it was found.

        Points name the landmarks that their descriptors match.
        """
        assert self._search is not None
        landmarks = self._map.landmarks
        observations, usable = self._map.observe(points)
        pairs = descriptor_matches(points.keypoints, landmarks.descriptor, self._config.ratio)
        index, rows = pairs.T
        keep = usable[index] & has_same_height(observations[index], landmarks.height[rows])
        index, rows = index[keep], rows[keep]
        z, R = observations.z[index], observations.covariance[index]
        self._hypotheses = self._search.add(z, R, rows)
        if not self._search.is_found:
            return False
        self._search.reset_pose()
        self._end()
        return True

    def _new_search(self) -> PoseSearch:
        ekf = self._map.ekf
        return PoseSearch(
            *(ekf, np.arange(len(ekf))),
            anywhere=False,
            min_matched=MIN_MATCHED,
            scans=FRAMES_IN_AGREEMENT,
        )

    def _begin_if_lost(self) -> None:
        """Begin to search; the map is kept without what was added since there is evidence."""
        if not self.test.is_lost or not self._config.recover:
            return
        ids = self._map.landmarks.id
        if np.count_nonzero(ids < self._first_doubtful) < MIN_LANDMARKS:
            self.test.reset()
            return
        self._map.remove(np.flatnonzero(ids >= self._first_doubtful))
        ekf = self._map.ekf
        places = np.vstack([ekf.landmarks, ekf.pose[:2]])
        self._extent = float(np.ptp(places, axis=0).max()) / 2
        self._search = self._new_search()

    def _end(self) -> None:
        self._search = self._hypotheses = None
        self._blind = 0.0
        self.test.reset()

    def from_arrays(self, arrays: Arrays) -> None:
        """Restore the state from the arrays of `to_arrays`, with the map of the same frame."""
        self._search = self._new_search() if select(arrays, "_search") else None
        super().from_arrays(arrays)
