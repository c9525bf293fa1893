"""Landmark selection: which of the tracked points become landmarks.

Those with the highest re-match rate while tracked, weighted by how certain their range is.
"""

import numpy as np

from saccade.types import BoolArray, Float32Array, FloatArray, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.tables import RangeBearings, TrackedPoints


def select_landmarks(
    points: TrackedPoints,
    observations: RangeBearings,
    usable: BoolArray,
    config: VisualConfig,
    frame: int,
) -> IntArray:
    """Select new landmarks among tracked points, best first, at their minimum spacing.

    Args:
        points: k tracked points.
        observations: of the k points.
        usable: (k,) whether each has a certain range.
        config: spacing and budget.
        frame: number of the frame, part of the seed of the random order of equal candidates.

    Returns:
        (m,) indices of the points.
    """
    tracked, free = points.landmarks, np.flatnonzero(usable & ~points.is_landmark)
    free = free[np.random.default_rng((config.seed, frame)).permutation(len(free))]
    z, covariance = observations.z[free], observations.covariance[free]
    relative_range_sigma = np.sqrt(covariance[:, 0, 0]) / z[:, 0]
    certainty = 1 - relative_range_sigma / (2 * config.relative_range_sigma)
    order = np.argsort(-(rematch_rate(points[free]) * certainty), kind="stable")
    capacity = max(0, config.max_tracked - len(tracked))
    count = min(config.new_per_frame * config.detect_interval, capacity)
    return enforce_spacing(points.xy, free[order], tracked.xy, config.min_spacing, count)


def rematch_rate(points: TrackedPoints) -> FloatArray:
    """(n,) probability that each point is re-matched by its descriptor.

    Mean of the Beta posterior, given attempts and re-matches while tracked and a uniform prior.
    """
    return np.asarray((points.rematches + 1) / (points.rematch_attempts + 2))


def enforce_spacing(
    xy: Float32Array, order: IntArray, occupied: Float32Array, min_spacing: float, count: int
) -> IntArray:
    """Greedy selection of at most `count` pixels (n, 2) in an order (m,), at a minimum spacing.

    Also from `occupied` pixels (k, 2).
    """
    neighbors = [*occupied]
    chosen: list[int] = []
    for i in order.tolist():
        if len(chosen) == count:
            break
        if not neighbors or np.square(np.asarray(neighbors) - xy[i]).sum(1).min() >= min_spacing**2:
            neighbors.append(xy[i])
            chosen.append(i)
    return np.asarray(chosen, np.int64)
