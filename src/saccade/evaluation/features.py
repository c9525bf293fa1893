"""Repeatability, matching and homography accuracy of detectors on image pairs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.datasets.homography_pairs import HomographyPair
from saccade.errors import ConfigError, require
from saccade.evaluation.detectors import EvaluatedDetector
from saccade.evaluation.intervals import ScoreSet
from saccade.io.image import read_image
from saccade.keypoints.matching import nearest_neighbors
from saccade.keypoints.two_view_fit import project
from saccade.keypoints.verification import position_sigma, verify_positions
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray, Keypoints

KINDS = {"noise": (0.0, 255.0), "contrast": (0.0, 1.0), "blur": (0.0, 100.0)}
"""Kinds of degradation, with the exclusive lower and inclusive upper limit of the amount."""
MIDDLE_GRAY = 0.5
"""Gray level that contrast scaling leaves unchanged."""
MAX_GRAY_LEVEL = 255


@dataclass(frozen=True)
class Degradation:
    """One kind of image degradation and its amount."""

    kind: str
    """"noise": additive Gaussian, equal in all channels; "contrast": scaling about middle gray;
    "blur": Gaussian."""
    amount: float
    """Standard deviation of the noise in gray levels of 255; factor of the contrast; standard
    deviation of the blur in pixels."""

    def __post_init__(self) -> None:
        require(self.kind in KINDS, "degradation", f"one of {', '.join(KINDS)}", self.kind)
        low, high = KINDS[self.kind]
        name = f"degradation: {self.kind}"
        require(low < self.amount <= high, name, f"above {low:g}, at most {high:g}", self.amount)

    @classmethod
    def parse(cls, text: str) -> "Degradation":
        """Parses KIND:AMOUNT, such as `noise:20`.

        Raises:
            ConfigError: the text has another form, or the amount is out of range.
        """
        kind, _, amount = text.partition(":")
        try:
            return cls(kind, float(amount))
        except ValueError as error:
            if isinstance(error, ConfigError):
                raise
            expected = "such as noise:20, contrast:0.5 or blur:2"
            raise ConfigError(f"degradation: expected {expected}, found {text!r}") from error

    def __str__(self) -> str:
        return f"{self.kind}:{self.amount:g}"

    def apply(self, image: Float32Array, seed: int) -> Float32Array:
        """Degrades an image and quantizes it to 8 bits.

        Args:
            image: (H, W) or (H, W, 3) in [0, 1].
            seed: seed of the noise.
        """
        changed = image
        if self.kind == "noise":
            shape = (*image.shape[:2], *(1 for _ in image.shape[2:]))
            noise = np.random.default_rng(seed).standard_normal(shape, np.float32)
            changed = image + noise * np.float32(self.amount / MAX_GRAY_LEVEL)
        elif self.kind == "contrast":
            changed = MIDDLE_GRAY + (image - MIDDLE_GRAY) * np.float32(self.amount)
        else:
            changed = np.asarray(cv2.GaussianBlur(image, (0, 0), self.amount), np.float32)
        return np.asarray(np.rint(changed.clip(0, 1) * MAX_GRAY_LEVEL) / MAX_GRAY_LEVEL, np.float32)


INLIER_PX = 2.0
"""Inlier threshold in pixels, the default of `saccade.verify`."""


def inside(xy: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """(n,) True for points between the centers of the outermost pixels of an (H, W) image."""
    height, width = shape
    x, y = xy.T
    within: BoolArray = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return within


def corner_error(
    estimate: FloatArray | None, homography: FloatArray, shape: tuple[int, int]
) -> float:
    """Mean distance in pixels between the corners of an (H, W) image under two homographies."""
    if estimate is None:
        return float("inf")
    height, width = shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    gap = project(estimate, corners) - project(homography, corners)
    error = float(np.hypot(*gap.T).mean())
    return error if np.isfinite(error) else float("inf")


REPEAT_RADIUS = 3.0
"""Default maximum distance of a repeated keypoint, in pixels of the second image."""


@dataclass(frozen=True, eq=False)
class Features:
    """Keypoints and descriptors of one image."""

    xy: FloatArray
    """(n, 2) pixels."""
    descriptors: npt.NDArray[Any]
    """(n, d)."""
    shape: tuple[int, int]
    """(H, W) of the image."""
    position_sigma: FloatArray
    """(n,) standard deviation of the positions in pixels."""

    @classmethod
    def of(cls, found: Any, shape: tuple[int, int]) -> "Features":
        """Features from a detector's result; keypoints of unknown scale get equal uncertainty."""
        xy = np.asarray(found.xy, np.float64).reshape(-1, 2)
        sigma = position_sigma(found) if isinstance(found, Keypoints) else np.ones(len(xy))
        return cls(xy, np.asarray(found.descriptors), shape, sigma)


