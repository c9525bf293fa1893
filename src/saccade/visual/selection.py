"""Selection of landmarks among tracked points.

By default points are ranked by their re-match rate while tracked, weighted by the certainty of
their range. Only the selections "contrast" and "symmetry" compute saliency.
"""

import numpy as np

from saccade.attention.contrast import contrast_saliency
from saccade.attention.symmetry import SymmetryConfig, symmetry_saliency
from saccade.types import BoolArray, Float32Array, FloatArray, Image, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.points import RangeBearings, TrackedPoints

SYMMETRY = SymmetryConfig(
    kind="isotropic",
    channels="gray",
    levels=(0, 1, 2, 3),
    level_weights=(1.0, 1.0, 1.0, 1.0),
    map_level=1,
    viewing_size=None,
)
"""Settings of the symmetry pyramid; a point is ranked by the level of its own scale."""
DISC_RADIUS = 2.5
"""Radius of the symmetry of a point, in units of its scale, as in MUST."""


def saliency_at(image: Image | None, points: TrackedPoints, config: VisualConfig) -> FloatArray:
    """Saliency (k,) at points; 0 without an image, or if the selection does not use saliency.

    Contrast is sampled in the saliency map, symmetry in the pyramid level whose pixel pairs cover
    `DISC_RADIUS` scales of the point.
    """
    saliency = np.zeros(len(points))
    if image is None or config.selection not in ("contrast", "symmetry"):
        return saliency
    if config.selection == "contrast":
        return sample_saliency(contrast_saliency(image).saliency, image.shape, points.xy)
    maps = symmetry_saliency(image, SYMMETRY).levels
    disc = DISC_RADIUS * np.maximum(points.size, 1) / 2
    level = np.rint(np.log2(disc / SYMMETRY.outer)).clip(min(maps), max(maps))
    for number, symmetry in maps.items():
        of_level = level == number
        saliency[of_level] = sample_saliency(symmetry, image.shape, points.xy[of_level])
    return saliency


def sample_saliency(saliency: Float32Array, shape: tuple[int, ...], xy: Float32Array) -> FloatArray:
    """Values (k,) of a map (h, w) at pixels (k, 2) of an image with the given shape."""
    rows, columns = saliency.shape
    column = ((xy[:, 0] + 0.5) * columns / shape[1]).astype(np.int64).clip(0, columns - 1)
    row = ((xy[:, 1] + 0.5) * rows / shape[0]).astype(np.int64).clip(0, rows - 1)
    return np.asarray(saliency[row, column], np.float64)


def select_landmarks(
    points: TrackedPoints,
    observations: RangeBearings,
    usable: BoolArray,
    saliency: FloatArray,
    config: VisualConfig,
    frame: int,
) -> IntArray:
    """Indices (m,) of the k tracked points that become landmarks, best first, at minimum spacing.

    `usable` (k,) are the points with a certain range, `saliency` (k,) is the result of
    `saliency_at`. Candidates with equal scores are ordered by chance, seeded by `frame`.
    """
    tracked, free = points.landmarks, np.flatnonzero(usable & ~points.is_landmark)
    free = free[np.random.default_rng((config.seed, frame)).permutation(len(free))]
    candidates = points[free]
    score = _score(candidates, observations[free], saliency[free], config)
    order = np.argsort(-score, kind="stable")
    capacity = max(0, config.max_tracked - len(tracked))
    count = min(config.new_per_frame * config.detect_interval, capacity)
    return enforce_spacing(points.xy, free[order], tracked.xy, config.min_spacing, count)


def _score(
    points: TrackedPoints, observations: RangeBearings, saliency: FloatArray, config: VisualConfig
) -> FloatArray:
    """Scores (n,) by the selection criterion; higher is better."""
    if config.selection == "strength":
        return points.response.astype(np.float64)
    if config.selection == "rematch-rate-range":
        relative_range_sigma = np.sqrt(observations.covariance[:, 0, 0]) / observations.z[:, 0]
        certainty = 1 - relative_range_sigma / (2 * config.relative_range_sigma)
        return rematch_rate(points) * certainty
    return saliency


def rematch_rate(points: TrackedPoints) -> FloatArray:
    """Probabilities (n,) that points are re-matched by their descriptors.

    Mean of the Beta posterior with a uniform prior, given attempts and re-matches while tracked.
    """
    return np.asarray((points.rematches + 1) / (points.rematch_attempts + 2))


def enforce_spacing(
    xy: Float32Array, order: IntArray, occupied: Float32Array, min_spacing: float, count: int
) -> IntArray:
    """Indices of at most `count` pixels (n, 2), chosen greedily in an order (m,).

    Chosen pixels keep a minimum spacing from each other and from the `occupied` pixels (k, 2).
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
