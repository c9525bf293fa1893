"""Evidence from images for kidnapping: the robot is not at the pose of the filter.

Each frame has up to three kinds of evidence: a motion that agrees neither with odometry nor with
the last motion; without a motion estimate, a view that differs from the last one; and landmarks
expected in view that are missing or agree on another pose. Evidence is a log-likelihood ratio of
kidnapping, learned from the drive so far, and is accumulated by `KidnappingDetector`.
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
"""Maximum evidence of a motion or view."""
ORDINARY_NIS = 9.0
"""Maximum normalized innovation squared of an ordinary motion (3 degrees of freedom). Undisturbed
drives stay below, with the smaller one of odometry and last motion; a jump of 0.3 m exceeds 100."""
MIN_TRACKED_POINTS = 20
"""Minimum number of tracked points for a failed motion estimate to count as evidence."""
VIEW_SHIFT = 2
"""Maximum shift between two reduced images that are compared, in pixels."""
MAX_VIEW_TURN = 0.01
"""Maximum turn of the camera between two views that are compared, in radians."""
VIEW_MEMORY = 50.0
"""Number of frames in the running mean of the difference of successive views."""
MIN_VIEW_SPREAD = 0.3
"""Minimum standard deviation of the logarithm of the difference of views."""
ORDINARY_VIEW = 1.5
"""Maximum deviation of a view that continues the last one, in standard deviations."""
VIEW_OFFSET = 2.0
"""Half the squared normalized deviation of a view without evidence."""
STANDSTILL = 0.1
"""Maximum motion of a standing robot, as a fraction of its mean motion."""
BLIND_EVIDENCE = 0.7
"""Evidence of a blank frame of a standing robot, which may be carried."""
DISCOUNT = 0.97
"""Factor of the evidence after a frame with an ordinary motion."""
NEGLIGIBLE_EVIDENCE = 0.1
"""Maximum evidence that is reset to zero."""
TURN_RADIUS = 2.0
"""Distance that changes the view as much as a turn by one radian, in meters."""
MIN_EXPECTED_LANDMARKS = 5
"""Minimum number of lost landmarks expected in view for missing ones to be evidence."""
MIN_FOUND = 4
"""Minimum number of re-identified landmarks that refutes kidnapping."""
LANDMARK_MEMORY = 30.0
"""Number of detections in the running mean of the fraction without a re-identification."""
MIN_UNIDENTIFIED_FRACTION = 0.01
"""Minimum fraction of detections without a re-identification."""
MAX_MISSED = 3.0
"""Maximum evidence from landmarks. It is below the limit, since an obstacle hides many landmarks
at a time, and landmarks that agree on another pose may reveal an overconfident filter."""
MIN_ELSEWHERE = 6
"""Minimum number of landmarks that agree on another pose for evidence."""
ELSEWHERE_EVIDENCE = 2.5
"""Evidence of a frame whose landmarks agree on another pose."""


@dataclass
class ImageEvidence:
    """Adds evidence from the frames of a drive to a kidnapping detector."""

    detector: KidnappingDetector
    """Accumulates the evidence."""
    acceleration_sigma: tuple[float, float]
    """Standard deviations of the change of speed (m/s) and turn rate (rad/s) in a second."""
    missed: float = 0.0
    """Evidence from landmarks."""
    view: Float32Array = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """(h, w) reduced image of the last frame that was not blank."""
    velocity: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """(3,) motion per second in the last step; NaN before the first."""
    blind: float = 0.0
    """Evidence from blank frames."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Pan and tilt of the camera at the last view, in radians."""
    travel: float = 0.0
    """Distance by odometry since the last view, in meters; turns count `TURN_RADIUS` times."""
    mean_travel: float = 0.0
    """Mean travel of a frame, in meters."""
    difference: float = -2.5
    """Mean logarithm of one minus the correlation of successive views."""
    difference_variance: float = 0.6**2
    """Variance of this logarithm."""
    views: float = 1.0
    """Number of frames in the running means of views."""
    failures: float = 0.5
    """Number of frames with enough points but without a motion estimate."""
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
        """Whether a control (3,) is far below the mean motion."""
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
        """Adds the evidence of the last step, by odometry and by the camera, if any.

        `points` is the number of points in the last frame, `inliers` the number that agree with the
        motion. Returns whether the frame continues the last one that was not blank.
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
        verified = inliers >= max(MIN_TRACKED_POINTS, points / 2)
        continued = contradiction == 0.0 if verified else deviation <= ORDINARY_VIEW
        if verified and continued:
            self._learn(difference)
        elif not verified and frame.is_blank and self.is_standing(odometry[0]):
            self.blind += BLIND_EVIDENCE
            self.detector.add(BLIND_EVIDENCE)
        elif not verified and deviation > ORDINARY_VIEW:
            self.detector.add(self._evidence_of_view(deviation, motion is None, points))
        self.attempts += points >= MIN_TRACKED_POINTS
        self.failures += motion is None and points >= MIN_TRACKED_POINTS
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
        """Discounts the evidence after a frame that continues the last one."""
        self.detector.add(-self.blind)
        if verified and not self.detector.kidnapped:
            self.detector.discount(DISCOUNT)
        if self.detector.evidence < NEGLIGIBLE_EVIDENCE:
            self.detector.reset()
            self.missed = 0.0

    def add_landmarks(self, expected: int, found: int, elsewhere: int) -> None:
        """Adds the evidence of lost landmarks in a frame with detected points.

        Arguments are the numbers of landmarks `expected` in view, `found` there, and that agree on
        another pose (`elsewhere`).
        """
        if found >= MIN_FOUND and found > elsewhere:
            self.detector.reset()
            self.missed = self.blind = 0.0
        elif elsewhere >= MIN_ELSEWHERE and elsewhere > 2 * found:
            self._add_missed(ELSEWHERE_EVIDENCE)
        elif found == 0 and expected >= MIN_EXPECTED_LANDMARKS and self.detector.evidence > 0:
            self._add_missed(-log(max(self.without, MIN_UNIDENTIFIED_FRACTION)))
        if expected >= MIN_EXPECTED_LANDMARKS:
            self.without += (float(found == 0) - self.without) / LANDMARK_MEMORY

    def _add_missed(self, evidence: float) -> None:
        """Adds evidence from landmarks, up to `MAX_MISSED`."""
        added = min(evidence, MAX_MISSED - self.missed)
        self.missed += added
        self.detector.add(added)

    def _evidence_of_motion(
        self, odometry: MotionEstimate, motion: MotionEstimate | None, seconds: float
    ) -> float:
        """Evidence of a motion that agrees neither with odometry nor with the last motion.

        A camera without motion is no evidence: the wheels slip, or the frame is a copy.
        """
        if motion is None or not np.isfinite(self.velocity).all() or self.is_standing(motion[0]):
            return 0.0
        speed, turn_rate = self.acceleration_sigma
        change = np.diag(np.square(np.array([speed, speed, turn_rate]) * seconds**2))
        last = self.velocity * seconds, motion[1] + change
        excess = min(_nis(motion, odometry), _nis(motion, last)) - ORDINARY_NIS
        return min(max(excess, 0.0) / 2, MAX_EVIDENCE)

    def _evidence_of_view(self, deviation: float, failed: bool, points: int) -> float:
        """Evidence of a view that deviates from the last one, and of a failed motion estimate."""
        by_view = max(deviation**2 / 2 - VIEW_OFFSET, 0.0)
        failure = (
            -log(self.failures / self.attempts) if failed and points >= MIN_TRACKED_POINTS else 0.0
        )
        return min(by_view + failure, MAX_EVIDENCE)

    def _learn(self, difference: float) -> None:
        """Updates the mean motion of a frame, and the mean difference of successive views."""
        self.views = min(self.views + 1, VIEW_MEMORY)
        self.mean_travel += (self.travel - self.mean_travel) / self.views
        if not isnan(difference):
            deviation = difference - self.difference
            self.difference += deviation / self.views
            self.difference_variance += (deviation**2 - self.difference_variance) / VIEW_MEMORY

    def _difference(self, view: Float32Array | None, direction: tuple[float, float]) -> float:
        """Logarithm of one minus the maximum correlation of a shifted view with the last view.

        NaN if a view is missing, or if the camera turned on the robot between the views.
        """
        turned = dist(direction, self.direction) > MAX_VIEW_TURN
        if view is None or self.view.shape != view.shape or turned:
            return nan
        inner = slice(VIEW_SHIFT, -VIEW_SHIFT)
        correlation = cv2.matchTemplate(view, self.view[inner, inner], cv2.TM_CCOEFF_NORMED)
        return log(max(1.0 - float(correlation.max()), 1e-3))


def _travel(control: FloatArray) -> float:
    """Distance of a control (3,) in meters; turns count `TURN_RADIUS` times."""
    return float(np.hypot(control[0], control[1])) + TURN_RADIUS * abs(float(control[2]))


def _nis(first: MotionEstimate, second: MotionEstimate) -> float:
    """Normalized squared difference of two controls (3,) with covariances (3, 3)."""
    total = first[1] + second[1] + 1e-9 * np.eye(3)
    return float(normalized_squared(first[0] - second[0], total))
