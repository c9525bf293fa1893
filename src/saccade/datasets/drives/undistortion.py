"""Removes lens distortion, and rectifies stereo pairs."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray, Image


@dataclass(frozen=True, eq=False)
class Lens:
    """Maps the images of a camera with distortion to those of a pinhole camera."""

    matrix: FloatArray
    """(3, 3) intrinsics of the camera with distortion."""
    distortion: tuple[float, ...]
    """k1, k2, p1, p2 and optionally k3 of OpenCV."""
    camera: Camera
    """The pinhole camera."""
    rotation: FloatArray
    """(3, 3) from the frame of the camera with distortion to that of the pinhole camera."""

    @classmethod
    def of(cls, camera: Camera, distortion: tuple[float, ...]) -> "Lens | None":
        """Lens of a camera that keeps its intrinsics; None without distortion."""
        if not any(distortion):
            return None
        return cls(camera_matrix(camera), distortion, camera, np.eye(3))

    def undistort(self, pixels: Image, interpolation: int = cv2.INTER_LINEAR) -> Image:
        """The image of the pinhole camera; black outside the field of view of the lens."""
        return cv2.remap(pixels, *self._maps, interpolation)

    @cached_property
    def _maps(self) -> tuple[Float32Array, Float32Array]:
        size = (self.camera.width, self.camera.height)
        x, y = cv2.initUndistortRectifyMap(
            self.matrix,
            np.array(self.distortion),
            self.rotation,
            camera_matrix(self.camera),
            size,
            cv2.CV_32FC1,
        )
        return np.asarray(x, np.float32), np.asarray(y, np.float32)


def rectify_stereo(
    left: Lens, right: Lens, rotation: FloatArray, translation: FloatArray
) -> tuple[Camera, Lens, Lens]:
    """Rotate two cameras so that epipolar lines are image rows.

    Args:
        left: the left camera; its `camera` has the size and the mounting.
        right: the right one.
        rotation: (3, 3) from the frame of the left camera to that of the right one.
        translation: (3,) metres; position of the left camera in the frame of the right one.

    Returns:
        The rectified camera with its baseline, and both lenses.
    """
    rectification = cv2.stereoRectify(
        left.matrix,
        np.array(left.distortion),
        right.matrix,
        np.array(right.distortion),
        (left.camera.width, left.camera.height),
        rotation,
        translation.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    R1, R2, P1, P2 = (np.asarray(matrix, np.float64) for matrix in rectification[:4])
    camera = pinhole(
        P1,
        (left.camera.width, left.camera.height),
        baseline=float(-P2[0, 3] / P2[0, 0]),
        position=left.camera.position,
        rotation=left.camera.rotation @ R1.T,
    )
    return (
        camera,
        replace(left, camera=camera, rotation=R1),
        replace(right, camera=camera, rotation=R2),
    )


def pinhole(matrix: FloatArray, size: tuple[int, int], **mounting: Any) -> Camera:
    """The camera with a matrix (3, 3) or a projection (3, 4).

    Args:
        matrix: intrinsics in pixels.
        size: width and height in pixels.
        mounting: baseline, position and rotation as those of `Camera`.
    """
    return Camera(
        width=int(size[0]),
        height=int(size[1]),
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]),
        cy=float(matrix[1, 2]),
        **mounting,
    )


def camera_matrix(camera: Camera) -> FloatArray:
    """(3, 3) intrinsics of a camera."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
