"""Points of single frames and their correspondences: tracks of a drive, or corners of images."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from saccade.frames import Camera, Frame
from saccade.types import FloatArray, Image, IntArray
from saccade.visual.depth import depth_of
from saccade.visual.optical_flow import ByteArray, PreparedFrame, gray_bytes, track_points
from saccade.visual.tables import Table, column

MAX_WIDTH = 800
"""Pixels; wider images are shrunk first."""
MAX_CORNERS = 300
MIN_SPACING = 9
"""Pixels between two corners."""
MIN_DISPARITY = 2.0
"""Pixels from which a disparity gives a depth."""


@dataclass(frozen=True, eq=False)
class FramePoints(Table):
    """k points of a frame."""

    xy: FloatArray = column(2)
    """(k, 2) pixels."""
    depth: FloatArray = column()
    """(k,) metres along the optical axis, NaN where unknown."""
    disparity: FloatArray = column()
    """(k,) pixels, NaN where unknown."""
    row_offset: FloatArray = column()
    """(k,) pixels by which the right image has it lower, NaN where unknown."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of the drive, 0 for corners."""


def shrink_factor(camera: Camera) -> int:
    """Whole number by which the images of a camera are shrunk."""
    return -(-camera.width // MAX_WIDTH)


def shrink_camera(camera: Camera, factor: int) -> Camera:
    """The camera of shrunk images."""
    center = (factor - 1) / 2
    return replace(
        camera,
        width=camera.width // factor,
        height=camera.height // factor,
        fx=camera.fx / factor,
        fy=camera.fy / factor,
        cx=(camera.cx - center) / factor,
        cy=(camera.cy - center) / factor,
    )


def shrink_frame(frame: Frame, factor: int) -> PreparedFrame:
    """A frame with shrunk gray images and depths."""
    left, right = (_shrink_image(image, factor) for image in (frame.image, frame.right))
    depth = None if frame.depth is None else frame.depth[::factor, ::factor]
    return PreparedFrame(replace(frame, depth=depth), left, right)


def _shrink_image(image: Image | None, factor: int) -> ByteArray | None:
    if image is None:
        return None
    gray = gray_bytes(image)
    height, width = (side // factor for side in gray.shape)
    if factor > 1:
        whole = gray[: height * factor, : width * factor]
        gray = np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
    return gray


def points_of(prepared: PreparedFrame, camera: Camera) -> FramePoints:
    """The tracks of a frame, or the corners of its image (Shi & Tomasi, 1994).

    Args:
        prepared: the frame.
        camera: of the frame.
    """
    if (tracks := prepared.frame.tracks) is not None:
        unknown = np.full(len(tracks), np.nan)
        depth = _depth_of(tracks.disparity, camera)
        return FramePoints(tracks.xy, depth, tracks.disparity, unknown, tracks.id)
    gray = prepared.left
    corners: Any = None
    if gray is not None:
        corners = cv2.goodFeaturesToTrack(gray, MAX_CORNERS, 0.003, MIN_SPACING)
    if gray is None or corners is None:
        return FramePoints()
    xy = np.asarray(corners, np.float64).reshape(-1, 2)
    depth = disparity = rows = np.full(len(xy), np.nan)
    if prepared.frame.depth is not None:
        column, row = np.rint(xy).astype(np.int64).T
        depth = prepared.frame.depth[row, column]
    elif prepared.right is not None and prepared.right.shape == gray.shape:
        right, tracked = track_points(gray, prepared.right, xy.astype(np.float32))
        disparity = np.where(tracked, xy[:, 0] - right[:, 0], np.nan)
        rows = np.where(tracked, right[:, 1] - xy[:, 1], np.nan)
        depth = _depth_of(disparity, camera)
    return FramePoints(xy, depth, disparity, rows, np.zeros(len(xy), np.int64))


def match_points(
    first: FramePoints, frames: tuple[PreparedFrame, PreparedFrame], second: FramePoints
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correspondences of two frames, by their tracks or by optical flow.

    Args:
        first: points of the first frame.
        frames: both.
        second: points of the second frame.

    Returns:
        (k, 2) pixels in the first and (k, 2) in the second frame, and (k,) depths in the first.
    """
    previous, current = frames
    if previous.frame.tracks is not None and current.frame.tracks is not None:
        _, i, j = np.intersect1d(first.track, second.track, return_indices=True)
        return first.xy[i], second.xy[j], first.depth[i]
    one, other = previous.left, current.left
    if one is None or other is None or one.shape != other.shape:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    xy, tracked = track_points(one, other, first.xy.astype(np.float32))
    return first.xy[tracked], xy[tracked].astype(np.float64), first.depth[tracked]


def _depth_of(disparity: FloatArray, camera: Camera) -> FloatArray:
    """(k,) metres; NaN where the disparity is too small, or there is no right camera."""
    usable = (disparity > MIN_DISPARITY) & (camera.baseline > 0)
    return depth_of(camera, np.where(usable, disparity, np.nan))
