"""Depth of points from stereo disparity or a depth image."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Drive, Frame
from saccade.types import Float32Array, FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.optical_flow import ByteArray, PreparedFrame, track_disparities

BLOCK_SIZE = 15
"""Side of a block in block matching, in pixels."""
DISPARITY_STEP = 16
"""Divisor of the number of disparities in block matching."""
MAX_RELATIVE_DISPARITY = 0.25
"""Maximum disparity in block matching, as a fraction of the image width."""


def measures_depth(camera: Camera, frame: Frame) -> bool:
    """Whether a frame has stereo images or a depth image."""
    return camera.baseline > 0 or frame.depth is not None


def first_frame(drive: Drive) -> dict[int, Frame]:
    """First readable frame of a drive by its number; empty if all frames are blank.

    Raises:
        DriveError: no frame can be read.
    """
    first_error = None
    for number in range(len(drive)):
        try:
            frame = drive.load(number)
        except ImageError as error:
            first_error = first_error or error
            continue
        if frame.image is not None or frame.tracks is not None:
            return {number: frame}
    if first_error is not None:
        raise DriveError(f"{first_error}; no frame of the drive can be used")
    return {}


def measure_depth(
    camera: Camera,
    prepared: PreparedFrame,
    xy: Float32Array,
    config: VisualConfig,
    previous: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Depths (k,) at pixels (k, 2) and their standard deviations (k,), in meters.

    Depths are along the optical axis, and NaN where they are not measured. Tracking of
    disparities starts from the `previous` depths (k,), or from block matching, which also rejects
    false matches.
    """
    if prepared.frame.depth is not None:
        values = _sample(prepared.frame.depth, xy)
        depth = np.where(values > 0, values, np.nan)
        return depth, depth_sigma(camera, depth, config)
    if prepared.left is None or prepared.right is None:
        unknown = np.full(len(xy), np.nan)
        return unknown, unknown
    if previous is not None:
        initial = camera.fx * camera.baseline / previous
    else:
        max_disparity = camera.fx * camera.baseline / max(config.range_limits[0], 1e-3)
        initial = _block_disparities(prepared.left, prepared.right, xy, max_disparity)
    disparity = track_disparities(prepared.left, prepared.right, xy, initial)
    if previous is None:
        disparity = np.where(initial > 0, disparity, np.nan)
    depth = depth_of(camera, disparity)
    return depth, depth_sigma(camera, depth, config)


def depth_of(camera: Camera, disparity: FloatArray) -> FloatArray:
    """Depths (k,) in meters of disparities (k,) in pixels; NaN unless positive."""
    return np.asarray(camera.fx * camera.baseline / np.where(disparity > 0, disparity, np.nan))


def depth_sigma(camera: Camera, depth: FloatArray, config: VisualConfig) -> FloatArray:
    """Standard deviations (k,) of measured depths (k,), in meters."""
    if camera.baseline > 0:
        return np.asarray(depth**2 * config.disparity_sigma / (camera.fx * camera.baseline))
    return config.relative_depth_sigma * depth


def _block_disparities(
    left: ByteArray, right: ByteArray, xy: Float32Array, max_disparity: float
) -> FloatArray:
    """Coarse disparities (k,) at pixels (k, 2) by block matching; NaN where unknown."""
    width = min(max_disparity, MAX_RELATIVE_DISPARITY * left.shape[1])
    count = max(DISPARITY_STEP, int(np.ceil(width / DISPARITY_STEP)) * DISPARITY_STEP)
    matcher = cv2.StereoBM.create(numDisparities=count, blockSize=BLOCK_SIZE)
    padded = (  # the matcher leaves out as many columns at the left
        cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)
    )
    disparity = _sample(matcher.compute(*padded), xy + np.array([count, 0], np.float32)) / 16
    return np.where(disparity > 0, disparity, np.nan)


def _sample(image: npt.NDArray[Any], xy: Float32Array) -> npt.NDArray[Any]:
    """Values (k,) of an image (H, W) at the pixels nearest to (k, 2)."""
    columns, rows = np.rint(xy).astype(np.int64).T
    return np.asarray(image[rows.clip(0, image.shape[0] - 1), columns.clip(0, image.shape[1] - 1)])
