"""Lost robots: evidence that one is not where the filter believes it to be, and its recovery.

Three questions are asked of every frame: whether the camera moved as odometry says, or else as it
moved before; where no motion was found, whether the view resembles the last one; and, where points
are detected, whether landmarks that are expected in view are found, or agree on another pose. The
answers are log likelihood ratios of a robot that was moved to one that was not, learnt from the
drive so far, and their sum is one test (CUSUM, Page 1954). A lost robot doubts its pose, and is
searched in the map.
"""

from dataclasses import dataclass, field
from math import dist, log, nan

import cv2
import numpy as np

from saccade.plane import steps_between
from saccade.slam.pose_search import PoseSearch
from saccade.slam.results import PoseHypotheses
from saccade.types import Float32Array, FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.egomotion import Egomotion, MotionEstimate
from saccade.visual.motion_estimator import MotionEstimator
from saccade.visual.optical_flow import PreparedFrame
from saccade.visual.reidentification import descriptor_matches, has_same_height
from saccade.visual.tables import TrackedPoints
from saccade.visual.visual_map import VisualMap

LIMIT = 4.0
"""Evidence from which the robot is lost."""
MAX_EVIDENCE = 6.0
"""Largest evidence of one answer."""
ORDINARY_NIS = 9.0
"""Normalized innovation squared of a motion (3 degrees of freedom) up to which it is no evidence:
the smaller of two, to odometry and to the last motion. In undisturbed drives it stays below, after
a jump of 0.3 m it is over 100."""
MIN_POINTS = 20
"""Tracked points from which it is evidence that no motion is found; and which, with half of all,
must agree on a motion so that the view need not be compared."""
RARELY = 0.5, 100.0
"""Failures and attempts with which the counts begin."""
VIEW_SHIFT = 2
"""Pixels by which the reduced images may be shifted against each other."""
MIN_TURN = 0.01
"""Radians between two frames by which a camera turns, and does not only tremble."""
VIEW_MEMORY = 50.0
"""Frames over which the difference of successive views is averaged."""
VIEW_SPREAD, MIN_VIEW_SPREAD = 0.6, 0.3
"""Standard deviation of the logarithm of that difference, at the start and at least."""
ORDINARY, VIEW_OFFSET = 1.5, 2.0
"""Standard deviations up to which a view continues the last one; and what is subtracted from half
of their square, so that usual differences are no evidence."""
STANDING = 0.1
"""Fraction of its usual motion within which a robot stands, as odometry believes."""
BLIND = 0.7
"""Evidence of a frame in which a standing robot sees nothing: it may be carried."""
FORGETTING, NEGLIGIBLE = 0.97, 0.1
"""Factor of the evidence in a frame whose motion is as expected, and below what it is none."""
RADIUS = 2.0
"""Metres; a turn changes the view as much as this times as long a distance."""
MIN_EXPECTED, MIN_FOUND = 5, 4
"""Lost landmarks that must be expected in view to count a detection; and those that agree on the
believed pose which refute that the robot is lost."""
LANDMARK_MEMORY, RAREST = 30.0, 0.01
"""Detections over which the fraction without a re-identification is averaged, and its least."""
MAX_MISSED = 3.0
"""Largest evidence of landmarks, less than makes lost: what hides one hides many, and those that
agree on another pose may show that the filter is overconfident."""
MIN_ELSEWHERE, ELSEWHERE = 6, 2.5
"""Landmarks that agree on a pose outside of all gates, and the evidence of such a frame."""
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


