"""How a camera moved between two frames, by the points that both see."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.types import FloatArray

LEAST = 12
"""Points below which nothing is said."""
NEAR = 1.5
"""Pixels by which a point may miss its place."""

STILL = 0.2
"""Pixels by which points move, half of them by less, when the camera stands."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Of a camera from one frame to the next, along the robot's axes at the first."""

    rotation: FloatArray
    """(3,) radians about the axes ahead, left and up: roll, pitch (nose down) and yaw."""
    translation: FloatArray
    """(3,) ahead, left and up: metres, or of length 1 where there is no range, 0 if it stands."""
    metric: bool
    """Whether the way is in metres."""


def motion_between(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> Motion | None:
    """The motion of a camera that saw points here first and there then.

    Args:
        first: (k, 2) pixels in the one frame.
        second: (k, 2) in the next.
        depth: (k,) metres along the optical axis in the first frame, NaN where not known.
        camera: that saw them.

    Returns:
        None where the points do not tell: too few, or no motion on which most of them agree.
    """
    known = np.isfinite(depth)
    if known.sum() >= LEAST:
        found = _by_depth(first[known], second[known], depth[known], camera)
    else:
        found = _by_direction(first, second, camera)
    if found is None:
        return None
    R, t, metric = found
    C = camera.rotation
    turned = C @ R.T @ C.T
    turn = np.asarray(cv2.Rodrigues(turned)[0], np.float64).ravel()
    return Motion(turn, -(C @ R.T @ t), metric)


def _by_depth(
    first: FloatArray, second: FloatArray, depth: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, bool] | None:
    x = (first[:, 0] - camera.cx) / camera.fx * depth
    y = (first[:, 1] - camera.cy) / camera.fy * depth
    there, turn, t, near = cv2.solvePnPRansac(
        np.stack([x, y, depth], 1), second, _matrix(camera), None, reprojectionError=NEAR
    )
    if not there or near is None or not _agree(len(near), len(first)):
        return None
    return np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(t, np.float64).ravel(), True


def _by_direction(
    first: FloatArray, second: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, bool] | None:
    if len(first) < LEAST:
        return None
    if np.median(np.hypot(*(second - first).T)) < STILL:
        return np.eye(3), np.zeros(3), False
    K = _matrix(camera)
    E, near = cv2.findEssentialMat(first, second, K, cv2.RANSAC, 0.999, NEAR)
    if E is None or E.shape != (3, 3):
        return None
    count, R, t, _ = cv2.recoverPose(E, first, second, K, mask=near)
    if not _agree(int(count), len(first)):
        return None
    return np.asarray(R, np.float64), np.asarray(t, np.float64).ravel(), False


def _agree(count: int, of: int) -> bool:
    return count >= LEAST and count > of / 3


def _matrix(camera: Camera) -> npt.NDArray[np.float64]:
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
