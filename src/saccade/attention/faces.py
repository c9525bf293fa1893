"""Faces as a map: people look at faces before most else.

The model knows boxes, not how they are found: a detector is any function from an image to boxes,
such as those of `saccade.face_detection`.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from saccade.errors import ImageError
from saccade.scale.pyramid import FloatMap
from saccade.types import FloatArray, Image

FaceDetector: TypeAlias = Callable[[Image], FloatArray]
"""From an image to (n, 4) boxes: left, top, width and height in pixels."""

SPREAD = 0.35
"""Standard deviation of the Gaussian of a face, as a fraction of each side of its box."""


def face_map(boxes: FloatArray, image_shape: tuple[int, int], shape: tuple[int, int]) -> FloatMap:
    """A Gaussian at each face, of 1 at its center; the highest where they overlap.

    Args:
        boxes: (n, 4) left, top, width and height in pixels of the image; n may be 0.
        image_shape: (H, W) of the image.
        shape: (h, w) of the map, whose cells tile the image.

    Returns:
        (h, w) float32 in [0, 1].

    Raises:
        ImageError: the boxes are not finite numbers of shape (n, 4), or without area.
    """
    boxes = np.asarray(boxes, np.float64).reshape(-1, 4) if np.size(boxes) else np.zeros((0, 4))
    if not (np.isfinite(boxes).all() and (boxes[:, 2:] > 0).all()):
        raise ImageError("faces: expected finite boxes of left, top, width and height above 0")
    (rows, columns), (height, width) = shape, image_shape
    y = (np.arange(rows) + 0.5) * (height / rows)  # (h,) centers of the cells in pixels
    x = (np.arange(columns) + 0.5) * (width / columns)
    faces = np.zeros(shape)
    for left, top, across, down in boxes:
        along_y = np.exp(-(((y - top - down / 2) / (SPREAD * down)) ** 2) / 2)
        along_x = np.exp(-(((x - left - across / 2) / (SPREAD * across)) ** 2) / 2)
        faces = np.maximum(faces, np.outer(along_y, along_x))
    return faces.astype(np.float32)
