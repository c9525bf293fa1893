"""Pinhole projection between pixels and points in the robot's frame."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray

MIN_DEPTH = 0.05
"""Metres along the optical axis; nearer points are not projected."""


class Intrinsics(NamedTuple):
    """Focal lengths and principal point, in pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of(cls, camera: Camera) -> "Intrinsics":
        """Those of a camera."""
        return cls(camera.fx, camera.fy, camera.cx, camera.cy)

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


def directions(camera: Camera, xy: FloatArray) -> FloatArray:
    """(k, 3) rays of pixels (k, 2) in the camera's frame, of depth 1."""
    x, y = (xy[:, 0] - camera.cx) / camera.fx, (xy[:, 1] - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(len(xy))], 1)


def from_pixels(camera: Camera, xy: FloatArray, depth: FloatArray) -> FloatArray:
    """Back-projection: points in the robot's frame.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis.

    Returns:
        (k, 3) metres ahead, to the left and up.
    """
    return camera.position + (directions(camera, xy) * depth[:, None]) @ camera.rotation.T


def to_pixels(camera: Camera, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projection of points in the robot's frame.

    Args:
        camera: the calibration.
        points: (k, 3) metres ahead, to the left and up.

    Returns:
        (k, 2) pixels, NaN for points behind the camera or nearer than `MIN_DEPTH`; and (k,)
        metres along the optical axis.
    """
    in_camera = (points - camera.position) @ camera.rotation
    depth = in_camera[:, 2]
    safe = np.where(depth > MIN_DEPTH, depth, np.nan)
    x, y = camera.fx * in_camera[:, 0] / safe, camera.fy * in_camera[:, 1] / safe
    return np.stack([camera.cx + x, camera.cy + y], 1), depth


def is_inside(
    camera: Camera, xy: FloatArray | Float32Array, border: float | FloatArray = 0.0
) -> npt.NDArray[np.bool_]:
    """(k,) whether pixels (k, 2) are in the image and not in its border; NaN are not."""
    return np.asarray(
        (xy[:, 0] >= border)
        & (xy[:, 0] <= camera.width - 1 - border)
        & (xy[:, 1] >= border)
        & (xy[:, 1] <= camera.height - 1 - border)
    )
