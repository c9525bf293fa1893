"""Loop detection: recognizes places by matching the keypoints of whole frames."""

from dataclasses import dataclass
from typing import NamedTuple

from saccade.errors import Settings, setting
from saccade.keypoints.matching import match
from saccade.keypoints.verification import verify
from saccade.types import Keypoints


class PlaceMatch(NamedTuple):
    """A recognized place."""

    place: int
    """Number of the earlier frame."""
    inliers: int
    """Matches that agree with the epipolar geometry of the two views."""


@dataclass(frozen=True)
class LoopDetectionConfig(Settings):
    """Thresholds of loop detection."""

    ratio: float = setting(0.8, above=0, maximum=1)
    """Ratio test: distance to the nearest descriptor over that to the second."""
    min_inliers: int = setting(22, 8)
    """Matches that must agree with one epipolar geometry. Different places of a hallway have up to
    18 by chance, of 500 points each."""
    min_gap: int = setting(15, 1)
    """Least number of frames between two views of a place."""


class LoopDetector:
    """Recognizes the places of a sequence of frames."""

    def __init__(self, config: LoopDetectionConfig | None = None) -> None:
        self._config = config or LoopDetectionConfig()
        self._places: list[Keypoints] = []

    def detect(self, points: Keypoints) -> PlaceMatch | None:
        """Recognize the place of a frame by its keypoints with descriptors, and add the frame.

        Returns:
            The earlier frame with the most inliers; None where none has enough.
        """
        best: PlaceMatch | None = None
        config, earlier = self._config, len(self._places) + 1 - self._config.min_gap
        for number, place in enumerate(self._places[: max(earlier, 0)]):
            pairs = match(points, place, ratio=config.ratio)
            needed = config.min_inliers if best is None else best.inliers + 1
            if len(pairs) >= needed:
                inliers = int(verify(points, place, pairs).inliers.sum())
                if inliers >= needed:
                    best = PlaceMatch(number, inliers)
        self._places.append(points)
        return best
