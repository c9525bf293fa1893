"""Points and whole images under a homography, known or estimated from matches."""

from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray

BoolArray: TypeAlias = npt.NDArray[np.bool_]

INLIER_PX = 2.0
"""MAGSAC's threshold."""


def project(homography: FloatArray, xy: FloatArray) -> FloatArray:
    """(n, 2) points under a (3, 3) homography; not finite where a point goes to infinity."""
    rows = np.c_[xy, np.ones(len(xy))] @ homography.T  # (n, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        projected: FloatArray = rows[:, :2] / rows[:, 2:]
    return projected


def inside(xy: FloatArray, shape: tuple[int, int]) -> BoolArray:
    """(n,) whether points lie between the centres of the outermost pixels of an (H, W) image."""
    height, width = shape
    x, y = xy.T
    within: BoolArray = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return within


def corner_error(
    first: FloatArray, second: FloatArray, homography: FloatArray, shape: tuple[int, int]
) -> float:
    """How far an estimated homography puts the corners of an image from where they belong.

    Args:
        first: (m, 2) matched points of the first image.
        second: (m, 2) and of the second.
        homography: (3, 3) the true one.
        shape: (H, W) of the first image.

    Returns:
        Mean over the four corners in pixels of the second image; infinite where no
        homography can be estimated. The estimate is OpenCV's USAC with MAGSAC, which
        starts from a fixed seed.
    """
    if len(first) < 4:
        return float("inf")
    found = np.asarray(cv2.findHomography(first, second, cv2.USAC_MAGSAC, INLIER_PX)[0], np.float64)
    if found.shape != (3, 3):
        return float("inf")
    height, width = shape
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], float)
    gap = project(found, corners) - project(homography, corners)
    error = float(np.hypot(*gap.T).mean())
    return error if np.isfinite(error) else float("inf")