@dataclass(frozen=True)
class PairScores:
    """Scores of an image pair, or means over several pairs; fractions are in [0, 1]."""

    keypoints: float
    """Number of keypoints in the first image."""
    repeatability: float
    """Fraction of locations in the common area with a location of the second image within the
    radius."""
    localization: float
    """Mean distance in pixels from repeated locations to the nearest location in the second image;
    the radius if no location is repeated."""
    mma_1: float
    """Mean matching accuracy: fraction of mutual nearest neighbors correct within 1 px."""
    mma_3: float
    mma_5: float
    ratio_1: float
    """Mean matching accuracy within 1 px of the matches that pass the ratio test."""
    ratio_3: float
    ratio_5: float
    score: float
    """Matching score: mutual matches correct within the radius, over the smaller number of
    locations in the common area."""
    auc_1: float
    """Area under the cumulative curve of the homography corner error, up to 1 px."""
    auc_3: float
    auc_5: float
    auc_10: float


def score_pair(
    first: Features,
    second: Features,
    homography: FloatArray,
    ratio: float = 0.8,
    radius: float = REPEAT_RADIUS,
) -> PairScores:
    """Score the keypoints of two images related by a known homography.

    Repeatability counts distinct locations, since a location may have several orientations. It is
    symmetric: repeated locations of both images over all locations in the common area. Matches are
    mutual nearest neighbors among all keypoints, including keypoints outside the common area. The
    matching score may slightly exceed 1, since a location may have several correct matches. The
    homography is estimated from the matches that pass the ratio test, by `verify`.

    Args:
        first: keypoints of the first image.
        second: keypoints of the second image.
        homography: (3, 3) from the first image to the second.
        ratio: threshold of the ratio test.
        radius: maximum distance of a repeated keypoint, in pixels of the second image.

        Source: Mikolajczyk & Schmid (2005) and DeTone et al. (2018), section 4 and appendix.
    """
    common1, common2 = common_locations(first, second, homography)
    distance = np.concatenate(
        [nearest_distance(common1, common2), nearest_distance(common2, common1)]
    )
    repeated = distance[distance <= radius]
    error, kept, pairs = mutual_matches(first, second, homography, ratio)
    i, j = pairs[kept].T
    matched = np.hstack([first.xy[i], second.xy[j]])
    sigma = np.stack([first.position_sigma[i], second.position_sigma[j]], axis=1)
    found = verify_positions(matched, sigma, "homography", INLIER_PX, min_inliers=4)
    corners = np.array([corner_error(found.H, homography, first.shape)])
    limits = (1, 3, 5)
    by_limit = {f"mma_{limit}": fraction(error <= limit) for limit in limits}
    by_limit |= {f"ratio_{limit}": fraction(error[kept] <= limit) for limit in limits}
    by_limit |= {f"auc_{limit}": mean_precision(corners, limit) for limit in (*limits, 10)}
    return PairScores(
        keypoints=float(len(first.xy)),
        repeatability=len(repeated) / max(len(distance), 1),
        localization=float(repeated.mean()) if len(repeated) else radius,
        score=float((error <= radius).sum()) / max(min(len(common1), len(common2)), 1),
        **by_limit,
    )


