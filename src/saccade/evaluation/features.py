"""Repeatability and matching of a detector over many image pairs."""

from collections.abc import Callable, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saccade.datasets.homography_pairs import HomographyPair
from saccade.evaluation.degradation import Degradation
from saccade.evaluation.detectors import Detector
from saccade.evaluation.homography import Estimator
from saccade.evaluation.intervals import ScoreSet, mean_interval
from saccade.evaluation.repeatability import RADIUS, Features, PairScores, score_pair
from saccade.io.image import read_image
from saccade.types import Float32Array


class FeatureScores(ScoreSet[tuple[str, str], PairScores]):
    """Scores of image pairs, named by sequence and second image."""

    seed = 20102

    def of(self, sequence: str) -> "FeatureScores":
        """The pairs of one sequence."""
        chosen = [i for i, (name, _) in enumerate(self.name) if name == sequence]
        return FeatureScores([self.name[i] for i in chosen], [self.scores[i] for i in chosen])


class FeatureDifference(NamedTuple):
    """Mean of the paired differences of two detectors over the pairs, with its interval."""

    mean: PairScores
    low: PairScores
    high: PairScores


def feature_difference(
    first: FeatureScores, second: FeatureScores, confidence: float = 0.95
) -> FeatureDifference:
    """Bootstrap interval of `second` minus `first`, scored on the same pairs."""
    rows = zip(first.scores, second.scores, strict=True)
    table = np.array([np.subtract(astuple(b), astuple(a)) for a, b in rows])  # (pairs, scores)
    means = table.mean(axis=0), *mean_interval(table, confidence, FeatureScores.seed)
    return FeatureDifference(*(PairScores(*values.tolist()) for values in means))


def score_detector(
    detect: Detector,
    pairs: Sequence[HomographyPair],
    degradation: Degradation | None = None,
    ratio: float = 0.8,
    radius: float = RADIUS,
    progress: Callable[[int, int], object] | None = None,
    estimators: Sequence[Estimator] = ("verify",),
) -> list[FeatureScores]:
    """Score a detector on image pairs.

    Args:
        detect: the detector.
        pairs: the image pairs; an image shared by successive pairs is detected in once.
        degradation: applied to the second image of each pair, seeded by its number.
        ratio: threshold of the ratio test.
        radius: distance in pixels within which a keypoint is repeated.
        progress: called with the pairs done and their number.
        estimators: of the homography.

    Returns:
        The scores by each of `estimators`.
    """

    def features(image: Float32Array) -> Features:
        return Features.of(detect(image), image.shape[:2])

    scores: list[list[PairScores]] = [[] for _ in estimators]
    path: Path | None = None
    for number, pair in enumerate(pairs):
        if pair.first != path:
            path, first = pair.first, features(read_image(pair.first))
        image = read_image(pair.second)
        second = features(image if degradation is None else degradation.apply(image, number))
        for table, estimator in zip(scores, estimators, strict=True):
            table.append(score_pair(first, second, pair.homography, ratio, radius, estimator))
        if progress is not None:
            progress(number + 1, len(pairs))
    names = [(pair.sequence, pair.second.stem) for pair in pairs]
    return [FeatureScores(names, table) for table in scores]
