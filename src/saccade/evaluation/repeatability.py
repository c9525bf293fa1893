"""Repeatability and matching scores of the keypoints of two images related by a homography."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from saccade.evaluation.homography import Estimator, corner_errors, inside
from saccade.keypoints.matching import nearest_neighbors
from saccade.keypoints.two_view_fit import project
from saccade.keypoints.verification import position_sigma
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints

RADIUS = 3.0
"""Distance in pixels of the second image within which a keypoint is repeated, by default."""


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
        """Those of what a detector returned; positions of unknown scale are equally exact."""
        xy = np.asarray(found.xy, np.float64).reshape(-1, 2)
        sigma = position_sigma(found) if isinstance(found, Keypoints) else np.ones(len(xy))
        return cls(xy, np.asarray(found.descriptors), shape, sigma)


@dataclass(frozen=True)
class PairScores:
    """Scores of one image pair, or their means over several; fractions are in [0, 1]."""

    keypoints: float
    """Number of keypoints in the first image."""
    repeatability: float
    """Fraction of the locations in the common area of both images that are repeated: that have
    a location of the other image within the radius."""
    localization: float
    """Mean distance in pixels of the repeated locations to the nearest of the other image; the
    radius where there are none."""
    mma_1: float
    """Mean matching accuracy: fraction of mutual nearest neighbors correct to 1 px."""
    mma_3: float
    mma_5: float
    ratio_1: float
    """The same among those that also pass the ratio test."""
    ratio_3: float
    ratio_5: float
    score: float
    """Matching score: mutual matches correct to the radius, over the locations in the common
    area of the image that has fewer."""
    auc_1: float
    """Area under the cumulative curve of the homography's corner error, up to 1 px; the mean of
    several random draws of an estimator that draws."""
    auc_3: float
    auc_5: float
    auc_10: float


def score_pair(
    first: Features,
    second: Features,
    homography: FloatArray,
    ratio: float = 0.8,
    radius: float = RADIUS,
    estimator: Estimator = "verify",
) -> PairScores:
    """Score the keypoints of two images related by a known homography.

    Repeatability counts distinct locations, since a location may have several orientations. It is
    symmetric: the repeated locations of both images over all locations of both in the common
    area. Matches are mutual nearest neighbors among all keypoints, also those outside the common
    area. The matching score may slightly exceed 1, as a location may have more than one correct
    match. The homography is estimated from the matches that pass the ratio test.

    Args:
        first: keypoints of the first image.
        second: keypoints of the second image.
        homography: (3, 3) from the first image to the second.
        ratio: threshold of the ratio test.
        radius: distance in pixels of the second image within which a keypoint is repeated.
        estimator: of the homography.

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
    corners = corner_errors(matched, sigma, homography, first.shape, estimator)
    return PairScores(
        keypoints=float(len(first.xy)),
        repeatability=len(repeated) / max(len(distance), 1),
        localization=float(repeated.mean()) if len(repeated) else radius,
        mma_1=fraction(error <= 1),
        mma_3=fraction(error <= 3),
        mma_5=fraction(error <= 5),
        ratio_1=fraction(error[kept] <= 1),
        ratio_3=fraction(error[kept] <= 3),
        ratio_5=fraction(error[kept] <= 5),
        score=float((error <= radius).sum()) / max(min(len(common1), len(common2)), 1),
        auc_1=mean_precision(corners, 1),
        auc_3=mean_precision(corners, 3),
        auc_5=mean_precision(corners, 5),
        auc_10=mean_precision(corners, 10),
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
    """(n,) distance of each point to the nearest of the others; infinite where there are none."""
    if not len(xy) or not len(others):
        return np.full(len(xy), np.inf)
    return np.asarray(cKDTree(others).query(xy)[0], np.float64)


def mutual_matches(
    first: Features, second: Features, homography: FloatArray, ratio: float
) -> tuple[FloatArray, BoolArray, IntArray]:
    """Mutual nearest neighbors among all keypoints.

    Returns:
        (m,) reprojection error in pixels of the second image; (m,) whether each passes the
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
    """Fraction of true elements; 0 where there are none."""
    return float(mask.mean()) if len(mask) else 0.0
