"""Place recognition scored on laps of one route."""

from collections.abc import Iterable
from typing import NamedTuple

from saccade.types import Keypoints
from saccade.visual.loop_detection import LoopDetectionConfig, LoopDetector

TOLERANCE = 2
"""Frames before and after the true one that show the same place."""


class Detection(NamedTuple):
    """A frame whose place was recognized."""

    frame: int
    match: int
    """Number of the earlier frame said to show the same place."""
    inliers: int
    """Matches consistent with one epipolar geometry."""
    correct: bool
    """Whether the two are a whole number of laps apart, to within `TOLERANCE` frames."""


class PlaceScores(NamedTuple):
    """Precision and recall of place recognition."""

    frames: int
    revisits: int
    """Frames after the first lap."""
    detections: list[Detection]

    @property
    def correct(self) -> int:
        """Number of correct detections."""
        return sum(each.correct for each in self.detections)

    @property
    def precision(self) -> float | None:
        """Fraction of correct detections; None without any."""
        return self.correct / len(self.detections) if self.detections else None

    @property
    def recall(self) -> float | None:
        """Fraction of the revisits that were recognized; None without any."""
        return self.correct / self.revisits if self.revisits else None


def score_places(
    frames: Iterable[Keypoints], lap: int, config: LoopDetectionConfig | None = None
) -> PlaceScores:
    """Recognize places on repeated laps of one route.

    Args:
        frames: keypoints of each frame, in the order of the route.
        lap: number of frames of a lap.
        config: thresholds of the detector.
    """
    detector, detections = LoopDetector(config), []
    count = 0
    for frame, keypoints in enumerate(frames):
        count = frame + 1
        found = detector.detect(keypoints)
        if found is not None:
            offset = (frame - found.place + lap // 2) % lap - lap // 2
            correct = abs(offset) <= TOLERANCE
            detections.append(Detection(frame, found.place, found.inliers, correct))
    return PlaceScores(count, max(count - lap, 0), detections)