def common_locations(
    first: Features, second: Features, homography: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distinct locations of each image in the common area, in pixels of the second image."""
    xy1, xy2 = np.unique(first.xy, axis=0), np.unique(second.xy, axis=0)
    inverse = np.linalg.inv(homography).astype(np.float64)
    projected, back = project(homography, xy1), project(inverse, xy2)
    return projected[inside(projected, second.shape)], xy2[inside(back, first.shape)]


def nearest_distance(xy: FloatArray, others: FloatArray) -> FloatArray:
    """(n,) distance of each point to the nearest other point; infinite without other points."""
    if not len(xy) or not len(others):
        return np.full(len(xy), np.inf)
    from scipy.spatial import cKDTree  # slow to import

    return np.asarray(cKDTree(others).query(xy)[0], np.float64)


def mutual_matches(
    first: Features, second: Features, homography: FloatArray, ratio: float
) -> tuple[FloatArray, BoolArray, IntArray]:
    """Mutual nearest neighbors among all keypoints.

    Returns:
        (m,) reprojection error in pixels of the second image; (m,) True for matches that pass the
        ratio test; (m, 2) indices of the keypoints.
    """
    if not len(first.xy) or not len(second.xy):
        return np.zeros(0), np.zeros(0, np.bool_), np.zeros((0, 2), np.int64)
    nearest, distance, runner_up, back = nearest_neighbors(first.descriptors, second.descriptors)
    index = np.flatnonzero(back[nearest] == np.arange(len(nearest)))
    pairs = np.stack([index, nearest[index]], axis=1)
    gap = project(homography, first.xy[pairs[:, 0]]) - second.xy[pairs[:, 1]]
    return np.hypot(*gap.T), (distance < ratio**2 * runner_up)[index], pairs


def mean_precision(errors: FloatArray, limit: float) -> float:
    """Area under the cumulative curve of errors up to a limit, over the limit."""
    return float(np.maximum(0, 1 - errors / limit).mean())


def fraction(mask: BoolArray) -> float:
    """Fraction of true elements; 0 for an empty mask."""
    return float(mask.mean()) if len(mask) else 0.0


class FeatureScores(ScoreSet[tuple[str, str], PairScores]):
    """Scores of image pairs, named by sequence and second image."""

    seed = 20102

    def of(self, sequence: str) -> "FeatureScores":
        """The pairs of one sequence."""
        chosen = [i for i, (name, _) in enumerate(self.name) if name == sequence]
        return FeatureScores([self.name[i] for i in chosen], [self.scores[i] for i in chosen])


def score_detector(
    detect: EvaluatedDetector,
    pairs: Sequence[HomographyPair],
    degradation: Degradation | None = None,
    ratio: float = 0.8,
    radius: float = REPEAT_RADIUS,
    progress: Callable[[int, int], object] | None = None,
) -> FeatureScores:
    """Score a detector on image pairs.

    Args:
        detect: the detector.
        pairs: the image pairs; an image shared by successive pairs is processed once.
        degradation: applied to the second image of each pair, seeded by its number.
        ratio: threshold of the ratio test.
        radius: distance in pixels within which a keypoint is repeated.
        progress: function of the number of pairs done and the total.
    """

    def features(image: Float32Array) -> Features:
        return Features.of(detect(image), image.shape[:2])

    scores = []
    path: Path | None = None
    for number, pair in enumerate(pairs):
        if pair.first != path:
            path, first = pair.first, features(read_image(pair.first))
        image = read_image(pair.second)
        second = features(image if degradation is None else degradation.apply(image, number))
        scores.append(score_pair(first, second, pair.homography, ratio, radius))
        if progress is not None:
            progress(number + 1, len(pairs))
    return FeatureScores([(pair.sequence, pair.second.stem) for pair in pairs], scores)
