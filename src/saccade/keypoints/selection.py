"""Adaptive non-maximal suppression: keypoints that are strong and cover the image."""

import numpy as np

from saccade.types import Float32Array, FloatArray, IntArray

ROBUSTNESS = 0.9
"""A point is suppressed only by those of which this fraction exceeds its own response."""
FIRST_NEIGHBORS = 8
"""Neighbors that are queried of every point."""


def spread_out(xy: FloatArray, response: Float32Array) -> IntArray:
    """Order of points by falling suppression radius.

    The radius of a point is its distance to the nearest point that is clearly stronger; of equal
    radii the lower index comes first. There is no grid: a mirrored or rotated image keeps
    the mirrored or rotated points.

    Args:
        xy: (n, 2) positions.
        response: (n,) in falling order.

    Returns:
        (n,) indices.

    Source: adaptive non-maximal suppression; Brown, Szeliski & Winder (2005), section 3.
    """
    stronger = np.searchsorted(-ROBUSTNESS * response, -response)  # (n,) number of stronger ones
    return np.argsort(-nearest_before(xy, stronger), kind="stable")


def nearest_before(xy: FloatArray, ends: IntArray) -> FloatArray:
    """Distance of each point to the nearest of the first `ends` points.

    More and more neighbors are queried of those points that have no such neighbor yet.

    Args:
        xy: (n, 2) positions.
        ends: (n,) at most n.

    Returns:
        (n,) distances; infinite where `ends` is 0.
    """
    from scipy.spatial import cKDTree  # half a second that few detections need

    n, neighbors = len(xy), FIRST_NEIGHBORS
    nearest, pending = np.full(n, np.inf), np.flatnonzero(ends)
    tree = cKDTree(xy)
    while len(pending):
        ranks = np.arange(1, min(neighbors, n) + 1)
        distance, index = map(np.asarray, tree.query(xy[pending], ranks))
        before = index < ends[pending, None]
        found, first = before.any(axis=1), before.argmax(axis=1)
        nearest[pending[found]] = distance[found, first[found]]
        pending, neighbors = pending[~found], 4 * neighbors
    return nearest
