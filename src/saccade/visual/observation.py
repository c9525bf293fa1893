"""Range-bearing observations of image points, with their covariances."""

import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray
from saccade.visual.camera import MIN_DEPTH, directions, from_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.optical_flow import BoolArray
from saccade.visual.tables import RangeBearings, TrackedPoints

UNKNOWN_DEPTH_SIGMA = 30.0
"""Standard deviation of the depth of a bearing-only observation, as a fraction of it."""


def range_bearing(
    camera: Camera,
    xy: FloatArray,
    depth: FloatArray,
    depth_sigma: FloatArray,
    config: VisualConfig,
    tilt: float,
) -> RangeBearings:
    """Observations of k points of known depth, their covariance to first order.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis.
        depth_sigma: (k,) metres.
        config: standard deviation of a pixel.
        tilt: standard deviation of roll and pitch in radians, which displace the points that are
            not at the camera's height.
    """
    points = from_pixels(camera, xy, depth)
    x, y, above = points[:, 0], points[:, 1], points[:, 2] - camera.position[2]
    r = np.maximum(np.hypot(x, y), MIN_DEPTH)
    by_point = np.stack(
        [np.stack([x / r, y / r], 1), np.stack([-y, x], 1) / r[:, None] ** 2], 1
    )  # (k, 2, 2)
    R = camera.rotation[:2]
    by_camera = np.stack(
        [
            depth[:, None] * (R[:, 0] / camera.fx) * config.pixel_sigma,
            depth[:, None] * (R[:, 1] / camera.fy) * config.pixel_sigma,
            (directions(camera, xy) @ camera.rotation.T)[:, :2] * depth_sigma[:, None],
        ],
        2,
    )  # (k, 2, 3) on the ground, by one standard deviation of both pixel coordinates and the depth
    root = by_point @ by_camera
    covariance = root @ root.transpose(0, 2, 1)
    covariance[:, 0, 0] += np.square(tilt * above)
    covariance[:, 1, 1] += np.square(tilt * above / r)
    return RangeBearings(np.stack([r, np.arctan2(y, x)], 1), covariance, points[:, 2])


def observe(
    camera: Camera, points: TrackedPoints, config: VisualConfig, tilt: float
) -> tuple[RangeBearings, BoolArray]:
    """Observations of k points, and (k,) which have a range that is in the limits and certain."""
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
    """Bearing-only observations of k points: their depths put them at given ranges (k,)."""
    xy = points.xy.astype(np.float64)
    near, far = (from_pixels(camera, xy, np.full(len(xy), depth)) for depth in (0, 1))
    origin, direction = near[:, :2], (far - near)[:, :2]
    # |origin + depth * direction| = range
    a, b = np.square(direction).sum(1), (origin * direction).sum(1)
    discriminant = np.maximum(b**2 - a * (np.square(origin).sum(1) - ranges**2), 0.0)
    depth = np.maximum(np.sqrt(discriminant) - b, MIN_DEPTH) / np.maximum(a, 1e-12)
    return range_bearing(camera, xy, depth, UNKNOWN_DEPTH_SIGMA * depth, config, tilt)
