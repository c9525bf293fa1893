"""What a fovea sees: its window sharp, the periphery in coarse pixels."""

import cv2
import numpy as np

from saccade.errors import require
from saccade.frames import Frame
from saccade.types import Image


def foveated_image(frame: Frame) -> Image:
    """The whole view of a frame (H, W) or (H, W, 3), the periphery in coarse pixels.

    Raises:
        ConfigError: the frame has no image.
    """
    require(frame.image is not None, "frame", "an image", repr(frame))
    assert frame.image is not None
    window, periphery = frame.image, frame.periphery
    if periphery is None:
        return window
    height, width = (size * periphery.reduction for size in periphery.image.shape[:2])
    whole = cv2.resize(periphery.image, (width, height), interpolation=cv2.INTER_NEAREST)
    column, row = periphery.corner
    h, w = min(window.shape[0], height - row), min(window.shape[1], width - column)
    whole[row : row + h, column : column + w] = window[:h, :w]
    return np.asarray(whole)
