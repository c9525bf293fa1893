"""Places that were seen before, told by what the whole frame shows."""

from dataclasses import dataclass
from typing import NamedTuple

from saccade.errors import require
from saccade.keypoints.matching import match
from saccade.keypoints.verification import verify
from saccade.types import Keypoints


class PlaceMatch(NamedTuple):
    """A place that was seen before."""

    place: int
    """Its number, in the order in which places were seen."""
    inliers: int
    """Matches that agree on one geometry of the two views."""


@dataclass(frozen=True)
class LoopDetectionConfig:
    """When a frame shows a place that was seen before."""

    ratio: float = 0.8
    """A match is made if its distance is under this share of the distance to the next."""
    min_inliers: int = 22
    """Matches that must agree on one epipolar geometry. Pairs of different places of a hallway
    have up to 18 by chance, of 500 points each."""
    min_gap: int = 15
    """Places this near in time are not looked at: of course they look alike."""

    def __post_init__(self) -> None:
        require(0 < self.ratio <= 1, "ratio", "over 0, at most 1", self.ratio)
        require(self.min_inliers >= 8, "min_inliers", "at least 8", self.min_inliers)
        require(self.min_gap >= 1, "min_gap", "at least 1", self.min_gap)


class LoopDetector:
    """A memory of places.

    Args:
        config: when one is recognized.
    """

    def __init__(self, config: LoopDetectionConfig | None = None) -> None:
        self._config = config or LoopDetectionConfig()
        self._seen: list[Keypoints] = []

    def __len__(self) -> int:
        return len(self._seen)

    def detect(self, points: Keypoints) -> PlaceMatch | None:
        """Look at a place, and remember it.

        Args:
            points: what a frame shows, with descriptors.

        Returns:
            The earlier place with the most matches that agree; None where none has enough.
        """
        best = PlaceMatch(-1, 0)
        for number in range(len(self) + 1 - self._config.min_gap):
            pairs = match(points, self._seen[number], ratio=self._config.ratio)
            if len(pairs) > best.inliers:
                found = int(verify(points, self._seen[number], pairs).inliers.sum())
                best = max(best, PlaceMatch(number, found), key=lambda each: each.inliers)
        self._seen.append(points)
        return best if best.inliers >= self._config.min_inliers else None
