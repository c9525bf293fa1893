"""Gray images of frames, and sparse optical flow between images."""

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
"""Minimum standard deviation of the gray levels of an image that is not blank."""
WINDOW = (15, 15)
"""Window of Lucas-Kanade tracking, in pixels."""
LEVELS = 4
"""Number of pyramid levels above the image, which limits the displacement of a point."""
GUESS_LEVELS = 1
"""Number of pyramid levels above the image if positions are predicted."""
MAX_FORWARD_BACKWARD_ERROR = 0.5
"""Maximum distance between a point and its position after tracking forward and backward, in
pixels."""
MAX_ROW_OFFSET = 1.0
"""Maximum difference between the rows of a point in the images of a rectified rig, in pixels."""
MIN_BRIGHTNESS_CHANGE = 0.05
"""Minimum relative change of brightness that is corrected before tracking."""
VIEW_WIDTH = 40
"""Width of the reduced image by which views and brightness are compared, in pixels."""
MIN_VIEW_HEIGHT = 12
"""Minimum height of the reduced image, in pixels."""
MAX_VIEW_SHIFT = 0.2
"""Maximum shift between two related views, as a fraction of their size."""
MIN_VIEW_CORRELATION = 0.5
"""Minimum correlation of two related views after the best shift."""
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)
"""Termination of Lucas-Kanade tracking: 20 iterations, or a step of 0.02 pixels."""


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame with its images converted to gray levels."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) gray levels of the (left) image; None if it is missing or blank."""
    right: ByteArray | None = None
    """(H, W) gray levels of the right image; None if it is missing, or if the left one is blank."""

    @property
    def is_blank(self) -> bool:
        """Whether the frame has neither a usable image nor tracks."""
        return self.left is None and self.frame.tracks is None

    @cached_property
    def view(self) -> Float32Array | None:
        """(h, 40) gray levels of the reduced left image; None if the frame has no image."""
        if self.left is None:
            return None
        height, width = self.left.shape
        size = VIEW_WIDTH, max(round(VIEW_WIDTH * height / width), MIN_VIEW_HEIGHT)
        reduced = cv2.resize(self.left, size, interpolation=cv2.INTER_AREA)
        return np.asarray(reduced, np.float32)


def prepare_frame(frame: Frame, camera: Camera) -> PreparedFrame:
    """Converts the images of a frame to gray levels.

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
            f"frame at {frame.time:.3f} s: expected an image of {size[0]} x {size[1]} px "
            f"(the calibration), found {gray.shape[1]} x {gray.shape[0]}"
        )
    if cv2.meanStdDev(gray)[1][0, 0] < MIN_CONTRAST:
        return PreparedFrame(frame)
    prepared = PreparedFrame(frame, gray, right)
    _ = prepared.view  # computed where frames are read ahead
    return prepared


def is_unrelated(previous: PreparedFrame, current: PreparedFrame) -> bool:
    """Whether the images of two frames have nothing in common, as where one is garbled."""
    if previous.view is None or current.view is None:
        return False
    height, width = previous.view.shape
    rows, columns = round(height * MAX_VIEW_SHIFT), round(width * MAX_VIEW_SHIFT)
    inner = previous.view[rows : height - rows, columns : width - columns]
    correlation = cv2.matchTemplate(current.view, inner, cv2.TM_CCOEFF_NORMED)
    return float(correlation.max()) < MIN_VIEW_CORRELATION


def gray_bytes(image: Image) -> ByteArray:
    """Gray levels (H, W) of any image."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.rint(as_gray(image) * 255).astype(np.uint8)


def reduced_image(image: Image, reduction: int) -> Image:
    """Image reduced by an integer factor by averaging; remaining rows and columns are cut off."""
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

    Tracks pixels (k, 2) from the previous image (H, W) to the current one, starting at `guess`
    (k, 2), by default at the same pixels. `levels` is the number of pyramid levels above the image.

    Returns:
        Pixels (k, 2) in the current image, and (k,) whether each point was found.
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
    """`track_points` between frames with images, after equalizing their brightness."""
    assert previous.left is not None
    assert current.left is not None
    assert previous.view is not None
    assert current.view is not None
    image = current.left
    gain = float(np.median((previous.view + 1) / (current.view + 1)))
    if abs(gain - 1) >= MIN_BRIGHTNESS_CHANGE:
        image = np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)
    return track_points(previous.left, image, xy, guess, LEVELS if guess is None else GUESS_LEVELS)


def track_disparities(
    left: ByteArray, right: ByteArray, xy: Float32Array, initial: FloatArray
) -> FloatArray:
    """Disparities (k,) of pixels (k, 2) in the left image of a rectified rig.

    Lucas-Kanade tracking starts from initial disparities (k,), or from 0 where they are NaN. The
    result is NaN where a point is not found in its row of the right image.
    """
    guess = xy.astype(np.float32)
    guess[:, 0] -= np.nan_to_num(initial).astype(np.float32)
    tracked, ok = track_points(left, right, xy, guess)
    ok &= np.abs(tracked[:, 1] - xy[:, 1]) < MAX_ROW_OFFSET
    disparity = (xy[:, 0] - tracked[:, 0]).astype(np.float64)
    return np.where(ok, disparity, np.nan)
