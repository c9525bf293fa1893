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
LEVELS_OF_GUESS = 1
"""The same where it is predicted where each point is."""
MAX_FORWARD_BACKWARD_ERROR = 0.5
"""Pixels between a point and where it is after tracking forward and backward."""
MAX_ROW_OFFSET = 1.0
"""Pixels between the rows of a point in the two images of a rectified rig."""
MIN_BRIGHTNESS_CHANGE, BRIGHTNESS_BLOCKS = 0.05, (32, 24)
"""Relative change of brightness from which an image is rescaled before tracking into it: lamps
flicker, cameras adapt, and tracking tolerates little more; and the numbers of blocks across and
down, whose median change it is, so that bright objects at the edge do not count."""
VIEW_WIDTH, MIN_VIEW_HEIGHT = 40, 12
"""Pixels of the reduced image by which views are compared."""
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame with its images as gray levels."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) gray levels; None where there is no image, or a blank one."""
    right: ByteArray | None = None
    """The same of the right camera."""

    @property
    def is_blank(self) -> bool:
        """Whether it has neither a usable image nor tracks."""
        return self.left is None and self.frame.tracks is None

    @cached_property
    def brightness(self) -> Float32Array | None:
        """(24, 32) mean gray levels of blocks of the left image."""
        return None if self.left is None else _reduced(self.left, BRIGHTNESS_BLOCKS)

    @cached_property
    def view(self) -> Float32Array | None:
        """(h, 40) gray levels of the left image, reduced."""
        if self.left is None:
            return None
        height, width = self.left.shape
        size = VIEW_WIDTH, max(round(VIEW_WIDTH * height / width), MIN_VIEW_HEIGHT)
        return _reduced(self.left, size)


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
    _ = prepared.brightness, prepared.view  # computed where frames are read ahead
    return prepared


def _reduced(image: ByteArray, size: tuple[int, int]) -> Float32Array:
    """Gray levels of an image of a smaller size (w, h)."""
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


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
    """Lucas-Kanade tracking with a forward-backward check.

    Args:
        previous: (H, W) gray levels of the first image.
        current: of the second.
        xy: (k, 2) pixels in the first.
        guess: (k, 2) initial pixels in the second; by default those in the first.
        levels: of the pyramid above the images: fewer trust the guess more.

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
        previous, current, origin, start.copy(), nothing, nothing, WINDOW, levels, CRITERIA, flag
    )
    returned, found_back, _ = cv2.calcOpticalFlowPyrLK(
        current, previous, tracked, origin.copy(), nothing, nothing, WINDOW, 1, CRITERIA, flag
    )
    error = np.hypot(*(returned - origin).T)
    ok = (found[:, 0] > 0) & (found_back[:, 0] > 0) & (error < MAX_FORWARD_BACKWARD_ERROR)
    return np.asarray(tracked, np.float32), np.asarray(ok)


def track_frame(
    previous: PreparedFrame,
    current: PreparedFrame,
    xy: Float32Array,
    guess: Float32Array | None = None,
) -> tuple[Float32Array, BoolArray]:
    """Track pixels from one frame to the next.

    Args:
        previous: a frame with an image.
        current: another.
        xy: (k, 2) pixels in the first.
        guess: (k, 2) where they are expected in the second; by default where they are in the first.

    Returns:
        (k, 2) pixels in the second, and (k,) whether each point was found.
    """
    gain = brightness_gain(current, previous)
    assert previous.left is not None
    assert current.left is not None
    levels = LEVELS if guess is None else LEVELS_OF_GUESS
    return track_points(previous.left, brightened(current.left, gain), xy, guess, levels)


def brightness_gain(frame: PreparedFrame, reference: PreparedFrame) -> float:
    """By how much a frame is to be brighter to be as bright as a reference; both have an image."""
    blocks, wanted = frame.brightness, reference.brightness
    assert blocks is not None
    assert wanted is not None
    return float(np.median((wanted + 1) / (blocks + 1)))


def brightened(image: ByteArray, gain: float) -> ByteArray:
    """An image (h, w) times a gain, if that differs much from 1."""
    if abs(gain - 1) < MIN_BRIGHTNESS_CHANGE:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


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
