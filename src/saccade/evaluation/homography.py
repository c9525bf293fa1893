"""Projection by a homography, and the error of one estimated from matches."""

import cv2
import numpy as np

from saccade.keypoints.two_view_fit import project
from saccade.types import BoolArray, FloatArray

INLIER_PX = 2.0
"""Inlier threshold of MAGSAC in pixels."""
RUNS = 5
"""Random draws of MAGSAC for each image pair, over which its scores are averaged."""


def inside(xy: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """(n,) whether points lie within the centers of the outermost pixels of an (H, W) image."""
    height, width = shape
    x, y = xy.T
    within: BoolArray = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return within


def corner_errors(
    first: FloatArray, second: FloatArray, homography: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """(RUNS,) corner errors of homographies estimated from matches in different orders.

    The estimator draws its samples from a fixed sequence of indices, so that each order of the
    matches is another draw. Arguments as of `corner_error`.
    """
    orders = [np.random.default_rng(seed).permutation(len(first)) for seed in range(RUNS)]
    return np.array([corner_error(first[i], second[i], homography, shape) for i in orders])


def corner_error(
    first: FloatArray, second: FloatArray, homography: FloatArray, shape: tuple[int, int]
) -> float:
    """Mean corner error of a homography estimated from matches.

    Args:
        first: (m, 2) matched points of the first image.
        second: (m, 2) their matches in the second image.
        homography: (3, 3) true homography.
        shape: (H, W) of the first image.

    Returns:
        Mean over the four corners in pixels of the second image; infinite where no
        homography can be estimated. The estimator is OpenCV's USAC with MAGSAC, which is
        deterministic.
    """
    if len(first) < 4:
        return float("inf")
    estimate = np.asarray(
        cv2.findHomography(first, second, cv2.USAC_MAGSAC, INLIER_PX)[0], np.float64
    )
    if estimate.shape != (3, 3):
        return float("inf")
    height, width = shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    gap = project(estimate, corners) - project(homography, corners)
    error = float(np.hypot(*gap.T).mean())
    return error if np.isfinite(error) else float("inf")
