"""A detector scored on many pairs of images."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from typing import TypeVar

import numpy as np

from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.repeatability import RADIUS, Features, Neighbors, PairScores, score_pair
from saccade.types import FloatArray

Name = TypeVar("Name")

SEED = 20102  # of the bootstrap: the interval of the same scores is always the same


@dataclass(frozen=True, eq=False)
class FeatureScores:
    """What each pair scored, and all of them together."""

    pair: Sequence[tuple[str, str]]
    """Sequence and name of each."""
    scores: Sequence[PairScores]
    """One for each pair."""

    def mean(self) -> PairScores:
        """Every score's mean over the pairs."""
        return PairScores(*self._table().mean(axis=0).tolist())

    def interval(self, confidence: float = 0.95) -> tuple[PairScores, PairScores]:
        """Lower and upper end of each mean, by bootstrap over the pairs."""
        low, high = mean_interval(self._table(), confidence, SEED)
        return PairScores(*low.tolist()), PairScores(*high.tolist())

    def of(self, sequence: str) -> "FeatureScores":
        """The pairs of one sequence."""
        here = [number for number, (name, _) in enumerate(self.pair) if name == sequence]
        return FeatureScores([self.pair[i] for i in here], [self.scores[i] for i in here])

    def _table(self) -> FloatArray:
        return np.array([astuple(each) for each in self.scores])  # (pairs, scores)


def score_pairs(
    features: Callable[[Name], Features],
    pairs: Sequence[tuple[Name, Name, FloatArray]],
    neighbors: Neighbors,
    ratio: float = 0.8,
    radius: float = RADIUS,
) -> Iterator[PairScores]:
    """Score a detector pair by pair.

    Args:
        features: what the detector finds in the image of a name.
        pairs: names of the first and the second image, and the (3, 3) homography between
            them; where the first is the same as before, it is not asked for again.
        neighbors: finds nearest descriptors.
        ratio: of the ratio test.
        radius: within which a point counts as found again.
    """
    last: Name | None = None
    first: Features | None = None
    for name, other, homography in pairs:
        if first is None or name != last:
            last, first = name, features(name)
        yield score_pair(first, features(other), homography, neighbors, ratio, radius)
