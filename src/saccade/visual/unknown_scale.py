"""Visual odometry up to scale: each step gets its length from points triangulated before."""

import numpy as np

from saccade.frames import Camera
from saccade.visual.camera import directions
from saccade.visual.egomotion import Egomotion, robot_motion
from saccade.visual.tables import TrackedPoints

MIN_POINTS = 8
"""Triangulated points from which a length is measured."""
MAX_DEPTH_SIGMA = 0.2
"""Standard deviation of the depths used, as a fraction of them."""
LIMITS = (0.2, 5.0)
"""Least and greatest length of a step over the expected one."""


def keep_scale(
    camera: Camera,
    before: TrackedPoints,
    after: TrackedPoints,
    motion: Egomotion,
    camera_before: Camera | None = None,
) -> Egomotion:
    """The motion with the length that fits the depths of the points in the frame before.

    Every point gives a length of the translation from its depth and its two pixels; the weighted
    median counts, by the parallax of a step. Unchanged where too few points have a depth.
    `camera_before` is the camera as it was turned in the frame before, if it turns.
    """
    known = before.depth_sigma < MAX_DEPTH_SIGMA * before.depth
    _, i, j = np.intersect1d(before.id[known], after.id, return_indices=True)
    if len(i) < MIN_POINTS:
        return motion
    points, depth = before[known].xy[i].astype(np.float64), before[known].depth[i]
    rotated = (directions(camera, points) * depth[:, None]) @ motion.rotation.T
    rays = directions(camera, after.xy[j].astype(np.float64))
    offset, slope = np.cross(rays, rotated), np.cross(rays, motion.translation)
    squared = np.maximum(np.square(slope).sum(1), 1e-12)
    factor = -(offset * slope).sum(1) / squared
    order, weight = np.argsort(factor), np.sqrt(squared) / depth
    share = np.cumsum(weight[order])
    median = float(factor[order[np.searchsorted(share, share[-1] / 2)]])
    if median <= 0:
        return motion
    translation = motion.translation * np.clip(median, *LIMITS)
    control, off_plane, _ = robot_motion(camera, motion.rotation, translation, camera_before)
    return motion._replace(control=control, off_plane=off_plane, translation=translation)
