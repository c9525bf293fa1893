"""Keypoints in the stored pixels of a file, for programs that ignore its EXIF orientation.

`read_image` rotates images upright, while COLMAP and hloc use the stored pixels.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from saccade.io.image import TURNS
from saccade.types import FloatArray, Keypoints

UPRIGHT = 1
"""EXIF orientation of an upright image."""


def stored_shape(shape: tuple[int, ...], orientation: int) -> tuple[int, int]:
    """(H, W) of the stored pixels, from the upright shape (H, W, ...)."""
    height, width = (int(side) for side in shape[:2])
    return (width, height) if TURNS[orientation - 1][1] % 2 else (height, width)


def to_stored(shape: tuple[int, ...], orientation: int) -> FloatArray:
    """(3, 3) homogeneous transform from upright pixels to stored pixels.

    Args:
        shape: (H, W, ...) of the upright image.
        orientation: EXIF orientation of the file, 1 to 8.
    """
    height, width = stored_shape(shape, orientation)
    mirrored, turns = TURNS[orientation - 1]
    upright = np.diag([-1.0, 1.0, 1.0]) if mirrored else np.eye(3)
    upright[0, 2] = width - 1 if mirrored else 0
    for _ in range(turns):
        upright = np.array([[0, 1, 0], [-1, 0, width - 1], [0, 0, 1]]) @ upright
        height, width = width, height
    return np.linalg.inv(upright)


def stored_keypoints(points: Keypoints, shape: tuple[int, ...], orientation: int) -> Keypoints:
    """Keypoints transformed to stored pixels; descriptors do not change."""
    if orientation == UPRIGHT:
        return points
    return _moved_keypoints(points, to_stored(shape, orientation))


def upright_keypoints(points: Keypoints, shape: tuple[int, ...], orientation: int) -> Keypoints:
    """Keypoints transformed from stored pixels to an upright image of a shape (H, W, ...)."""
    if orientation == UPRIGHT:
        return points
    back = np.asarray(np.linalg.inv(to_stored(shape, orientation)), np.float64)
    return _moved_keypoints(points, back)


def _moved_keypoints(points: Keypoints, moved: FloatArray) -> Keypoints:
    """Keypoints after a rigid motion or reflection (3, 3) of the image."""
    direction = moved[:2, :2] @ np.stack([np.cos(points.angle), np.sin(points.angle)])
    return replace(
        points,
        xy=(points.xy @ moved[:2, :2].T + moved[:2, 2]).astype(np.float32),
        angle=np.arctan2(direction[1], direction[0]).astype(np.float32),
    )


def orientation_of(name: str, orientations: Mapping[str, int] | None) -> int:
    """The EXIF orientation of an image; upright if not given."""
    return (orientations or {}).get(name, UPRIGHT)
