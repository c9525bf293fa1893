"""Points followed from frame to frame: by the tracks of a drive, or in its images."""

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera, Frame, Tracks
from saccade.types import FloatArray, Image
from saccade.visual.optical_flow import track_points
from saccade.visual.prepared_frame import gray_bytes

Grey: TypeAlias = npt.NDArray[np.uint8]
WIDEST = 800
"""Pixels; wider images are made smaller first."""
CORNERS = 300
"""Points that are looked for in an image."""
APART = 9
"""Pixels between two of them."""
FAR = 2.0
"""Pixels of disparity below which a range is no help."""


@dataclass(frozen=True, eq=False)
class Points:
    """The points of one frame."""

    xy: FloatArray
    """(k, 2) pixels."""
    depth: FloatArray
    """(k,) metres along the optical axis, NaN where not known."""
    disparity: FloatArray
    """(k,) pixels, NaN where not known."""
    rows_apart: FloatArray
    """(k,) pixels by which the right image has it lower, NaN where not known."""
    id: npt.NDArray[np.int64] | None = None
    """(k,) of tracks."""


@dataclass(frozen=True, eq=False)
class PreparedFrame:
    """A frame as it is looked at: grey, and no wider than `WIDEST`."""

    grey: Grey | None = None
    """(h, w)."""
    right: Grey | None = None
    """(h, w) of the right camera."""
    depth: FloatArray | None = None
    """(h, w) metres."""
    tracks: Tracks | None = None
    """In pixels of the whole image."""

    @classmethod
    def of(cls, frame: Frame, shrink: int) -> "PreparedFrame":
        """A frame, its images made smaller by a whole number."""
        depth = None if frame.depth is None else frame.depth[::shrink, ::shrink]
        left, right = (
            None if image is None else _small(image, shrink) for image in (frame.image, frame.right)
        )
        return cls(left, right, depth, frame.tracks)


def shrink_factor(camera: Camera) -> int:
    """By how much the images of a camera are made smaller."""
    return -(-camera.width // WIDEST)


def shrunk(camera: Camera, by: int) -> Camera:
    """The camera of images that are smaller by a whole number."""
    middle = (by - 1) / 2
    return replace(
        camera,
        width=camera.width // by,
        height=camera.height // by,
        fx=camera.fx / by,
        fy=camera.fy / by,
        cx=(camera.cx - middle) / by,
        cy=(camera.cy - middle) / by,
    )


def _small(image: Image, by: int) -> Grey:
    grey = gray_bytes(image)
    if by > 1:
        height, width = (side // by for side in grey.shape)
        whole = grey[: height * by, : width * by]
        smaller = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(smaller, np.uint8)
    return grey


def points_of(view: PreparedFrame, camera: Camera) -> Points | None:
    """Points of a frame that may be followed; None where it shows none.

    Args:
        view: of the frame.
        camera: of the view.
    """
    if view.tracks is not None:
        return _of_tracks(view.tracks, camera)
    if view.grey is None:
        return None
    corners: Any = cv2.goodFeaturesToTrack(view.grey, CORNERS, 0.003, APART)
    if corners is None:
        return None
    xy = np.asarray(corners, np.float64).reshape(-1, 2)
    nothing = np.full(len(xy), np.nan)
    disparity, rows, depth = nothing, nothing, nothing
    if view.depth is not None:
        column, row = np.rint(xy).astype(np.int64).T
        depth = view.depth[row, column]
    elif view.right is not None and view.right.shape == view.grey.shape:
        there, good = track_points(view.grey, view.right, xy.astype(np.float32))
        disparity = np.where(good, xy[:, 0] - there[:, 0], np.nan)
        rows = np.where(good, there[:, 1] - xy[:, 1], np.nan)
        depth = depth_of(disparity, camera)
    return Points(xy, depth, disparity, rows)


def match_points(
    first: Points, views: tuple[PreparedFrame, PreparedFrame], second: Points | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where points of one frame are in the next.

    Args:
        first: points of the first frame.
        views: of both frames.
        second: those of the next, where they are tracks.

    Returns:
        (k, 2) places here and (k, 2) there, and (k,) depths here.
    """
    if first.id is not None:
        if second is None or second.id is None:
            return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
        _, here, there = np.intersect1d(first.id, second.id, return_indices=True)
        return first.xy[here], second.xy[there], first.depth[here]
    one, other = (view.grey for view in views)
    if one is None or other is None or one.shape != other.shape:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    xy, good = track_points(one, other, first.xy.astype(np.float32))
    return first.xy[good], xy[good].astype(np.float64), first.depth[good]


def depth_of(disparity: FloatArray, camera: Camera) -> FloatArray:
    """Metres of points with a disparity in pixels; NaN where it is too small to say."""
    near = np.where(disparity > FAR, disparity, np.nan)
    return np.asarray(camera.fx * camera.baseline / near if camera.baseline else near * np.nan)


def _of_tracks(tracks: Tracks, camera: Camera) -> Points:
    nothing = np.full(len(tracks), np.nan)
    depth = depth_of(tracks.disparity, camera)
    return Points(tracks.xy, depth, tracks.disparity, nothing, tracks.id)
