"""Motion of a camera between two frames, with its length where depths are known."""

from dataclasses import dataclass

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray
from saccade.visual.camera import Intrinsics, directions
from saccade.visual.egomotion import MAX_REPROJECTION_ERROR, CameraPose, perspective_n_point

MIN_POINTS = 12
"""Points from which a motion is estimated."""
STANDSTILL = 0.2
"""Median displacement in pixels of the points of a camera that stands still."""


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Motion of a camera from one frame to the next, along the robot's axes at the first."""

    rotation: FloatArray
    """(3,) radians about the axes ahead, left and up: roll, pitch (nose down) and yaw."""
    translation: FloatArray
    """(3,) ahead, left and up: metres, or of length 1 without depths, 0 at a standstill."""
    metric: bool
    """Whether the translation is in metres."""


def motion_between(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> CameraMotion | None:
    """Estimate the motion of a camera from k correspondences.

    Args:
        first: (k, 2) pixels in the one frame.
        second: (k, 2) in the next.
        depth: (k,) metres along the optical axis in the first frame, NaN where unknown.
        camera: the calibration.

    Returns:
        None where there are too few points, or most of them agree on no motion.
    """
    known = np.isfinite(depth)
    metric = bool(known.sum() >= MIN_POINTS)
    if metric:
        pose = _from_depths(first[known], second[known], depth[known], camera)
    else:
        pose = _from_directions(first, second, camera)
    if pose is None:
        return None
    R, t = pose
    C = camera.rotation
    rotation = np.asarray(cv2.Rodrigues(C @ R.T @ C.T)[0], np.float64).ravel()
    return CameraMotion(rotation, -(C @ R.T @ t), metric)


def _from_depths(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> CameraPose | None:
    points = directions(camera, first) * depth[:, None]
    solution = perspective_n_point(
        camera, points, second, method=cv2.SOLVEPNP_ITERATIVE, confidence=0.99
    )
    return solution[:2] if solution is not None and _most_agree(solution[2], len(first)) else None


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
