"""Interest points of two images of one plane: found again, and matched rightly?"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from saccade.evaluation.homography import BoolArray, corner_error, inside, project
from saccade.types import Float32Array, FloatArray, IntArray

RADIUS = 3.0
"""Pixels of the second image within which a point counts as found again, if not said otherwise."""

Neighbors: TypeAlias = Callable[
    [npt.NDArray[Any], npt.NDArray[Any]], tuple[IntArray, Float32Array, Float32Array, IntArray]
]
"""Of (n, d) and (k, d) descriptors: (n,) nearest row, (n,) its squared distance, (n,) that of
the second nearest, and (k,) the nearest row of the first."""


@dataclass(frozen=True, eq=False)
class Features:
    """What a detector finds in one image."""

    xy: FloatArray
    """(n, 2) pixels."""
    descriptors: npt.NDArray[Any]
    """(n, d)."""
    shape: tuple[int, int]
    """(H, W) of the image."""

    def strongest(self, places: int | None) -> "Features":
        """The points of the first so many different places; all of them where that is None."""
        if places is None:
            return self
        _, first, place = np.unique(self.xy, axis=0, return_index=True, return_inverse=True)
        kept = np.argsort(np.argsort(first))[place.ravel()] < places
        return Features(self.xy[kept], self.descriptors[kept], self.shape)


@dataclass(frozen=True)
class PairScores:
    """How a detector did on one pair, or on the mean of several; shares are in [0, 1]."""

    keypoints: float
    """In the first image."""
    repeatability: float
    """Places in the common area with one of the other image within the radius, of all there."""
    localization: float
    """Mean distance of those to the nearest, in pixels; the radius where there are none."""
    mma_1: float
    """Share of right matches at 1 px (mean matching accuracy) among mutual nearest neighbors."""
    mma_3: float
    mma_5: float
    ratio_1: float
    """The same of those that also pass the ratio test."""
    ratio_3: float
    ratio_5: float
    score: float
    """Right mutual matches at that radius, of the places in the common area: of the image with
    fewer."""
    auc_1: float
    """Area under the curve of the share of pairs over their corner error, up to 1 px."""
    auc_3: float
    auc_5: float
    auc_10: float


def score_pair(
    first: Features,
    second: Features,
    homography: FloatArray,
    neighbors: Neighbors,
    ratio: float = 0.8,
    radius: float = RADIUS,
) -> PairScores:
    """Score the points of two images whose true relation is known.

    Repeatability counts *places*: a point with several orientations counts once. It is
    symmetric: places of both images that have one of the other within the radius (in the second
    image), divided by all places of both that the other image shows. Matches are mutual
    nearest neighbors among all points, whether the other image shows their place or not;
    the ratio test comes on top. The score may pass 1 by a little, since a place may have
    more than one right match. The homography comes from the matches that pass the ratio test.

    Args:
        first: points of the first image.
        second: of the second.
        homography: (3, 3) from the first image to the second.
        neighbors: finds nearest descriptors.
        ratio: of the ratio test.
        radius: pixels of the second image within which a point counts as found again.

    Source: Mikolajczyk & Schmid (2005) and DeTone et al. (2018), section 4 and appendix.
    """
    here, there = common_places(first, second, homography)
    distance = np.concatenate([nearest_distance(here, there), nearest_distance(there, here)])
    repeated = distance[distance <= radius]

    error, kept, pairs = mutual_matches(first, second, homography, neighbors, ratio)
    matched = pairs[kept]
    corners = corner_error(
        first.xy[matched[:, 0]], second.xy[matched[:, 1]], homography, first.shape
    )
    return PairScores(
        keypoints=float(len(first.xy)),
        repeatability=len(repeated) / max(len(distance), 1),
        localization=float(repeated.mean()) if len(repeated) else radius,
        mma_1=share(error <= 1),
        mma_3=share(error <= 3),
        mma_5=share(error <= 5),
        ratio_1=share(error[kept] <= 1),
        ratio_3=share(error[kept] <= 3),
        ratio_5=share(error[kept] <= 5),
        score=float((error <= radius).sum()) / max(min(len(here), len(there)), 1),
        auc_1=max(0.0, 1 - corners / 1),
        auc_3=max(0.0, 1 - corners / 3),
        auc_5=max(0.0, 1 - corners / 5),
        auc_10=max(0.0, 1 - corners / 10),
    )


def common_places(
    first: Features, second: Features, homography: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The different places of each image that the other shows, in pixels of the second."""
    here, there = np.unique(first.xy, axis=0), np.unique(second.xy, axis=0)
    inverse = np.linalg.inv(homography).astype(np.float64)
    projected, back = project(homography, here), project(inverse, there)
    return projected[inside(projected, second.shape)], there[inside(back, first.shape)]


def nearest_distance(xy: FloatArray, others: FloatArray) -> FloatArray:
    """(n,) from each point to the nearest of the others; infinite where there are none."""
    if not len(xy) or not len(others):
        return np.full(len(xy), np.inf)
    return np.asarray(cKDTree(others).query(xy)[0], np.float64)


def mutual_matches(
    first: Features, second: Features, homography: FloatArray, neighbors: Neighbors, ratio: float
) -> tuple[FloatArray, BoolArray, IntArray]:
    """Mutual nearest neighbors among all points.

    Returns:
        (m,) distance from where each belongs in pixels of the second image; (m,) whether
        it passes the ratio test; (m, 2) indices of the points.
    """
    if not len(first.xy) or not len(second.xy):
        return np.zeros(0), np.zeros(0, np.bool_), np.zeros((0, 2), np.int64)
    nearest, distance, runner_up, back = neighbors(first.descriptors, second.descriptors)
    index = np.flatnonzero(back[nearest] == np.arange(len(nearest)))
    pairs = np.stack([index, nearest[index]], axis=1)
    gap = project(homography, first.xy[pairs[:, 0]]) - second.xy[pairs[:, 1]]
    return np.hypot(*gap.T), (distance < ratio**2 * runner_up)[index], pairs


def share(right: BoolArray) -> float:
    """How many of some are true; 0 of none."""
    return float(right.mean()) if len(right) else 0.0
