"""Relative pose of two cameras from their essential matrix, with its covariance."""

from dataclasses import dataclass

import cv2
import numpy as np

from saccade.keypoints.two_view_fit import derivative
from saccade.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Pose of the second camera: a point X of the first one's frame is `rotation` X + translation.

    The frames of cameras are x right, y down, z ahead.
    """

    rotation: FloatArray
    """(3, 3)."""
    translation: FloatArray
    """(3,) of length 1: two images do not tell how far the camera moved."""
    covariance: FloatArray | None
    """(6, 6) of the rotation vector, in radians along the axes of the second camera, and of
    `translation`; None where the matches do not determine it."""

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation of the rotation in degrees; infinite where it is unknown."""
        return self._sigma(slice(3))

    @property
    def direction_sigma(self) -> float:
        """Standard deviation of the direction of the translation in degrees, likewise."""
        return self._sigma(slice(3, 6))

    def _sigma(self, rows: slice) -> float:
        if self.covariance is None:
            return float("inf")
        return float(np.degrees(np.sqrt(np.trace(self.covariance[rows, rows]))))


def pose_of(
    essential: FloatArray, rays: FloatArray, covariance: FloatArray | None = None
) -> RelativePose:
    """The pose of an essential matrix that has most points in front of both cameras.

    Args:
        essential: (3, 3).
        rays: (m, 4) rows x1, y1, x2, y2, points in the planes z = 1 of the cameras.
        covariance: (9, 9) of the entries of `essential`, row by row.
    """
    *rotations, t = decomposed(essential)
    poses = [(R, sign * t) for R in rotations for sign in (1, -1)]
    R, t = max(poses, key=lambda pose: int(in_front(pose[0], pose[1], rays).sum()))
    if covariance is None:
        return RelativePose(R, t, None)

    def change(entries: FloatArray) -> FloatArray:
        """(6,) rotation vector from R, and translation, of a matrix nearby."""
        *rotations, way = decomposed(entries.reshape(3, 3))
        turn = max((each @ R.T for each in rotations), key=np.trace)
        small = (turn - turn.T)[[2, 0, 1], [1, 2, 0]] / 2
        return np.concatenate([small, way * np.sign(way @ t)])

    J = derivative(change, essential.ravel())
    return RelativePose(R, t, J @ covariance @ J.T)


def decomposed(essential: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The two rotations (3, 3) of an essential matrix and its translation (3,), up to its sign."""
    first, second, t = (np.asarray(each, float) for each in cv2.decomposeEssentialMat(essential))
    return first, second, t.ravel()


def essentials_of_plane(homography: FloatArray) -> list[FloatArray]:
    """The essential matrices of the motions that move a plane by a (3, 3) homography, up to 4."""
    _, rotations, translations, _ = cv2.decomposeHomographyMat(homography, np.eye(3))
    return [
        np.cross(np.eye(3), -np.asarray(t, float).ravel() / np.linalg.norm(t)) @ R
        for R, t in zip(rotations, translations, strict=True)
        if np.linalg.norm(t) > 0
    ]


def in_front(R: FloatArray, t: FloatArray, rays: FloatArray) -> BoolArray:
    """(m,) whether the rays of matches meet in front of both cameras, in a pose (R, t)."""
    ones = np.ones(len(rays))
    first, second = np.c_[rays[:, :2], ones] @ R.T, np.c_[rays[:, 2:], ones]
    normal = np.cross(first, second)
    # a first + t = b second, solved by products with the two rays.
    a = -(np.cross(t, second) * normal).sum(axis=1)
    b = -(np.cross(t, first) * normal).sum(axis=1)
    ahead: BoolArray = (a > 0) & (b > 0)
    return ahead
