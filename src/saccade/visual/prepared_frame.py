"""Frames with their images as gray levels."""

from dataclasses import dataclass

import cv2
import numpy as np

from saccade.errors import DriveError
from saccade.frames import Camera, Frame
from saccade.image import as_gray
from saccade.types import Image
from saccade.visual.optical_flow import ByteArray

MIN_CONTRAST = 4.0
"""Standard deviation of the gray levels below which an image is blank."""


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame with its images as gray levels."""

    frame: Frame
    left: ByteArray | None = None
    """(H, W) gray levels; None where there is no image, or a blank one."""
    right: ByteArray | None = None
    """(H, W) of the right camera."""

    @property
    def is_blank(self) -> bool:
        """Whether it has neither an image nor tracks."""
        return self.left is None and self.frame.tracks is None


def prepare_frame(frame: Frame, camera: Camera) -> PreparedFrame:
    """Convert the images of a frame to gray levels.

    Raises:
        DriveError: an image that is not of the size of the calibration.
    """
    if frame.image is None:
        return PreparedFrame(frame)
    gray = gray_bytes(frame.image)
    if gray.shape != (camera.height, camera.width):
        raise DriveError(
            f"frame at {frame.time:.3f} s: expected an image of {camera.width} x {camera.height} "
            f"px as the calibration says, found {gray.shape[1]} x {gray.shape[0]}"
        )
    if cv2.meanStdDev(gray)[1][0, 0] < MIN_CONTRAST:
        return PreparedFrame(frame)
    return PreparedFrame(frame, gray, None if frame.right is None else gray_bytes(frame.right))


def gray_bytes(image: Image) -> ByteArray:
    """(H, W) gray levels of any image."""
    if image.ndim == 2 and image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    return np.rint(as_gray(image) * 255).astype(np.uint8)
