"""Sparse optical flow: points tracked from image to image, and from the left to the right one."""

from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.types import Float32Array, FloatArray

BoolArray: TypeAlias = npt.NDArray[np.bool_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]
ShortArray: TypeAlias = npt.NDArray[np.int16]

WINDOW = (15, 15)
"""Pixels around a point that are compared."""
LEVELS = 4
"""Levels of the image pyramid beside the image: how far a point may move."""
MAX_RETURN_ERROR = 0.5
"""Pixels by which a point tracked forth and back may miss its origin."""
MAX_ROW_OFFSET = 1.0
"""Pixels by which the rows of a rectified rig may differ."""
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)


class ImageGradients(NamedTuple):
    """An image and its derivatives (Sobel)."""

    intensity: ByteArray
    """(h, w) gray levels."""
    dx: ShortArray
    """(h, w) eight times the derivative along a row."""
    dy: ShortArray
    """(h, w) eight times the derivative along a column."""


def image_gradients(image: ByteArray) -> ImageGradients:
    """Gradients of a gray image (h, w)."""
    dx, dy = (cv2.Sobel(image, cv2.CV_16S, *order, ksize=3) for order in ((1, 0), (0, 1)))
    return ImageGradients(image, np.asarray(dx, np.int16), np.asarray(dy, np.int16))


def track_points(
    previous: ByteArray, current: ByteArray, xy: Float32Array, guess: Float32Array | None = None
) -> tuple[Float32Array, BoolArray]:
    """Lucas-Kanade tracking with a forward-backward check.

    Args:
        previous: (H, W) gray levels of the first image.
        current: of the second.
        xy: (k, 2) pixels in the first.
        guess: (k, 2) initial pixels in the second; None: those in the first.

    Returns:
        (k, 2) pixels in the second, and (k,) whether each point was found.

    Source: Lucas & Kanade (1981).
    """
    if len(xy) == 0:
        return xy.copy(), np.zeros(0, np.bool_)
    start = np.ascontiguousarray(xy if guess is None else guess, np.float32)
    origin = np.ascontiguousarray(xy, np.float32)
    nothing = np.zeros((0, 1), np.uint8)
    flag = cv2.OPTFLOW_USE_INITIAL_FLOW
    tracked, found, _ = cv2.calcOpticalFlowPyrLK(
        previous, current, origin, start.copy(), nothing, nothing, WINDOW, LEVELS, CRITERIA, flag
    )
    returned, found_back, _ = cv2.calcOpticalFlowPyrLK(
        current, previous, tracked, origin.copy(), nothing, nothing, WINDOW, 1, CRITERIA, flag
    )
    error = np.hypot(*(returned - origin).T)
    ok = (found[:, 0] > 0) & (found_back[:, 0] > 0) & (error < MAX_RETURN_ERROR)
    return np.asarray(tracked, np.float32), np.asarray(ok)


def track_disparities(
    left: ByteArray, right: ByteArray, xy: Float32Array, initial: FloatArray
) -> FloatArray:
    """(k,) disparities of pixels (k, 2) in the left image of a rectified rig.

    They are tracked from initial ones (k,), which may be NaN; NaN where a point was not found in
    its row of the right image.
    """
    guess = xy.astype(np.float32)
    guess[:, 0] -= np.nan_to_num(initial).astype(np.float32)
    tracked, ok = track_points(left, right, xy, guess)
    ok &= np.abs(tracked[:, 1] - xy[:, 1]) < MAX_ROW_OFFSET
    disparity = (xy[:, 0] - tracked[:, 0]).astype(np.float64)
    return np.where(ok & (disparity > 0), disparity, np.nan)
