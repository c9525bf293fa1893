"""How far points are: from the right image of a rig, or from a depth image."""

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray
from saccade.visual.optical_flow import ByteArray, disparities

BLOCK = 15
"""Pixels a side of what is compared along a row."""
STEP = 16
"""The number of disparities that are tried is a multiple of it."""
WIDEST = 0.25
"""Disparities up to this share of the image's width are tried."""


def first_disparities(
    camera: Camera, left: ByteArray, right: ByteArray, xy: Float32Array, nearest: float
) -> FloatArray:
    """(k,) disparities of points (k, 2) of which nothing is known yet; NaN where not found.

    Args:
        camera: the calibration.
        left: (H, W) grey values.
        right: of the other image.
        xy: pixels in the left.
        nearest: metres within which nothing is looked for.
    """
    wide = min(camera.fx * camera.baseline / max(nearest, 1e-3), WIDEST * camera.width)
    tried = max(STEP, int(np.ceil(wide / STEP)) * STEP)
    coarse = cv2.StereoBM.create(numDisparities=tried, blockSize=BLOCK).compute(left, right)
    columns, rows = np.rint(xy).astype(np.int64).T
    rough = coarse[rows.clip(0, coarse.shape[0] - 1), columns.clip(0, coarse.shape[1] - 1)] / 16
    found = disparities(left, right, xy, np.where(rough > 0, rough, 0.0))
    return np.where(rough > 0, found, np.nan)


def stereo_depth_sigma(camera: Camera, depth: FloatArray, disparity_sigma: float) -> FloatArray:
    """(k,) metres: what an error of the disparity makes of a depth (k,)."""
    return np.asarray(depth**2 * disparity_sigma / (camera.fx * camera.baseline))


def depth_at(depth: FloatArray, xy: Float32Array) -> FloatArray:
    """(k,) metres at pixels (k, 2) of a depth image; NaN where it does not say."""
    columns, rows = np.rint(xy).astype(np.int64).T
    found = depth[rows.clip(0, depth.shape[0] - 1), columns.clip(0, depth.shape[1] - 1)]
    return np.where(found > 0, found, np.nan)
