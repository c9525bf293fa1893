"""Adaptive non-maximal suppression: keypoints that are strong and cover the image."""

import numpy as np

from saccade.types import BoolArray, Float32Array, FloatArray, IntArray

ROBUSTNESS = 0.9
"""A point is suppressed only by those of which this fraction exceeds its own response."""
LEAF_SIZE = 256
"""Points among which the nearest is found without a tree."""


def spread_out(xy: FloatArray, response: Float32Array, count: int) -> BoolArray:
    """Keep the points with the largest suppression radii.

    The radius of a point is its distance to the nearest point that is clearly stronger; of equal
    radii those with lower indices are kept. There is no grid: a mirrored or rotated image keeps
    the mirrored or rotated points.

    Args:
        xy: (n, 2) positions.
        response: (n,) in falling order.
        count: number of points to keep.

    Returns:
        (n,) true for `count` points, or for all if there are no more.

    Source: adaptive non-maximal suppression; Brown, Szeliski & Winder (2005), section 3.
    """
    stronger = np.searchsorted(-ROBUSTNESS * response, -response)  # (n,) number of stronger ones
    kept = np.zeros(len(xy), np.bool_)
    kept[np.argsort(-nearest_before(xy, stronger), kind="stable")[:count]] = True
    return kept


def nearest_before(xy: FloatArray, ends: IntArray) -> FloatArray:
    """Distance of each point to the nearest of the first `ends` points.

    The first points are divided into blocks of 2**k, like the binary digits of `ends`: every block
    has one tree, which all points that need it query at once. That takes n log^2 n for any
    responses.

    Args:
        xy: (n, 2) positions.
        ends: (n,) ascending, at most n.

    Returns:
        (n,) distances; infinite where `ends` is 0.
    """
    from scipy.spatial import cKDTree  # half a second that few detections need
    from scipy.spatial.distance import cdist

    n = len(xy)
    nearest = np.full(n, np.inf)
    size = LEAF_SIZE
    while size <= n:
        for start in range(0, n - size + 1, 2 * size):
            query = slice(*np.searchsorted(ends, [start + size, start + 2 * size]))
            if query.start < query.stop:
                distance = cKDTree(xy[start : start + size]).query(xy[query])[0]
                nearest[query] = np.minimum(nearest[query], distance)
        size *= 2
    for start in range(0, n, LEAF_SIZE):  # the lowest digits
        query = slice(*np.searchsorted(ends, [start, start + LEAF_SIZE]))
        distances = cdist(xy[query], xy[start : start + LEAF_SIZE])
        distances[np.arange(start, min(start + LEAF_SIZE, n)) >= ends[query, None]] = np.inf
        nearest[query] = np.minimum(nearest[query], distances.min(axis=1, initial=np.inf))
    return nearest
