"""Which points to keep where there are too many: those that are strong and far apart."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.types import Float32Array, FloatArray, IntArray

BoolArray: TypeAlias = npt.NDArray[np.bool_]

ROBUSTNESS = 0.9
"""A point gives way only to those of which this share is more than its own strength."""
LEAF = 256
"""Points among which a nearest one is found without a tree."""


def spread_out(xy: FloatArray, response: Float32Array, count: int) -> BoolArray:
    """Which of some points to keep so that they are strong and cover the image.

    Each point has a radius: how far away the nearest point is that is clearly stronger. The
    points with the greatest radii are kept, of equal ones those with lower indices. There
    is no grid: a mirrored or turned image keeps the mirrored or turned points.

    Args:
        xy: (n, 2) places.
        response: (n,) strengths, falling.
        count: how many to keep.

    Returns:
        (n,) true for `count` points, or for all if there are no more.

    Source: adaptive non-maximal suppression; Brown, Szeliski & Winder (2005), section 3.
    """
    stronger = np.searchsorted(-ROBUSTNESS * response, -response)  # (n,) how many, from the first
    kept = np.zeros(len(xy), np.bool_)
    kept[np.argsort(-nearest_before(xy, stronger), kind="stable")[:count]] = True
    return kept


def nearest_before(xy: FloatArray, ends: IntArray) -> FloatArray:
    """How far each point is from the nearest of the first `ends` points.

    The first of them are cut into blocks of 2**k points, as a number is into binary digits:
    every block has one tree, and all points that need it ask it at once. That takes
    n log^2 n, whatever the strengths are.

    Args:
        xy: (n, 2) places.
        ends: (n,) ascending, at most n.

    Returns:
        (n,) distances; infinite where `ends` is 0.
    """
    from scipy.spatial import cKDTree  # half a second that few detections need
    from scipy.spatial.distance import cdist

    n = len(xy)
    nearest = np.full(n, np.inf)
    size = LEAF
    while size <= n:
        for start in range(0, n - size + 1, 2 * size):
            asking = slice(*np.searchsorted(ends, [start + size, start + 2 * size]))
            if asking.start < asking.stop:
                distance = cKDTree(xy[start : start + size]).query(xy[asking])[0]
                nearest[asking] = np.minimum(nearest[asking], distance)
        size *= 2
    for start in range(0, n, LEAF):  # the lowest digits
        asking = slice(*np.searchsorted(ends, [start, start + LEAF]))
        distances = cdist(xy[asking], xy[start : start + LEAF])
        distances[np.arange(start, min(start + LEAF, n)) >= ends[asking, None]] = np.inf
        nearest[asking] = np.minimum(nearest[asking], distances.min(axis=1, initial=np.inf))
    return nearest
