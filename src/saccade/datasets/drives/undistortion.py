"""What a lens bends, made straight."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray, Image


@dataclass(frozen=True, eq=False)
class Lens:
    """How a real camera's images become those of a pinhole camera; its maps are made once."""

    matrix: FloatArray
    """(3, 3) intrinsics of the real camera."""
    distortion: tuple[float, ...]
    """k1, k2, p1, p2 and perhaps k3 of OpenCV."""
    camera: Camera
    """The pinhole camera."""
    rotation: FloatArray
    """(3, 3) turns vectors of the real camera into those of the pinhole camera."""

    @classmethod
    def of(cls, camera: Camera, distortion: tuple[float, ...]) -> "Lens | None":
        """That of a camera which keeps its intrinsics; None where nothing is bent."""
        if not any(distortion):
            return None
        return cls(intrinsics(camera), distortion, camera, np.eye(3))

    def undistort(self, pixels: Image, how: int = cv2.INTER_LINEAR) -> Image:
        """The image of the pinhole camera; black where the real one saw nothing."""
        return cv2.remap(pixels, *self._maps, how)

    @cached_property
    def _maps(self) -> tuple[Float32Array, Float32Array]:
        size = (self.camera.width, self.camera.height)
        x, y = cv2.initUndistortRectifyMap(
            self.matrix,
            np.array(self.distortion),
            self.rotation,
            intrinsics(self.camera),
            size,
            cv2.CV_32FC1,
        )
        return np.asarray(x, np.float32), np.asarray(y, np.float32)


def rectified(
    left: Lens, right: Lens, turned: FloatArray, moved: FloatArray
) -> tuple[Camera, Lens, Lens]:
    """Two cameras turned so that their rows are the same.

    Args:
        left: the left camera; its `camera` says size, place and rotation.
        right: the right one.
        turned: (3, 3) turns vectors of the left camera into the right one's.
        moved: (3,) metres; where the left camera is in the right one's frame.

    Returns:
        The rectified camera with its baseline, and both lenses.
    """
    old = left.camera
    size = (old.width, old.height)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        left.matrix,
        np.array(left.distortion),
        right.matrix,
        np.array(right.distortion),
        size,
        turned,
        moved.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )
    camera = replace(
        old,
        fx=float(P1[0, 0]),
        fy=float(P1[1, 1]),
        cx=float(P1[0, 2]),
        cy=float(P1[1, 2]),
        baseline=float(-P2[0, 3] / P2[0, 0]),
        rotation=old.rotation @ np.asarray(R1, np.float64).T,
    )
    return (
        camera,
        replace(left, camera=camera, rotation=np.asarray(R1, np.float64)),
        replace(right, camera=camera, rotation=np.asarray(R2, np.float64)),
    )


def intrinsics(camera: Camera) -> FloatArray:
    """(3, 3) matrix of a camera."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
