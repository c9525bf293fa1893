"""Motion between two images: of points, and of the whole image as the camera moves it."""

import cv2
import numpy as np

from saccade.types import BoolArray, Float32Array, FloatArray

WINDOW = (15, 15)
"""Pixels around a point whose motion is that of the point."""
CORNERS, QUALITY, SPACING = 200, 0.01, 8
"""Points from which the motion of the camera is estimated: their number, the quality by that of the
best, and the distance between them in pixels."""
RANSAC_DISTANCE = 1.0
"""Pixels within which a point moves with the camera."""
TILES, MIN_TILES = 4, 5
"""Tiles along each side of the image, and in how many of them points have to move with the camera:
a single object lies in fewer."""


def tracked(
    before: Float32Array, now: Float32Array, points: Float32Array
) -> tuple[Float32Array, BoolArray]:
    """Where points of an image have moved to, and which were found (pyramidal Lucas-Kanade).

    Args:
        before: (H, W) in [0, 1].
        now: the same, later.
        points: (n, 2) x and y in pixels.

    Returns:
        (n, 2) and (n,).
    """
    first, second = (np.rint(image * 255).astype(np.uint8) for image in (before, now))
    after, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, points.copy(), winSize=WINDOW)
    return np.asarray(after, np.float32), np.asarray(found, np.bool_).ravel()


def camera_motion(before: Float32Array, now: Float32Array) -> FloatArray:
    """(3, 3) similarity by which most corners of an image have moved, in homogeneous pixels.

    It is the identity where too few corners agree, or all of them lie close together: what moves
    before a uniform background does not move the camera. Arguments as for `tracked`.
    """
    corners = np.asarray(cv2.goodFeaturesToTrack(before, CORNERS, QUALITY, SPACING), np.float32)
    points = corners.reshape(-1, 2) if corners.ndim == 3 else np.zeros((0, 2), np.float32)
    if len(points) < MIN_TILES:
        return np.eye(3)
    after, found = tracked(before, now, points)
    points, after = points[found], after[found]
    if len(points) < MIN_TILES:
        return np.eye(3)
    similarity, inliers = cv2.estimateAffinePartial2D(
        points, after, ransacReprojThreshold=RANSAC_DISTANCE
    )
    tiles = np.floor(points[np.ravel(inliers) == 1] * TILES / before.shape[::-1])
    if len(np.unique(tiles, axis=0)) < MIN_TILES:
        return np.eye(3)
    return np.vstack([similarity, [0, 0, 1]])


def moved(
    image: Float32Array,
    motion: FloatArray,
    shape: tuple[int, ...],
    onto: Float32Array | None = None,
) -> Float32Array:
    """An image after a motion.

    Args:
        image: (h, w).
        motion: (3, 3), homogeneous, in pixels of the same image at a shape (H, W).
        shape: (H, W).
        onto: (h, w) where no pixel comes to lie; None for the image.
    """
    y, x = (h / H for h, H in zip(image.shape, shape, strict=True))
    scaling = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])
    rescaled = (scaling @ motion @ np.linalg.inv(scaling))[:2]
    under = (image if onto is None else onto).copy()
    size = image.shape[1], image.shape[0]
    result = cv2.warpAffine(image, rescaled, size, under, borderMode=cv2.BORDER_TRANSPARENT)
    return np.asarray(result, np.float32)
