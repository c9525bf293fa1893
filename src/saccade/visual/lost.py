"""Evidence from images that the robot is not where the filter believes it to be.

Three questions are asked of a frame. Did the camera move as odometry says, or else as it moved
before? Where no motion was found, does the view resemble the last one? And, where points are
detected, are landmarks that are expected in view found, or do they agree on another pose? The
answers are log-likelihood ratios of a robot that was moved to one that was not, learned from the
drive so far; `KidnappingDetector` adds them up.
"""

from dataclasses import dataclass, field
from math import dist, isnan, log, nan

import cv2
import numpy as np

from saccade.slam.consistency import normalized_squared
from saccade.slam.kidnapping import KidnappingDetector
from saccade.types import Float32Array, FloatArray
from saccade.visual.egomotion import MotionEstimate
from saccade.visual.optical_flow import PreparedFrame

MAX_EVIDENCE = 6.0
"""Largest evidence of one answer."""
ORDINARY_NIS = 9.0
"""Normalized innovation squared of a motion up to which it is no evidence (3 degrees of freedom).
In undisturbed drives the smaller one to odometry and to the last motion stays below; after a jump
of 0.3 m it is over 100."""
MIN_POINTS = 20
"""Minimum number of tracked points for a failed motion estimate to count as evidence."""
VIEW_SHIFT = 2
"""Largest shift of two reduced images against each other, in pixels."""
MIN_TURN = 0.01
"""Turn of the camera between two frames above which their views are not compared, in radians."""
VIEW_MEMORY = 50.0
"""Number of frames over which the difference of successive views is averaged."""
MIN_VIEW_SPREAD = 0.3
"""Least standard deviation of the logarithm of that difference."""
ORDINARY_VIEW = 1.5
"""Standard deviations up to which a view continues the last one."""
VIEW_OFFSET = 2.0
"""Half the squared standard deviations of a view that is no evidence yet."""
STANDSTILL = 0.1
"""Fraction of its usual motion below which a robot stands."""
BLIND_EVIDENCE = 0.7
"""Evidence of a frame in which a standing robot sees nothing: it may be carried."""
DISCOUNT = 0.97
"""Factor of the evidence in a frame whose motion is as expected."""
NEGLIGIBLE = 0.1
"""Evidence below which there is none."""
TURN_RADIUS = 2.0
"""Distance whose change of the view equals that of a turn by one radian, in meters."""
MIN_EXPECTED = 5
"""Minimum number of lost landmarks expected in view for their absence to be evidence."""
MIN_FOUND = 4
"""Number of re-identified landmarks that refutes the evidence."""
LANDMARK_MEMORY = 30.0
"""Number of detections over which the fraction without a re-identification is averaged."""
MIN_FRACTION = 0.01
"""Least value of that fraction."""
MAX_MISSED = 3.0
"""Largest evidence from landmarks. It is less than the limit: an obstacle hides many at a time, and
landmarks that agree on another pose may show that the filter is overconfident."""
MIN_ELSEWHERE = 6
"""Minimum number of landmarks that agree on another pose to be evidence."""
ELSEWHERE_EVIDENCE = 2.5
"""Evidence of a frame whose landmarks agree on another pose."""


