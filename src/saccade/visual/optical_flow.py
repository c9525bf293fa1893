"""Points followed from frame to frame, and from the left image to the right one."""

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.image import as_gray
from saccade.types import Float32Array, FloatArray, Image

BoolArray: TypeAlias = npt.NDArray[np.bool_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]

WINDOW = (15, 15)
"""Pixels around a point that are compared."""
LEVELS = 4
"""Halvings of the image: how far a point may jump."""
RETURN = 0.5
"""Pixels by which a point may miss when it is followed back again."""
UPRIGHT = 1.0
"""Pixels by which the images of a rectified rig may differ in height."""
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)


def gray_bytes(image: Image) -> ByteArray:
    """(H, W) grey values of any image."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.rint(as_gray(image) * 255).astype(np.uint8)


def track_points(
    before: ByteArray, now: ByteArray, xy: Float32Array, guess: Float32Array | None = None
) -> tuple[Float32Array, BoolArray]:
    """Where points of one image are in the next one.

    Args:
        before: (H, W) grey values of the first image.
        now: of the second.
        xy: (k, 2) pixels in the first.
        guess: (k, 2) where to begin in the second; as in the first unless told otherwise.

    Returns:
        (k, 2) pixels in the second, and (k,) whether each was found: followed back it
        comes home.

    Source: Lucas & Kanade (1981).
    """
    if len(xy) == 0:
        return xy.copy(), np.zeros(0, np.bool_)
    start = np.ascontiguousarray(xy if guess is None else guess, np.float32)
    here = np.ascontiguousarray(xy, np.float32)
    nothing = np.zeros((0, 1), np.uint8)
    flag = cv2.OPTFLOW_USE_INITIAL_FLOW
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, here, start.copy(), nothing, nothing, WINDOW, LEVELS, CRITERIA, flag
    )
    home, back, _ = cv2.calcOpticalFlowPyrLK(
        now, before, there, here.copy(), nothing, nothing, WINDOW, 1, CRITERIA, flag
    )
    missed = np.hypot(*(home - here).T)
    ok = (found[:, 0] > 0) & (back[:, 0] > 0) & (missed < RETURN)
    return np.asarray(there, np.float32), np.asarray(ok)


TrackFunction = Callable[
    [ByteArray, ByteArray, Float32Array, Float32Array | None], tuple[Float32Array, BoolArray]
]
"""What `track_points` is, and what may stand for it."""


def disparities(
    left: ByteArray,
    right: ByteArray,
    xy: Float32Array,
    expected: FloatArray,
    follow: TrackFunction = track_points,
) -> FloatArray:
    """How many pixels further left points lie in the right image of a rectified rig.

    Args:
        left: (H, W) grey values.
        right: of the other image.
        xy: (k, 2) pixels in the left.
        expected: (k,) where to begin; NaN where nothing is known.
        follow: what finds points of one image in another.

    Returns:
        (k,) pixels; NaN where a point was not found, or not at its height.
    """
    guess = xy.astype(np.float32)
    guess[:, 0] -= np.nan_to_num(expected).astype(np.float32)
    there, ok = follow(left, right, xy, guess)
    ok &= np.abs(there[:, 1] - xy[:, 1]) < UPRIGHT
    shift = (xy[:, 0] - there[:, 0]).astype(np.float64)
    return np.where(ok & (shift > 0), shift, np.nan)
