"""Motion of a camera between two frames: points, correspondences, and relative pose."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray, IntArray
from saccade.visual.camera import Intrinsics, directions
from saccade.visual.depth import depth_of
from saccade.visual.egomotion import MAX_REPROJECTION_ERROR, CameraPose, perspective_n_point
from saccade.visual.optical_flow import PreparedFrame, track_points
from saccade.visual.tables import Table, column

MAX_CORNERS, CORNER_QUALITY, MIN_SPACING = 300, 0.003, 9
"""Corners in an image, their response as a fraction of the strongest, and pixels between them."""
MIN_DISPARITY = 2.0
"""Pixels from which a disparity gives a depth."""
MIN_POINTS = 12
"""Points from which a motion is estimated."""
STANDSTILL = 0.2
"""Median displacement in pixels of the points of a camera that stands still."""


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
    """(k,) row in the right image less that in the left one in pixels, NaN where unknown."""
    track: IntArray = column(dtype=np.int64)
    """(k,) track ids of the drive, 0 for corners."""


def points_of(prepared: PreparedFrame, camera: Camera) -> FramePoints:
    """The tracks of a frame, or the corners of its image (Shi & Tomasi, 1994)."""
    if (tracks := prepared.frame.tracks) is not None:
        unknown = np.full(len(tracks), np.nan)
        depth = _depth_of(tracks.disparity, camera)
        return FramePoints(tracks.xy, depth, tracks.disparity, unknown, tracks.id)
    if (gray := prepared.left) is None:
        return FramePoints()
    corners: Any = cv2.goodFeaturesToTrack(gray, MAX_CORNERS, CORNER_QUALITY, MIN_SPACING)
    if corners is None:
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


def _depth_of(disparity: FloatArray, camera: Camera) -> FloatArray:
    """(k,) metres; NaN where the disparity is too small, or there is no right camera."""
    usable = (disparity > MIN_DISPARITY) & (camera.baseline > 0)
    return depth_of(camera, np.where(usable, disparity, np.nan))


def match_points(
    first: FramePoints, frames: tuple[PreparedFrame, PreparedFrame], second: FramePoints
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correspondences of two frames, by their tracks or by optical flow.

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


def motion_between(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, bool] | None:
    """Estimate the motion of a camera from k correspondences.

    Args:
        first: (k, 2) pixels in the one frame.
        second: (k, 2) in the next.
        depth: (k,) metres along the optical axis in the first frame, NaN where unknown.
        camera: the calibration.

    Returns:
        Along the robot's axes (ahead, left, up) at the first frame: rotation vector (3,) in
        radians, translation (3,), and whether it is in metres. Without depths it has length 1,
        or 0 at a standstill. None where too few points, or less than a third, agree.
    """
    known = np.isfinite(depth)
    metric = bool(known.sum() >= MIN_POINTS)
    pose: CameraPose | None = None
    if metric:
        points = directions(camera, first[known]) * depth[known, None]
        solution = perspective_n_point(
            camera, points, second[known], method=cv2.SOLVEPNP_ITERATIVE, confidence=0.99
        )
        if solution is not None and _most_agree(solution[2], len(points)):
            pose = solution[:2]
    else:
        pose = _from_directions(first, second, camera)
    if pose is None:
        return None
    R, t = pose
    C = camera.rotation
    rotation = np.asarray(cv2.Rodrigues(C @ R.T @ C.T)[0], np.float64).ravel()
    return rotation, -(C @ R.T @ t), metric


def _from_directions(first: FloatArray, second: FloatArray, camera: Camera) -> CameraPose | None:
    if len(first) < MIN_POINTS:
        return None
    if np.median(np.hypot(*(second - first).T)) < STANDSTILL:
        return np.eye(3), np.zeros(3)
    K = Intrinsics.of(camera).matrix
    E, inliers = cv2.findEssentialMat(first, second, K, cv2.RANSAC, 0.999, MAX_REPROJECTION_ERROR)
    if E is None or E.shape != (3, 3):
        return None
    count, R, t, _ = cv2.recoverPose(E, first, second, K, mask=inliers)
    if not _most_agree(int(count), len(first)):
        return None
    return np.asarray(R, np.float64), np.asarray(t, np.float64).ravel()


def _most_agree(inliers: int, count: int) -> bool:
    return inliers >= MIN_POINTS and inliers > count / 3
