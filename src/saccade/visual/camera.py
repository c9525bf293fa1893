"""Camera geometry: projection, and range-bearing observations with their covariances."""

from dataclasses import replace

import numpy as np

from saccade.frames import Camera, directions
from saccade.types import BoolArray, Float32Array, FloatArray
from saccade.visual.config import VisualConfig
from saccade.visual.points import RangeBearings, TrackedPoints

MIN_DEPTH = 0.05
"""Minimum depth of a projected point, in meters along the optical axis."""
UNKNOWN_DEPTH_SIGMA = 30.0
"""Relative standard deviation of the depth of a bearing-only observation."""


def reduced_camera(camera: Camera, reduction: int) -> Camera:
    """Calibration of images reduced by an integer factor (see `reduced_image`)."""
    center = (reduction - 1) / 2
    return replace(
        camera,
        width=camera.width // reduction,
        height=camera.height // reduction,
        fx=camera.fx / reduction,
        fy=camera.fy / reduction,
        cx=(camera.cx - center) / reduction,
        cy=(camera.cy - center) / reduction,
    )


def from_pixels(camera: Camera, xy: FloatArray, depth: FloatArray) -> FloatArray:
    """Back-projection of pixels (k, 2) at depths (k,): (k, 3) meters in the robot's frame."""
    return camera.position + (directions(camera, xy) * depth[:, None]) @ camera.rotation.T


def to_pixels(camera: Camera, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projection of points (k, 3) in the robot's frame: pixels (k, 2) and depths (k,) in meters.

    Pixels are NaN for points behind the camera or nearer than `MIN_DEPTH`.
    """
    in_camera = (points - camera.position) @ camera.rotation
    depth = in_camera[:, 2]
    safe = np.where(depth > MIN_DEPTH, depth, np.nan)
    x, y = camera.fx * in_camera[:, 0] / safe, camera.fy * in_camera[:, 1] / safe
    return np.stack([camera.cx + x, camera.cy + y], 1), depth


def move_pixels(
    camera: Camera, pose: tuple[FloatArray, FloatArray], xy: Float32Array, depth: FloatArray
) -> Float32Array:
    """Pixels (k, 2) after a motion of the camera, from pixels (k, 2) at depths (k,) in meters.

    Unknown depths (NaN) count as infinite. Points behind the camera keep their pixels.
    """
    R, t = pose
    inverse_depth = np.nan_to_num(1 / depth)
    ray = directions(camera, xy.astype(np.float64)) @ R.T + inverse_depth[:, None] * t
    ahead = np.where(ray[:, 2] > MIN_DEPTH, ray[:, 2], np.nan)
    moved = ray[:, :2] / ahead[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return np.where(np.isfinite(moved), moved, xy).astype(np.float32)


def is_inside(
    camera: Camera, xy: FloatArray | Float32Array, border: float | FloatArray = 0.0
) -> BoolArray:
    """(k,) whether pixels (k, 2) are in the image, at least `border` pixels from its edge."""
    x, y = xy.T
    inside = (x >= border) & (x <= camera.width - 1 - border)
    return np.asarray(inside & (y >= border) & (y <= camera.height - 1 - border))


def range_bearing(
    camera: Camera,
    xy: FloatArray,
    depth: FloatArray,
    depth_sigma: FloatArray,
    config: VisualConfig,
    tilt: float,
) -> RangeBearings:
    """Observations of pixels (k, 2) at depths (k,) in meters, with first-order covariances.

    `tilt` is the standard deviation of roll and pitch in radians. Tilt displaces points above or
    below the camera.
    """
    points = from_pixels(camera, xy, depth)
    x, y, above = points[:, 0], points[:, 1], points[:, 2] - camera.position[2]
    r = np.maximum(np.hypot(x, y), MIN_DEPTH)
    J = np.stack([np.stack([x / r, y / r], 1), np.stack([-y, x], 1) / r[:, None] ** 2], 1)
    R = camera.rotation[:2]
    sigma = config.pixel_sigma
    by_u = depth[:, None] * (R[:, 0] / camera.fx) * sigma
    by_v = depth[:, None] * (R[:, 1] / camera.fy) * sigma
    by_depth = (directions(camera, xy) @ camera.rotation.T)[:, :2] * depth_sigma[:, None]
    root = J @ np.stack([by_u, by_v, by_depth], 2)  # (k, 2, 2) @ (k, 2, 3)
    covariance = root @ root.transpose(0, 2, 1)
    covariance[:, 0, 0] += np.square(tilt * above)
    covariance[:, 1, 1] += np.square(tilt * above / r)
    return RangeBearings(np.stack([r, np.arctan2(y, x)], 1), covariance, points[:, 2])


def observe(
    camera: Camera, points: TrackedPoints, config: VisualConfig, tilt: float
) -> tuple[RangeBearings, BoolArray]:
    """Observations of k points, and (k,) whether each range is certain and within its limits."""
    depth, sigma = (np.nan_to_num(each, nan=1.0) for each in (points.depth, points.depth_sigma))
    xy = points.xy.astype(np.float64)
    observations = range_bearing(camera, xy, depth, sigma, config, tilt)
    r, range_sigma = observations.z[:, 0], np.sqrt(observations.covariance[:, 0, 0])
    near, far = config.range_limits
    usable = np.isfinite(points.depth) & (r > near) & (r < far)
    return observations, usable & (range_sigma < config.relative_range_sigma * r)


def observe_bearings(
    camera: Camera, points: TrackedPoints, ranges: FloatArray, config: VisualConfig, tilt: float
) -> RangeBearings:
    """Bearing-only observations of k points at assumed ranges (k,) in meters."""
    xy = points.xy.astype(np.float64)
    near, far = (from_pixels(camera, xy, np.full(len(xy), depth)) for depth in (0, 1))
    origin, direction = near[:, :2], (far - near)[:, :2]
    # |origin + depth * direction| = range
    a, b = np.square(direction).sum(1), (origin * direction).sum(1)
    discriminant = np.maximum(b**2 - a * (np.square(origin).sum(1) - ranges**2), 0.0)
    depth = np.maximum(np.sqrt(discriminant) - b, MIN_DEPTH) / np.maximum(a, 1e-12)
    sigma = UNKNOWN_DEPTH_SIGMA * depth
    return range_bearing(camera, xy, depth, sigma, config, tilt)
