"""Geometric verification of matches by a fundamental matrix or a homography."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np

from saccade.errors import KeypointsError, require
from saccade.io.image import quiet_opencv
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

Geometry: TypeAlias = Literal["fundamental", "homography"]

SAMPLE_SIZE = {"fundamental": 7, "homography": 4}
"""Correspondences that determine each geometry."""
CONFIDENCE = 0.9999
MAX_ITERATIONS = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """The geometry of two views, and the matches that are consistent with it."""

    geometry: Geometry
    """Kind of `matrix`."""
    matrix: FloatArray | None
    """(3, 3). A homography maps homogeneous (x, y, 1) of the first image to the second; a
    fundamental matrix F holds x2' F x1 = 0. None where there are too few inliers."""
    inliers: BoolArray
    """(m,) which matches are consistent with it; all false where it is None."""

    def __repr__(self) -> str:
        return (
            f"Verification({self.geometry}: "
            f"{self.inliers.sum()} of {len(self.inliers)} matches agree)"
        )


def verify(
    first: Keypoints,
    second: Keypoints,
    pairs: IntArray,
    geometry: Geometry = "fundamental",
    tolerance: float = 2.0,
    min_inliers: int = 15,
) -> Verification:
    """Estimate the geometry of two views from matches, and its inliers.

    A fundamental matrix holds for any rigid scene, but only constrains a keypoint to a line. A
    homography constrains it to a point; it holds for a plane, or for a camera that only rotates.

    Args:
        first: keypoints of the first image.
        second: of the second.
        pairs: (m, 2) indices into both, as `match` returns them.
        geometry: "fundamental" or "homography".
        tolerance: inlier threshold in pixels, over 0.
        min_inliers: distinct correspondences that must be inliers, since those of a minimal sample
            always are. COLMAP asks for as many.

    Returns:
        The same for the same matches in any order. Keypoints that share a position and differ in
        their angle count once.

    Raises:
        ConfigError: another geometry, or a tolerance that is not over 0.
        KeypointsError: pairs that are not indices, or positions that are not finite.

    Source: OpenCV's USAC with the score of MAGSAC++; Barath et al. (2020).
    """
    require(geometry in SAMPLE_SIZE, "geometry", "fundamental or homography", geometry)
    require(0 < tolerance < np.inf, "tolerance", "pixels over 0", tolerance)
    check_pairs(pairs, (len(first), len(second)), "pairs")
    matched = np.hstack([first.xy[pairs[:, 0]], second.xy[pairs[:, 1]]]).astype(np.float64)
    if not np.isfinite(matched).all():
        raise KeypointsError("keypoints: expected finite positions, found NaN or infinity")
    unique, row = np.unique(matched, axis=0, return_inverse=True)
    matrix, inliers = estimate(unique, geometry, tolerance)
    if matrix is None or inliers.sum() < min_inliers:
        return Verification(geometry, None, np.zeros(len(pairs), np.bool_))
    return Verification(geometry, matrix, inliers[row.ravel()])


def estimate(
    matched: FloatArray, geometry: Geometry, tolerance: float
) -> tuple[FloatArray | None, BoolArray]:
    """The (3, 3) matrix of (m, 4) rows x1, y1, x2, y2, and (m,) which rows are inliers."""
    none = np.zeros(len(matched), np.bool_)
    if len(matched) < SAMPLE_SIZE[geometry]:
        return None, none
    first, second = np.ascontiguousarray(matched[:, :2]), np.ascontiguousarray(matched[:, 2:])
    estimator: Any = cv2.findHomography if geometry == "homography" else cv2.findFundamentalMat
    settings: dict[str, Any] = {"confidence": CONFIDENCE, "maxIters": MAX_ITERATIONS}
    try:
        with quiet_opencv():
            matrix, mask = estimator(
                first, second, method=cv2.USAC_MAGSAC, ransacReprojThreshold=tolerance, **settings
            )
    except cv2.error:  # an assertion fails in some versions where no sample gives a model
        return None, none
    if np.shape(matrix) != (3, 3):  # None where every sample is degenerate
        return None, none
    return np.asarray(matrix, np.float64), np.asarray(mask).ravel() != 0
