"""Gray images of a frame, and sparse optical flow from one image to another."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError
from saccade.frames import Camera, Frame
from saccade.io.image import as_gray
from saccade.types import BoolArray, Float32Array, FloatArray, Image

ByteArray: TypeAlias = npt.NDArray[np.uint8]

MIN_CONTRAST = 4.0
"""Standard deviation of the gray levels below which an image is blank."""
WINDOW = (15, 15)
"""Size of the window of Lucas-Kanade tracking, in pixels."""
LEVELS = 4
"""Pyramid levels above the image itself, which bound how far a point may move."""
GUESS_LEVELS = 1
"""Pyramid levels where the position of each point is predicted."""
MAX_FORWARD_BACKWARD_ERROR = 0.5
"""Pixels between a point and where it is after tracking forward and backward."""
MAX_ROW_OFFSET = 1.0
"""Pixels between the rows of a point in the two images of a rectified rig."""
VIEW_WIDTH = 40
"""Width in pixels of the reduced image by which views are compared."""
MIN_VIEW_HEIGHT = 12
"""Least height in pixels of that image."""
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame with its images as gray levels."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) gray levels; None where there is no image, or a blank one."""
    right: ByteArray | None = None
    """(H, W) gray levels of the right camera; None likewise."""

    @property
    def is_blank(self) -> bool:
        """Whether it has neither a usable image nor tracks."""
        return self.left is None and self.frame.tracks is None

    @cached_property
    def view(self) -> Float32Array | None:
        """(h, 40) gray levels of the left image, reduced."""
        if self.left is None:
            return None
        height, width = self.left.shape
        size = VIEW_WIDTH, max(round(VIEW_WIDTH * height / width), MIN_VIEW_HEIGHT)
        reduced = cv2.resize(self.left, size, interpolation=cv2.INTER_AREA)
        return np.asarray(reduced, np.float32)


def prepare_frame(frame: Frame, camera: Camera) -> PreparedFrame:
    """Convert the images of a frame to gray levels.

    Raises:
        DriveError: an image has another size than the calibration.
    """
    if frame.image is None:
        return PreparedFrame(frame)
    gray = gray_bytes(frame.image)
    right = None if frame.right is None else gray_bytes(frame.right)
    size = camera.width, camera.height
    if gray.shape[::-1] != size:
        raise DriveError(
            f"frame at {frame.time:.3f} s: expected an image of {size[0]} x {size[1]} "
            f"px as the calibration says, found {gray.shape[1]} x {gray.shape[0]}"
        )
    if cv2.meanStdDev(gray)[1][0, 0] < MIN_CONTRAST:
        return PreparedFrame(frame)
    prepared = PreparedFrame(frame, gray, right)
    _ = prepared.view  # computed where frames are read ahead
    return prepared


def gray_bytes(image: Image) -> ByteArray:
    """(H, W) gray levels of any image."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.rint(as_gray(image) * 255).astype(np.uint8)


def reduced_image(image: Image, reduction: int) -> Image:
    """Means of squares of pixels; rows and columns that are left over are cut off."""
    h, w = (size // reduction for size in image.shape[:2])
    whole = image[: h * reduction, : w * reduction]
    return cv2.resize(whole, (w, h), interpolation=cv2.INTER_AREA)


def track_points(
    previous: ByteArray,
    current: ByteArray,
    xy: Float32Array,
    guess: Float32Array | None = None,
    levels: int = LEVELS,
) -> tuple[Float32Array, BoolArray]:
    """Lucas-Kanade tracking with a forward-backward check (Lucas & Kanade, 1981).

    From the first image (H, W) to the second, of pixels (k, 2); it begins at `guess` (k, 2), by
    default at the same pixels. `levels` of the pyramid are above the images: fewer trust the guess
    more.

    Returns:
        (k, 2) pixels in the second, and (k,) whether each point was found.
    """
    if len(xy) == 0:
        return xy.copy(), np.zeros(0, np.bool_)
    start = np.ascontiguousarray(xy if guess is None else guess, np.float32)
    origin, nothing = np.ascontiguousarray(xy, np.float32), np.zeros((0, 1), np.uint8)
    settings = nothing, nothing, WINDOW, levels, CRITERIA, cv2.OPTFLOW_USE_INITIAL_FLOW
    tracked, found, _ = cv2.calcOpticalFlowPyrLK(previous, current, origin, start.copy(), *settings)
    settings = nothing, nothing, WINDOW, 1, CRITERIA, cv2.OPTFLOW_USE_INITIAL_FLOW
    returned, back, _ = cv2.calcOpticalFlowPyrLK(
        current, previous, tracked, origin.copy(), *settings
    )
    error = np.hypot(*(returned - origin).T)
    ok = (found[:, 0] > 0) & (back[:, 0] > 0) & (error < MAX_FORWARD_BACKWARD_ERROR)
    return np.asarray(tracked, np.float32), np.asarray(ok)


def track_frame(
    previous: PreparedFrame,
    current: PreparedFrame,
    xy: Float32Array,
    guess: Float32Array | None = None,
) -> tuple[Float32Array, BoolArray]:
    """`track_points` from one frame with an image to the next, made as bright as the first."""
    assert previous.left is not None
    assert current.left is not None
    assert previous.view is not None
    assert current.view is not None
    gain = float(np.median((previous.view + 1) / (current.view + 1)))
    image = np.asarray(cv2.convertScaleAbs(current.left, alpha=gain), np.uint8)
    return track_points(previous.left, image, xy, guess, LEVELS if guess is None else GUESS_LEVELS)


def track_disparities(
    left: ByteArray, right: ByteArray, xy: Float32Array, initial: FloatArray
) -> FloatArray:
    """(k,) disparities of pixels (k, 2) in the left image of a rectified rig.

    Lucas-Kanade tracking from initial disparities (k,), 0 where these are NaN. The result is NaN
    where a point is not found in its row of the right image.
    """
    guess = xy.astype(np.float32)
    guess[:, 0] -= np.nan_to_num(initial).astype(np.float32)
    tracked, ok = track_points(left, right, xy, guess)
    ok &= np.abs(tracked[:, 1] - xy[:, 1]) < MAX_ROW_OFFSET
    disparity = (xy[:, 0] - tracked[:, 0]).astype(np.float64)
    return np.where(ok, disparity, np.nan)
