"""Geometric verification of matches by a fundamental matrix or a homography."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from saccade.errors import KeypointsError, require
from saccade.io.image import quiet_opencv
from saccade.keypoints.two_view_fit import (
    Geometry,
    project,
    refine,
    sampson_distances,
)
from saccade.types import BoolArray, FloatArray, IntArray, Keypoints, check_pairs

SAMPLE_SIZE = {"fundamental": 7, "homography": 4}
"""Correspondences that determine each geometry."""
CONFIDENCE = 0.9999
MAX_ITERATIONS = 10_000
REFINED_TOLERANCES = 2.0
"""Tolerances within which matches take part in the refinement: the Cauchy loss discounts those
that are wrong, while inliers that the first estimate misses are to be recovered."""
MIN_SIGMA = 0.02
"""Smallest error of a position, in pixels."""
SCALE_ERROR = 0.064
"""Error of a position in each axis, in scales of its keypoint."""
NOISE_ERROR = 0.0028
"""The same in pixels, times |D|: what the noise of the image contributes."""


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
    covariance: FloatArray | None = None
    """(9, 9) of the entries of `matrix`, row by row, at its norm; None where the matches do not
    determine it, and in stored runs."""

    def projection_covariance(self, xy: FloatArray) -> FloatArray:
        """(n, 2, 2) covariance in the second image of (n, 2) points that the homography projects.

        Raises:
            KeypointsError: there is no homography, or none with a covariance.
        """
        if self.geometry != "homography" or self.matrix is None or self.covariance is None:
            raise KeypointsError("projection_covariance: expected a homography with covariance")
        homogeneous = np.c_[xy, np.ones(len(xy))]  # (n, 3)
        gap = np.eye(3)[:2] - project(self.matrix, xy)[:, :, None] * np.eye(3)[2]  # (n, 2, 3)
        J = np.einsum("nij,nk->nijk", gap, homogeneous).reshape(len(xy), 2, 9)
        J /= (homogeneous @ self.matrix[2])[:, None, None]
        covariance: FloatArray = J @ self.covariance @ J.transpose(0, 2, 1)
        return covariance

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
    """Estimate the geometry of two views from matches, with its covariance and inliers.

    MAGSAC's estimate is refined by robust least squares, in which each match weighs as much as
    the positions of its keypoints are exact (see `position_sigma`).

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
    sigma = np.stack([position_sigma(first)[pairs[:, 0]], position_sigma(second)[pairs[:, 1]]], 1)
    return verify_positions(matched, sigma, geometry, tolerance, min_inliers)


def verify_positions(
    matched: FloatArray,
    sigma: FloatArray,
    geometry: Geometry,
    tolerance: float,
    min_inliers: int,
) -> Verification:
    """`verify` of (m, 4) rows x1, y1, x2, y2 and (m, 2) standard deviations of both positions."""
    unique, row = np.unique(matched, axis=0, return_inverse=True)
    smallest = np.full((len(unique), 2), np.inf)
    np.minimum.at(smallest, row.ravel(), sigma)
    found = estimate(unique, smallest, geometry, tolerance, min_inliers)
    return replace(found, inliers=found.inliers[row.ravel()])


def position_sigma(keypoints: Keypoints) -> FloatArray:
    """(n,) standard deviation of the positions of keypoints, in pixels along each axis.

    Part of it grows with the scale, which is that of the structure that is localized. The other is
    due to the noise of the image, against which the response holds. It was fitted to the errors
    of SIFT's positions on known pairs; responses in other units are taken for strong. Where a
    response is 0, as of points from elsewhere, it is unknown, and only the scale counts.
    """
    scale, response = keypoints.size.astype(np.float64) / 2, keypoints.response.astype(np.float64)
    noise = np.divide(NOISE_ERROR, response, out=np.zeros(len(scale)), where=response > 0)
    sigma: FloatArray = np.maximum(np.hypot(SCALE_ERROR * scale, noise), MIN_SIGMA)
    return sigma


def estimate(
    matched: FloatArray,
    sigma: FloatArray,
    geometry: Geometry,
    tolerance: float,
    min_inliers: int,
) -> Verification:
    """The geometry of distinct matches.

    Args:
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) standard deviations of both positions along each axis.
        geometry: "fundamental" or "homography".
        tolerance: inlier threshold in pixels.
        min_inliers: inliers of a geometry that is accepted.
    """
    none = Verification(geometry, None, np.zeros(len(matched), np.bool_))
    matrix, inliers = sample_consensus(matched, geometry, tolerance)
    if matrix is None or inliers.sum() < min_inliers:
        return none
    near = match_errors(matrix, geometry, matched) < REFINED_TOLERANCES * tolerance
    if near.sum() <= SAMPLE_SIZE[geometry]:
        return Verification(geometry, matrix, inliers)
    fit = refine(matrix, geometry, matched[near], sigma[near])
    if fit is None:
        return Verification(geometry, matrix, inliers)
    inliers = match_errors(fit.matrix, geometry, matched) < tolerance
    if inliers.sum() < min_inliers:
        return none
    return Verification(geometry, fit.matrix, inliers, fit.covariance)


def match_errors(matrix: FloatArray, geometry: Geometry, matched: FloatArray) -> FloatArray:
    """(m,) errors of matches: in the second image of a homography, else from epipolar lines."""
    if geometry == "homography":
        gap = project(matrix, matched[:, :2]) - matched[:, 2:]
        errors: FloatArray = np.nan_to_num(np.hypot(*gap.T), nan=np.inf)
        return errors
    distances: FloatArray = np.abs(sampson_distances(matrix, matched))
    return distances


def sample_consensus(
    matched: FloatArray, geometry: Geometry, tolerance: float
) -> tuple[FloatArray | None, BoolArray]:
    """MAGSAC's (3, 3) matrix of (m, 4) rows x1, y1, x2, y2, and (m,) which are inliers."""
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
