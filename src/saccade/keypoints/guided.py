"""Guided matching: matches among the keypoints that agree with a verified geometry."""

import numpy as np

from saccade.errors import KeypointsError, require
from saccade.keypoints.matching import (
    Excluded,
    Metric,
    check_ratio,
    comparable_descriptors,
    nearest_neighbors,
    passing,
)
from saccade.keypoints.two_view_fit import homogeneous, project
from saccade.keypoints.verification import Verification, verify
from saccade.types import BoolArray, IntArray, Keypoints, check_pairs

WIDER = 2.0
"""Tolerance of the candidates, in tolerances of the verification."""
FARTHEST_PERCENTILE = 95
"""Percentile of the distances of the verified matches beyond which no other match is taken, since
the ratio test is empty for a keypoint with one candidate."""


def match_guided(
    first: Keypoints,
    second: Keypoints,
    pairs: IntArray,
    verification: Verification,
    ratio: float | None = 0.9,
    mutual: bool = True,
    metric: Metric | None = None,
    tolerance: float = 4.0,
) -> IntArray:
    """Matches the keypoints of two images again, each among those that agree with a geometry.

    The candidates of a keypoint lie near its epipolar line, or near its position under the
    homography of a plane or of a camera that turned. The ratio test and the mutual check compare
    candidates alone, and so keep right matches of repeated structures. Verify the result again.

    Args:
        first: keypoints of the first image, with descriptors.
        second: of the second.
        pairs: (m, 2) indices of the matches that were verified.
        verification: their geometry, by `saccade.verify`.
        ratio: see `saccade.match`; looser, since there are few candidates.
        mutual: see `saccade.match`.
        metric: see `saccade.match`.
        tolerance: largest distance of a candidate in pixels, over 0; twice that of the
            verification by default, since the geometry has errors itself.

    Returns:
        (m, 2) indices into `first` and `second`, ascending in `first`. Inliers of the verification
        without another match are among them. Without a geometry, `pairs`.

    Raises:
        ConfigError: see `saccade.match`.
        KeypointsError: `pairs` are not those that were verified.

    Source: COLMAP's guided matching; Schoenberger & Frahm (2016).
    """
    check_ratio(ratio)
    require(0 < tolerance < np.inf, "tolerance", "pixels over 0", tolerance)
    check_pairs(pairs, (len(first), len(second)), "pairs")
    if len(pairs) != len(verification.inliers):
        sizes = f"{len(pairs)} and {len(verification.inliers)}"
        raise KeypointsError(f"pairs: expected those that were verified, found {sizes}")
    if verification.matrix is None or not len(pairs):
        return pairs
    a, b, power = comparable_descriptors(first, second, metric)
    excluded = excluded_by(first, second, verification, tolerance)
    neighbors = nearest_neighbors(a, b, excluded)
    nearest, distance = neighbors[:2]
    inliers = pairs[verification.inliers]
    agree = inliers[nearest[inliers[:, 0]] == inliers[:, 1]]
    kept = passing(neighbors, ratio, power, mutual)
    if len(agree):
        kept &= distance <= np.percentile(distance[agree[:, 0]], FARTHEST_PERCENTILE)
    index = np.flatnonzero(kept)
    found = np.stack([index, nearest[index]], axis=1)
    free = ~np.isin(inliers[:, 0], found[:, 0]) & ~np.isin(inliers[:, 1], found[:, 1])
    matches = np.concatenate([found, inliers[free]])
    return np.asarray(matches[np.argsort(matches[:, 0], kind="stable")])


def verified_again(
    first: Keypoints,
    second: Keypoints,
    pairs: IntArray,
    verification: Verification,
    ratio: float | None = 0.8,
    mutual: bool = True,
    metric: Metric | None = None,
    tolerance: float = 2.0,
) -> tuple[IntArray, Verification]:
    """Guided matches and their verification; what was given if it has as many inliers.

    Args:
        first: see `match_guided`.
        second: see `match_guided`.
        pairs: see `match_guided`.
        verification: by a fundamental matrix or a homography.
        ratio: of the first matches; that of the guided ones lies halfway between it and 1.
        mutual: see `saccade.match`.
        metric: see `saccade.match`.
        tolerance: of the verification, in pixels.
    """
    guided = match_guided(
        *(first, second, pairs, verification),
        ratio=None if ratio is None else (1 + ratio) / 2,
        mutual=mutual,
        metric=metric,
        tolerance=WIDER * tolerance,
    )
    again = verify(
        *(first, second, guided, verification.geometry, tolerance, verification.min_inliers),
        mirrored=verification.mirrored,
    )
    if again.inliers.sum() > verification.inliers.sum():
        return guided, again
    return pairs, verification


def excluded_by(
    first: Keypoints, second: Keypoints, verification: Verification, tolerance: float
) -> Excluded:
    """The pairs of keypoints that do not agree with a geometry."""
    H, views = verification.H, verification.views
    x1, x2 = (each.xy.astype(np.float64) for each in (first, second))
    pixel1, pixel2 = np.ones(len(x1)), np.ones(len(x2))
    if views is not None:
        x1, x2 = views[0].rays(x1), views[1].rays(x2)
        pixel1, pixel2 = views[0].pixel(x1), views[1].pixel(x2)
    if H is not None:
        if views is not None:  # `H` is in pixels without distortion
            x1, x2 = (project(view.matrix, x) for view, x in zip(views, (x1, x2), strict=True))
        moved = project(H, x1)

        def beyond(rows: slice, columns: slice) -> BoolArray:
            gap = x2[rows, None] - moved[None, columns]
            near = np.einsum("rcd,rcd->rc", gap, gap) <= tolerance**2
            return np.asarray(~near)

        return beyond
    matrix = verification.matrix
    assert matrix is not None
    first_rays, second_rays = homogeneous(x1), homogeneous(x2)
    lines2 = first_rays @ matrix.T
    variance1 = ((second_rays @ matrix[:, :2]) ** 2).sum(axis=1) * pixel2**2
    variance2 = (lines2[:, :2] ** 2).sum(axis=1) * pixel1**2

    def off_line(rows: slice, columns: slice) -> BoolArray:
        gap = second_rays[rows] @ lines2[columns].T
        # The squared Sampson distance, in pixels.
        near = gap**2 <= tolerance**2 * (variance1[rows, None] + variance2[None, columns])
        return np.asarray(~near)

    return off_line
