"""The error of a homography that is estimated from matches."""

from typing import Literal, TypeAlias

import numpy as np

from saccade.exchange.colmap import import_pycolmap
from saccade.keypoints.two_view_fit import project
from saccade.keypoints.verification import sample_consensus, verify_positions
from saccade.types import BoolArray, FloatArray

Estimator: TypeAlias = Literal["verify", "magsac", "colmap"]
"""`saccade.verify`, OpenCV's USAC with MAGSAC, and COLMAP's LO-RANSAC."""

ESTIMATORS: tuple[Estimator, ...] = ("verify", "magsac", "colmap")
INLIER_PX = 2.0
"""Inlier threshold in pixels, the default of `saccade.verify`."""
RUNS = 5
"""Random draws of MAGSAC or COLMAP for each image pair, over which scores are averaged."""


def inside(xy: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """(n,) whether points lie within the centers of the outermost pixels of an (H, W) image."""
    height, width = shape
    x, y = xy.T
    within: BoolArray = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return within


def corner_errors(
    matched: FloatArray,
    sigma: FloatArray,
    homography: FloatArray,
    shape: tuple[int, int],
    estimator: Estimator = "verify",
) -> FloatArray:
    """Errors (r,) of homographies estimated from matches: mean over the corners in pixels.

    MAGSAC and COLMAP draw samples from a fixed sequence of indices, so that each of `RUNS` orders
    of the matches is another draw. `verify` does not depend on the order: r is 1.

    Args:
        matched: (m, 4) rows x1, y1, x2, y2.
        sigma: (m, 2) standard deviations of both positions; only `verify` uses them.
        homography: (3, 3) true homography.
        shape: (H, W) of the first image, whose corners are projected.
        estimator: of the homography; infinite errors are those of none.
    """
    if estimator == "verify":
        found = verify_positions(matched, sigma, "homography", INLIER_PX, min_inliers=4)
        return np.array([corner_error(found.matrix, homography, shape)])
    orders = [np.random.default_rng(seed).permutation(len(matched)) for seed in range(RUNS)]
    estimate = _magsac if estimator == "magsac" else _colmap
    estimates = [estimate(matched[order]) for order in orders]
    return np.array([corner_error(each, homography, shape) for each in estimates])


def corner_error(
    estimate: FloatArray | None, homography: FloatArray, shape: tuple[int, int]
) -> float:
    """Mean distance in pixels of the four corners of an (H, W) image projected by both."""
    if estimate is None:
        return float("inf")
    height, width = shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    gap = project(estimate, corners) - project(homography, corners)
    error = float(np.hypot(*gap.T).mean())
    return error if np.isfinite(error) else float("inf")


def _magsac(matched: FloatArray) -> FloatArray | None:
    return sample_consensus(matched, "homography", INLIER_PX)[0]


def _colmap(matched: FloatArray) -> FloatArray | None:
    pycolmap = import_pycolmap()
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = INLIER_PX, 0
    found = pycolmap.estimate_homography_matrix(matched[:, :2], matched[:, 2:], options)
    return None if found is None else np.asarray(found["H"], np.float64)