@dataclass
class ImageEvidence:
    """Evidence from the frames of a drive, which it adds to a kidnapping detector."""

    detector: KidnappingDetector
    """Where the evidence is added up."""
    acceleration_sigma: tuple[float, float]
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second."""
    missed: float = 0.0
    """Evidence that landmarks contribute."""
    view: Float32Array = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """(h, w) of the last frame that was not blank."""
    velocity: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """(3,) last motion of the camera by its duration; NaN before the first."""
    blind: float = 0.0
    """Evidence that blank frames contribute."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Pan and tilt of the camera in that frame, in radians."""
    travel: float = 0.0
    """Meters since that view, by odometry; a turn counts `TURN_RADIUS` times."""
    mean_travel: float = 0.0
    """Mean of the travel of one frame, in meters."""
    difference: float = -2.5
    """Mean of the logarithm of one minus the correlation of successive views."""
    difference_variance: float = 0.6**2
    """Variance of that logarithm."""
    views: float = 1.0
    """Number of frames in these means."""
    failures: float = 0.5
    """Number of frames with enough points in which no motion was found."""
    attempts: float = 100.0
    """Number of frames with enough points."""
    without: float = 0.5
    """Fraction of detections without a re-identification."""

    def reset(self) -> None:
        """Forgets the evidence, the last view and the last motion."""
        self.detector.reset()
        self.missed = self.blind = self.travel = 0.0
        self.view, self.velocity = np.zeros((0, 0), np.float32), np.full(3, np.nan)

    def is_standing(self, control: FloatArray) -> bool:
        """Whether the robot stands by a control (3,), which it usually does not."""
        return _travel(control) < STANDSTILL * self.mean_travel

    def add_motion(
        self,
        frame: PreparedFrame,
        odometry: MotionEstimate,
        motion: MotionEstimate | None,
        seconds: float,
        points: int,
        inliers: int,
    ) -> bool:
        """Add the evidence of the motion to a frame, by odometry and by the camera, if any.

        `inliers` of the number of `points` that were tracked in the last frame agree on it. Returns
        whether the frame continues the last one that was not blank.
        """
        self.travel += _travel(odometry[0])
        turn = frame.frame.turn
        direction = (0.0, 0.0) if turn is None else (turn.pan, turn.tilt)
        difference = self._difference(frame.view, direction)
        usual = log(max(self.travel / max(self.mean_travel, 1e-6), 1.0))
        spread = max(self.difference_variance**0.5, MIN_VIEW_SPREAD)
        deviation = (difference - self.difference - usual) / spread
        contradiction = self._evidence_of_motion(odometry, motion, seconds)
        self.detector.add(contradiction)
        verified = inliers >= max(MIN_POINTS, points / 2)
        continued = contradiction == 0.0 if verified else deviation <= ORDINARY_VIEW
        if verified and continued:
            self._learn(difference)
        elif not verified and frame.is_blank and self.is_standing(odometry[0]):
            self.blind += BLIND_EVIDENCE
            self.detector.add(BLIND_EVIDENCE)
        elif not verified and deviation > ORDINARY_VIEW:
            self.detector.add(self._evidence_of_view(deviation, motion is None, points))
        self.attempts += points >= MIN_POINTS
        self.failures += motion is None and points >= MIN_POINTS
        if continued:
            self._discount(verified)
        if motion is not None and seconds > 0:
            self.velocity = motion[0] / seconds
        if frame.view is not None or motion is not None:
            self.travel = self.blind = 0.0
        if frame.view is not None:
            self.view, self.direction = frame.view, direction
        return continued

    def _discount(self, verified: bool) -> None:
        """Discounts the evidence by a frame that continues the last one."""
        self.detector.add(-self.blind)
        if verified and not self.detector.kidnapped:
            self.detector.discount(DISCOUNT)
        if self.detector.evidence < NEGLIGIBLE:
            self.detector.reset()
            self.missed = 0.0

    def add_landmarks(self, expected: int, found: int, elsewhere: int) -> None:
        """Add the evidence of the lost landmarks in a frame in which points are detected.

        Of those `expected` in view so many are `found`; `elsewhere` agree on another pose.
        """
        if found >= MIN_FOUND and found > elsewhere:
            self.detector.reset()
            self.missed = self.blind = 0.0
        elif elsewhere >= MIN_ELSEWHERE and elsewhere > 2 * found:
            self._add_missed(ELSEWHERE_EVIDENCE)
        elif found == 0 and expected >= MIN_EXPECTED and self.detector.evidence > 0:
            self._add_missed(-log(max(self.without, MIN_FRACTION)))
        if expected >= MIN_EXPECTED:
            self.without += (float(found == 0) - self.without) / LANDMARK_MEMORY

    def _add_missed(self, evidence: float) -> None:
        """Add evidence of landmarks, which are not enough by themselves."""
        added = min(evidence, MAX_MISSED - self.missed)
        self.missed += added
        self.detector.add(added)

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

    def _learn(self, difference: float) -> None:
        """Learn how far the robot usually moves, and how much successive views differ then."""
        self.views = min(self.views + 1, VIEW_MEMORY)
        self.mean_travel += (self.travel - self.mean_travel) / self.views
        if not isnan(difference):
            deviation = difference - self.difference
            self.difference += deviation / self.views
            self.difference_variance += (deviation**2 - self.difference_variance) / VIEW_MEMORY

    def _difference(self, view: Float32Array | None, direction: tuple[float, float]) -> float:
        """Log of one minus the best correlation of a view with the last, one of them shifted.

        NaN where one of them is missing, or the camera has turned on the robot between them.
        """
        turned = dist(direction, self.direction) > MIN_TURN
        if view is None or self.view.shape != view.shape or turned:
            return nan
        inner = slice(VIEW_SHIFT, -VIEW_SHIFT)
        correlation = cv2.matchTemplate(view, self.view[inner, inner], cv2.TM_CCOEFF_NORMED)
        return log(max(1.0 - float(correlation.max()), 1e-3))


def _travel(control: FloatArray) -> float:
    """Meters of a control (3,); a turn counts `TURN_RADIUS` times."""
    return float(np.hypot(control[0], control[1])) + TURN_RADIUS * abs(float(control[2]))


def _nis(first: MotionEstimate, second: MotionEstimate) -> float:
    """Normalized squared difference of two controls (3,) with covariances (3, 3)."""
    total = first[1] + second[1] + 1e-9 * np.eye(3)
    return float(normalized_squared(first[0] - second[0], total))
