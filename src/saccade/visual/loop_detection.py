"""Loop detection: recognizes places by matching the keypoints of whole frames."""

from dataclasses import dataclass
from typing import NamedTuple

from saccade.errors import require_ranges
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
class LoopDetectionConfig:
    """Thresholds of loop detection."""

    ratio: float = 0.8
    """Ratio test: distance to the nearest descriptor over that to the second."""
    min_inliers: int = 22
    """Matches that must agree with one epipolar geometry. Different places of a hallway have up to
    18 by chance, of 500 points each."""
    min_gap: int = 15
    """Least number of frames between two views of a place."""

    def __post_init__(self) -> None:
        require_ranges(self, ratio=(1e-9, 1), min_inliers=(8, 1e6), min_gap=(1, 1e6))


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