class Recovery:
    """Whether the robot is lost, and the search for it.

    Args:
        visual_map: the map, which is kept as it is while the robot is lost.
        motion: what is known of the steps.
        config: the settings.
    """

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
        self._hypotheses = self._search.add(z, R, landmarks.id[rows])
        if not self._search.is_found:
            return False
        self._search.reset_pose()
        self._end()
        return True

    def _new_search(self) -> PoseSearch:
        ekf = self._map.ekf
        return PoseSearch(
            *(ekf, ekf.ids),
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


@dataclass
class LostTest:
    """Cumulative evidence that the robot is not where the filter believes it to be."""

    acceleration_sigma: tuple[float, float]
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second."""
    evidence: float = 0.0
    """Cumulative log likelihood ratio."""
    missed: float = 0.0
    """The part of it that missed landmarks contribute."""
    view: Float32Array = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """(h, w) of the last frame that was not blank."""
    velocity: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """(3,) last motion of the camera by its duration; NaN before the first."""
    blind: float = 0.0
    """The part of the evidence that comes from seeing nothing."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Pan and tilt of the camera in the last frame, in radians."""
    turned: bool = False
    """Whether the camera has turned on the robot since the last view."""
    travel: float = 0.0
    """Metres since that view, by odometry; a turn counts `RADIUS` times."""
    mean_travel: float = 0.0
    """Of one frame."""
    difference: float = -2.5
    """Mean of the logarithm of one minus the correlation of successive views."""
    difference_variance: float = VIEW_SPREAD**2
    views: float = 1.0
    """Frames in these means."""
    failures: float = RARELY[0]
    attempts: float = RARELY[1]
    """Frames in which no motion was found of enough points, of all frames with enough."""
    without: float = 0.5
    """Fraction of detections without a re-identification."""

    @property
    def is_lost(self) -> bool:
        """Whether the evidence suffices."""
        return self.evidence >= LIMIT

    def reset(self) -> None:
        """Forget the evidence, and what was seen and how the robot moved before."""
        self.evidence = self.missed = self.blind = self.travel = 0.0
        self.view, self.velocity = np.zeros((0, 0), np.float32), np.full(3, np.nan)

    def is_standing(self, control: FloatArray) -> bool:
        """Whether the robot stands by a control (3,), which it usually does not."""
        return _travel(control) < STANDING * self.mean_travel

    def add_motion(
        self,
        frame: PreparedFrame,
        odometry: MotionEstimate,
        motion: MotionEstimate | None,
        seconds: float,
        points: int,
        inliers: int,
    ) -> bool:
        """Add the evidence of the motion to a frame.

        Args:
            frame: the frame.
            odometry: control (3,) since the last frame, and its covariance (3, 3).
            motion: the same by the camera; None where it found none.
            seconds: since the last frame.
            points: number of points that were tracked in the last frame.
            inliers: number of them that agree on the motion.

        Returns:
            Whether the frame continues the last one that was not blank.
        """
        self.travel += _travel(odometry[0])
        view, turn = frame.view, frame.frame.turn
        direction = (0.0, 0.0) if turn is None else (turn.pan, turn.tilt)
        self.turned |= dist(direction, self.direction) > MIN_TURN
        self.direction = direction
        deviation = self._deviation(view)
        continued = deviation <= ORDINARY
        contradiction = self._evidence_of_motion(odometry, motion, seconds)
        self.evidence += contradiction
        verified = inliers >= max(MIN_POINTS, points / 2)
        if verified:
            continued = contradiction == 0.0
            if continued:
                self._learn(view)
        elif frame.is_blank and self.is_standing(odometry[0]):
            self.blind += BLIND
            self.evidence += BLIND
        elif deviation > ORDINARY:
            self.evidence += self._evidence_of_view(deviation, motion is None, points)
        if motion is not None and seconds > 0:
            self.velocity = motion[0] / seconds
        if points >= MIN_POINTS:
            self.attempts += 1
            self.failures += motion is None
        if continued:
            self.evidence -= self.blind
            self.evidence *= FORGETTING if verified and not self.is_lost else 1.0
            if self.evidence < NEGLIGIBLE:
                self.evidence = self.missed = 0.0
        if view is not None or motion is not None:
            self.travel = self.blind = 0.0
        if view is not None:
            self.view, self.turned = view, False
        return continued

    def add_landmarks(self, expected: int, found: int, elsewhere: int) -> None:
        """Add the evidence of the lost landmarks in a frame in which points are detected.

        Args:
            expected: number of them that are expected in view.
            found: that are re-identified.
            elsewhere: that agree on another pose than the believed one.
        """
        if found >= MIN_FOUND and found > elsewhere:
            self.evidence = self.missed = self.blind = 0.0
        elif elsewhere >= MIN_ELSEWHERE and elsewhere > 2 * found:
            self._add_missed(ELSEWHERE)
        elif found == 0 and expected >= MIN_EXPECTED and self.evidence > 0:
            self._add_missed(-log(max(self.without, RAREST)))
        if expected >= MIN_EXPECTED:
            self.without += (float(found == 0) - self.without) / LANDMARK_MEMORY

    def _add_missed(self, evidence: float) -> None:
        """Add evidence of landmarks, which are not enough by themselves."""
        added = min(evidence, MAX_MISSED - self.missed)
        self.evidence, self.missed = self.evidence + added, self.missed + added

    def _evidence_of_motion(
        self, odometry: MotionEstimate, motion: MotionEstimate | None, seconds: float
    ) -> float:
        """Evidence of a motion that contradicts both odometry and the last motion.

        A camera that does not move was not carried: the wheels slip, or the frame is a copy.
        """
        if motion is None or not np.isfinite(self.velocity).all() or self.is_standing(motion[0]):
            return 0.0
        speed, turn_rate = self.acceleration_sigma
        change = np.diag(np.square(np.array([speed, speed, turn_rate]) * seconds**2))
        last = self.velocity * seconds, motion[1] + change
        excess = min(_nis(motion, odometry), _nis(motion, last)) - ORDINARY_NIS
        return min(max(excess, 0.0) / 2, MAX_EVIDENCE)

    def _evidence_of_view(self, deviation: float, failed: bool, points: int) -> float:
        """Evidence of a view that deviates from the last, by whether a motion was found."""
        by_view = max(deviation**2 / 2 - VIEW_OFFSET, 0.0)
        failure = -log(self.failures / self.attempts) if failed and points >= MIN_POINTS else 0.0
        return min(by_view + failure, MAX_EVIDENCE)

    def _learn(self, view: Float32Array | None) -> None:
        """Learn how far the robot usually moves, and how much successive views differ then."""
        self.views = min(self.views + 1, VIEW_MEMORY)
        self.mean_travel += (self.travel - self.mean_travel) / self.views
        if view is None or self.view.shape != view.shape or self.turned:
            return
        deviation = _difference(self.view, view) - self.difference
        self.difference += deviation / self.views
        self.difference_variance += (deviation**2 - self.difference_variance) / VIEW_MEMORY

    def _deviation(self, view: Float32Array | None) -> float:
        """Standard deviations by which the difference of a view from the last exceeds the mean.

        NaN where one of them is missing, or the camera has turned between them.
        """
        if view is None or self.view.shape != view.shape or self.turned:
            return nan
        usual = log(max(self.travel / max(self.mean_travel, 1e-6), 1.0))
        spread = max(float(np.sqrt(self.difference_variance)), MIN_VIEW_SPREAD)
        return (_difference(self.view, view) - self.difference - usual) / spread


def _travel(control: FloatArray) -> float:
    """Metres of a control (3,); a turn counts `RADIUS` times."""
    return float(np.hypot(control[0], control[1])) + RADIUS * abs(float(control[2]))


def _nis(first: MotionEstimate, second: MotionEstimate) -> float:
    """Normalized squared difference of two controls (3,) with covariances (3, 3)."""
    v = first[0] - second[0]
    return float(v @ np.linalg.solve(first[1] + second[1] + 1e-9 * np.eye(3), v))


def _difference(first: Float32Array, second: Float32Array) -> float:
    """Log of one minus the best correlation of two views, one of them shifted."""
    inner = slice(VIEW_SHIFT, -VIEW_SHIFT)
    correlation = cv2.matchTemplate(second, first[inner, inner], cv2.TM_CCOEFF_NORMED)
    return log(max(1.0 - float(correlation.max()), 1e-3))
