"""Robust estimation of a two-view geometry from matches."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from saccade.io.image import quiet_opencv
from saccade.keypoints.relative_pose import beyond_infinity, is_plausibly_near, pose_of
from saccade.keypoints.two_view_fit import (
    MIN_LOSS_DECREASE,
    Fit,
    Geometry,
    Minimum,
    minimize,
    project,
    residuals_of,
    sampson_distances,
)
from saccade.keypoints.two_view_models import Matches
from saccade.types import BoolArray, FloatArray

SAMPLE_SIZE = {"fundamental": 7, "homography": 4, "essential": 5}
"""Correspondences that determine each geometry."""
CONFIDENCE = {"fundamental": 0.9999, "homography": 0.9999, "essential": 0.999}
"""Probability that one of the samples has no wrong match, by geometry."""
MAX_RANSAC_ITERATIONS = 10_000
REFINED_TOLERANCES = 2.0
"""Largest error of a match in the refinement, in tolerances: the Cauchy loss discounts wrong
matches, and inliers missed by the first estimate are recovered."""
REFINEMENTS = {"fundamental": 2, "homography": 1, "essential": 2}
"""Number of rounds of refinement. The second excludes matches beyond `REFINED_SIGMAS`, since wrong
matches near an epipolar line bias the estimate; a homography has few of these, and gets worse."""
ROUGH_DECREASE = 1e-4
"""Relative decrease of the loss that ends a round of refinement before the last one."""
REFINED_SIGMAS = 3.5
"""Largest residual of a match in the second round, in robust standard deviations."""


@dataclass(frozen=True)
class Estimator:
    """Estimation of a geometry from matches."""

    geometry: Geometry
    tolerance: float
    """In pixels."""

    def estimate(self, matches: Matches) -> tuple[FloatArray, Fit | None] | None:
        """The (3, 3) matrix, and its refinement if there is one; None without a matrix."""
        pixel = float(np.sqrt(np.median(matches.pixel, axis=0).prod())) if len(matches.pixel) else 1
        tolerance = self.tolerance * pixel
        matrix = sample_consensus(matches.positions, self.geometry, tolerance)
        if matrix is None:
            return None
        fit = self.refine_repeatedly(matrix, matches)
        return (matrix, None) if fit is None else (fit.matrix, fit)

    def refine_repeatedly(self, matrix: FloatArray, matches: Matches) -> Fit | None:
        """The model refined by the matches near it, and again by those near the refined one."""
        wide = replace(self, tolerance=REFINED_TOLERANCES * self.tolerance)
        near = wide.inliers(matrix, matches)
        minima: list[Minimum] = []
        rounds = REFINEMENTS[self.geometry]
        for number in range(rounds):
            if near.sum() <= SAMPLE_SIZE[self.geometry]:
                break
            chosen = matches.take(near)
            is_last = number == rounds - 1 and self.geometry != "essential"
            decrease = MIN_LOSS_DECREASE if is_last else ROUGH_DECREASE
            better = minimize(matrix, self.geometry, chosen.positions, chosen.sigma, decrease)
            if better is None:
                break
            minima.append(better)
            matrix = better.matrix
            if is_last:
                break
            near = wide.inliers(matrix, matches)
            residuals = residuals_of(self.geometry, matrix, matches.positions, matches.sigma)
            near &= np.linalg.norm(residuals(matrix)[0], axis=1) <= REFINED_SIGMAS * better.scale
        if self.geometry == "essential" and minima:
            chosen = matches.take(near)
            chosen = chosen.take(is_plausibly_near(pose_of(matrix, chosen.positions), chosen))
            if len(chosen.positions) > SAMPLE_SIZE[self.geometry]:
                better = minimize(matrix, self.geometry, chosen.positions, chosen.sigma)
                minima += [] if better is None else [better]
        fits = (each.with_covariance() for each in reversed(minima))
        return next((fit for fit in fits if fit is not None), None)

    def inliers(self, matrix: FloatArray, matches: Matches) -> BoolArray:
        """(m,) which matches are consistent with a matrix.

        The error is that in the second image of a homography, else that from epipolar lines; of
        calibrated cameras from the half of the line in front of both.
        """
        positions = matches.positions
        if self.geometry == "homography":
            gap = project(matrix, positions[:, :2]) - positions[:, 2:]
            errors = np.nan_to_num(np.hypot(*gap.T), nan=np.inf) / matches.pixel[:, 1]
        else:
            errors = np.abs(sampson_distances(matrix, positions, matches.pixel))
        if self.geometry == "essential":
            pose = pose_of(matrix, positions[errors < self.tolerance])
            beyond = beyond_infinity(pose.rotation, pose.translation, positions)
            errors = np.hypot(errors, beyond / (np.hypot(*matches.pixel.T) / np.sqrt(2)))
        return np.asarray(errors < self.tolerance)


def sample_consensus(
    matched: FloatArray, geometry: Geometry, tolerance: float
) -> FloatArray | None:
    """The (3, 3) matrix of most of (m, 4) rows x1, y1, x2, y2; None without one."""
    if len(matched) < SAMPLE_SIZE[geometry]:
        return None
    first, second = np.ascontiguousarray(matched[:, :2]), np.ascontiguousarray(matched[:, 2:])
    confidence = CONFIDENCE[geometry]
    try:
        with quiet_opencv():
            if geometry == "homography":
                found = cv2.findHomography(
                    *(first, second, cv2.USAC_MAGSAC, tolerance),
                    confidence=confidence,
                    maxIters=MAX_RANSAC_ITERATIONS,
                )
            elif geometry == "fundamental":
                found = cv2.findFundamentalMat(first, second, sampling(tolerance, confidence))
            else:
                params = sampling(tolerance, confidence)
                K, D = np.eye(3), np.zeros(4)  # of rays in the planes z = 1
                found = cv2.findEssentialMat(first, second, K, K, D, D, params)
    except cv2.error:  # an assertion fails in some versions where no sample gives a model
        return None
    if np.shape(found[0]) != (3, 3):  # None where every sample is degenerate
        return None
    return np.asarray(found[0], np.float64)


def sampling(tolerance: float, confidence: float) -> "cv2.UsacParams":
    """OpenCV's settings for an epipolar geometry.

    The score is MSAC's. MAGSAC's takes twice the time. With it, right matches have three times as
    large squared errors under essential matrices, and equal ones under fundamental matrices.
    """
    params = cv2.UsacParams()
    params.threshold, params.confidence = tolerance, confidence
    params.maxIterations = MAX_RANSAC_ITERATIONS
    params.score = cv2.SCORE_METHOD_MSAC
    params.sampler, params.neighborsSearch = cv2.SAMPLING_UNIFORM, cv2.NEIGH_GRID
    params.loMethod = cv2.LOCAL_OPTIM_INNER_LO
    params.final_polisher = cv2.NONE_POLISHER
    return params
