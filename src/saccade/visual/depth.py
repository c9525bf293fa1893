"""Depth of points: from the disparity of a stereo rig, or from a depth image."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Drive, Frame
from saccade.types import Float32Array, FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.optical_flow import ByteArray, track_disparities
from saccade.visual.prepared_frame import PreparedFrame

BLOCK_SIZE = 15
"""Pixels a side of the blocks that are matched along a row."""
DISPARITY_STEP = 16
"""The number of disparities that block matching tries is a multiple of it."""
MAX_RELATIVE_DISPARITY = 0.25
"""Largest disparity that is tried, as a fraction of the image's width."""


def measures_depth(camera: Camera, frame: Frame) -> bool:
    """Whether a frame measures depth: by a stereo rig or a depth image."""
    return camera.baseline > 0 or frame.depth is not None


def provides_depth(drive: Drive) -> bool:
    """Whether the frames of a drive measure depth: by the first that can be read.

    Raises:
        DriveError: none can be read, as where the calibration is of other images.
    """
    first_error = None
    for number in range(len(drive)):
        try:
            frame = drive.load(number)
        except ImageError as error:
            first_error = first_error or error
            continue
        if frame.image is not None or frame.tracks is not None:
            return measures_depth(drive.camera, frame)
    if first_error is not None:
        raise DriveError(f"{first_error}; no frame of the drive can be used")
    return False


def measure_depth(
    camera: Camera,
    prepared: PreparedFrame,
    xy: Float32Array,
    config: VisualConfig,
    previous: FloatArray | None = None,
) -> FloatArray:
    """(k,) depths in metres along the optical axis at pixels (k, 2); NaN where not measured.

    Args:
        camera: the calibration.
        prepared: the frame.
        xy: (k, 2) pixels.
        config: the range limits, which bound the disparity.
        previous: (k,) depths in the frame before, from which disparities are tracked; None
            starts them by block matching.
    """
    if prepared.frame.depth is not None:
        return _depth_at(prepared.frame.depth, xy)
    if prepared.left is None or prepared.right is None:
        return np.full(len(xy), np.nan)
    if previous is not None:
        initial = camera.fx * camera.baseline / previous
    else:
        max_disparity = camera.fx * camera.baseline / max(config.range_limits[0], 1e-3)
        initial = _block_disparities(prepared.left, prepared.right, xy, max_disparity)
    disparity = track_disparities(prepared.left, prepared.right, xy, initial)
    if previous is None:
        disparity = np.where(initial > 0, disparity, np.nan)
    return depth_of(camera, disparity)


def depth_of(camera: Camera, disparity: FloatArray) -> FloatArray:
    """(k,) metres along the optical axis of disparities (k,) in pixels; NaN where not over 0."""
    return np.asarray(camera.fx * camera.baseline / np.where(disparity > 0, disparity, np.nan))


def depth_sigma(camera: Camera, depth: FloatArray, config: VisualConfig) -> FloatArray:
    """(k,) standard deviations of measured depths (k,), in metres."""
    if camera.baseline > 0:
        return np.asarray(depth**2 * config.disparity_sigma / (camera.fx * camera.baseline))
    return config.relative_depth_sigma * depth


def _block_disparities(
    left: ByteArray, right: ByteArray, xy: Float32Array, max_disparity: float
) -> FloatArray:
    """(k,) coarse disparities of points (k, 2) in pixels, by block matching; NaN where unknown."""
    width = min(max_disparity, MAX_RELATIVE_DISPARITY * left.shape[1])
    count = max(DISPARITY_STEP, int(np.ceil(width / DISPARITY_STEP)) * DISPARITY_STEP)
    matcher = cv2.StereoBM.create(numDisparities=count, blockSize=BLOCK_SIZE)
    disparity = _sample(matcher.compute(left, right), xy) / 16
    return np.where(disparity > 0, disparity, np.nan)


def _depth_at(depth: FloatArray, xy: Float32Array) -> FloatArray:
    """(k,) metres at pixels (k, 2) of a depth image (H, W); NaN where it has none."""
    values = _sample(depth, xy)
    return np.where(values > 0, values, np.nan)


def _sample(image: npt.NDArray[Any], xy: Float32Array) -> npt.NDArray[Any]:
    """(k,) values of an image (H, W) at the nearest pixels of (k, 2)."""
    columns, rows = np.rint(xy).astype(np.int64).T
    return np.asarray(image[rows.clip(0, image.shape[0] - 1), columns.clip(0, image.shape[1] - 1)])
