"""Calibrated geometry: pixels and depth on one side, range and bearing on the other."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.frames import Camera
from saccade.types import Float32Array, FloatArray

NEAREST = 0.05
"""Metres along the optical axis within which nothing is looked at."""


class RangeBearings(NamedTuple):
    """Points of one frame as the map knows them: range and bearing in the robot's frame."""

    z: FloatArray
    """(k, 2) metres over the ground, radians to the left of ahead."""
    covariance: FloatArray
    """(k, 2, 2) of `z`."""
    height: FloatArray
    """(k,) metres above the robot's origin."""


def from_pixels(camera: Camera, xy: FloatArray, depth: FloatArray) -> FloatArray:
    """Where points are in the robot's frame.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis.

    Returns:
        (k, 3) metres ahead, to the left and up.
    """
    return camera.position + (directions(camera, xy) * depth[:, None]) @ camera.rotation.T


def to_pixels(camera: Camera, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the camera sees points of the robot's frame.

    Args:
        camera: the calibration.
        points: (k, 3) metres ahead, to the left and up.

    Returns:
        (k, 2) pixels, and (k,) metres along the optical axis; what is nearer than `NEAREST`,
        or behind the camera, has NaN for pixels.
    """
    seen = (points - camera.position) @ camera.rotation
    depth = seen[:, 2]
    safe = np.where(depth > NEAREST, depth, np.nan)
    xy = np.stack(
        [camera.cx + camera.fx * seen[:, 0] / safe, camera.cy + camera.fy * seen[:, 1] / safe], 1
    )
    return xy, depth


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


def depth_of(camera: Camera, disparity: FloatArray) -> FloatArray:
    """(k,) metres along the optical axis of disparities (k,) in pixels; NaN where not over 0."""
    return np.asarray(camera.fx * camera.baseline / np.where(disparity > 0, disparity, np.nan))


def range_bearing(
    camera: Camera, xy: FloatArray, depth: FloatArray, pixel_sigma: float, depth_sigma: FloatArray
) -> RangeBearings:
    """What the map sees of points whose depth is known, with its covariance to first order.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis.
        pixel_sigma: standard deviation of a pixel, each way.
        depth_sigma: (k,) metres.

    Returns:
        Range from the robot's origin over the ground, bearing, and height.
    """
    points = from_pixels(camera, xy, depth)
    x, y = points[:, 0], points[:, 1]
    reach = np.maximum(np.hypot(x, y), NEAREST)
    z = np.stack([reach, np.arctan2(y, x)], 1)
    by_point = np.stack(
        [np.stack([x / reach, y / reach], 1), np.stack([-y, x], 1) / reach[:, None] ** 2], 1
    )  # (k, 2, 2)
    across, down, along = (
        camera.rotation[:2, 0] / camera.fx,
        camera.rotation[:2, 1] / camera.fy,
        (directions(camera, xy) @ camera.rotation.T)[:, :2],
    )
    spread = np.stack(
        [
            depth[:, None] * across * pixel_sigma,
            depth[:, None] * down * pixel_sigma,
            along * depth_sigma[:, None],
        ],
        2,
    )  # (k, 2, 3) a standard deviation of each pixel coordinate and of the depth, on the ground
    root = by_point @ spread
    return RangeBearings(z, root @ root.transpose(0, 2, 1), points[:, 2])


def subset(seen: RangeBearings, index: npt.NDArray[Any]) -> RangeBearings:
    """Those of k sightings that an index or a mask names."""
    return RangeBearings(seen.z[index], seen.covariance[index], seen.height[index])


def directions(camera: Camera, xy: FloatArray) -> FloatArray:
    """(k, 3) in the camera's frame, one metre along the optical axis."""
    across, down = (xy[:, 0] - camera.cx) / camera.fx, (xy[:, 1] - camera.cy) / camera.fy
    return np.stack([across, down, np.ones(len(xy))], 1)
