"""Range-bearing observations of image points, with their covariances."""

from dataclasses import dataclass

import numpy as np

from saccade.frames import Camera
from saccade.types import FloatArray
from saccade.visual.camera import MIN_DEPTH, directions, from_pixels
from saccade.visual.config import VisualConfig
from saccade.visual.optical_flow import BoolArray
from saccade.visual.table import Table, column
from saccade.visual.tracked_points import TrackedPoints

UNKNOWN_DEPTH_SIGMA = 30.0
"""Standard deviation of the depth of a bearing-only observation, as a fraction of it."""


@dataclass(frozen=True, eq=False)
class RangeBearings(Table):
    """k observations in the robot's frame."""

    z: FloatArray = column(2)
    """(k, 2) range over the ground in metres, bearing in radians to the left of ahead."""
    covariance: FloatArray = column(2, 2)
    """(k, 2, 2) of `z`."""
    height: FloatArray = column()
    """(k,) metres above the robot's origin."""


def range_bearing(
    camera: Camera, xy: FloatArray, depth: FloatArray, pixel_sigma: float, depth_sigma: FloatArray
) -> RangeBearings:
    """Observations of points of known depth, their covariance to first order.

    Args:
        camera: the calibration.
        xy: (k, 2) pixels.
        depth: (k,) metres along the optical axis.
        pixel_sigma: standard deviation of a pixel, in each axis.
        depth_sigma: (k,) metres.
    """
    points = from_pixels(camera, xy, depth)
    x, y = points[:, 0], points[:, 1]
    r = np.maximum(np.hypot(x, y), MIN_DEPTH)
    by_point = np.stack(
        [np.stack([x / r, y / r], 1), np.stack([-y, x], 1) / r[:, None] ** 2], 1
    )  # (k, 2, 2)
    R = camera.rotation[:2]
    by_camera = np.stack(
        [
            depth[:, None] * (R[:, 0] / camera.fx) * pixel_sigma,
            depth[:, None] * (R[:, 1] / camera.fy) * pixel_sigma,
            (directions(camera, xy) @ camera.rotation.T)[:, :2] * depth_sigma[:, None],
        ],
        2,
    )  # (k, 2, 3) on the ground, by one standard deviation of both pixel coordinates and the depth
    root = by_point @ by_camera
    z = np.stack([r, np.arctan2(y, x)], 1)
    return RangeBearings(z, root @ root.transpose(0, 2, 1), points[:, 2])


def observe(
    camera: Camera, points: TrackedPoints, config: VisualConfig, tilt: float
) -> tuple[RangeBearings, BoolArray]:
    """Observations of k points, and (k,) which have a range that is in the limits and certain.

    Args:
        camera: the calibration.
        points: k points.
        config: standard deviations and limits.
        tilt: standard deviation of roll and pitch in radians, which displace the points that are
            not at the camera's height.
    """
    observations = _observe(
        camera, points, np.nan_to_num(points.depth, nan=1.0),
        np.nan_to_num(points.depth_sigma, nan=1.0), config, tilt,
    )  # fmt: skip
    r, sigma = observations.z[:, 0], np.sqrt(observations.covariance[:, 0, 0])
    near, far = config.range_limits
    usable = np.isfinite(points.depth) & (r > near) & (r < far)
    return observations, usable & (sigma < config.relative_range_sigma * r)


def observe_bearings(
    camera: Camera, points: TrackedPoints, ranges: FloatArray, config: VisualConfig, tilt: float
) -> RangeBearings:
    """Bearing-only observations of k points: their depths put them at given ranges (k,)."""
    near, far = (
        from_pixels(camera, points.xy.astype(np.float64), np.full(len(points), s)) for s in (0, 1)
    )
    origin, direction = near[:, :2], (far - near)[:, :2]
    # |origin + depth * direction| = range
    a, b = np.square(direction).sum(1), (origin * direction).sum(1)
    discriminant = np.maximum(b**2 - a * (np.square(origin).sum(1) - ranges**2), 0.0)
    depth = np.maximum(np.sqrt(discriminant) - b, MIN_DEPTH) / np.maximum(a, 1e-12)
    return _observe(camera, points, depth, UNKNOWN_DEPTH_SIGMA * depth, config, tilt)


def _observe(
    camera: Camera,
    points: TrackedPoints,
    depth: FloatArray,
    depth_sigma: FloatArray,
    config: VisualConfig,
    tilt: float,
) -> RangeBearings:
    xy = points.xy.astype(np.float64)
    observations = range_bearing(camera, xy, depth, config.pixel_sigma, depth_sigma)
    above = observations.height - camera.position[2]
    observations.covariance[:, 0, 0] += np.square(tilt * above)
    observations.covariance[:, 1, 1] += np.square(tilt * above / observations.z[:, 0])
    return observations
