"""Which of the points of a frame become landmarks."""

import numpy as np

from saccade.attention.contrast import contrast_saliency
from saccade.attention.symmetry import SymmetryConfig, symmetry_saliency
from saccade.pyramid import FloatMap
from saccade.types import Float32Array, FloatArray, Image, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import TrackedPoints

FARTHEST = 100.0
"""Pixels from other landmarks beyond which a point stands as free as any."""


def selection_saliency(image: Image, config: VisualConfig) -> FloatMap | None:
    """Saliency (h, w) of an image, None where the choice does not ask for it."""
    if config.selection == "contrast":
        return contrast_saliency(image).saliency
    if config.selection == "symmetry":
        return symmetry_saliency(image, SymmetryConfig()).saliency
    return None


def rank_candidates(
    points: TrackedPoints,
    relative_range_sigma: FloatArray,
    saliency: FloatMap | None,
    shape: tuple[int, int],
    occupied: Float32Array,
    config: VisualConfig,
    frame: int,
) -> IntArray:
    """In which order points are wanted.

    Args:
        points: n points that are followed.
        relative_range_sigma: (n,) deviation of the range, as a share of it.
        saliency: what `selection_saliency` gave.
        shape: (H, W) of the image.
        occupied: (k, 2) pixels of landmarks in view.
        config: how to choose.
        frame: its number; what is left to chance is the same in every run.

    Returns:
        (n,) indices, the most wanted first; equally wanted ones in random order.
    """
    chance = np.random.default_rng((config.seed, frame)).permutation(len(points))
    points = points[chance]
    if config.selection == "rematch-rate-spread":
        return chance[farthest_first(points.xy, rematch_rate(points), occupied)]
    if config.selection == "strength":
        wanted = points.response.astype(np.float64)
    elif config.selection == "range":
        wanted = -relative_range_sigma[chance]
    elif config.selection == "rematch-rate":
        wanted = rematch_rate(points)
    elif config.selection == "rematch-rate-range":
        wanted = rematch_rate(points) * (
            1 - relative_range_sigma[chance] / (2 * config.relative_range_sigma)
        )
    elif saliency is not None:
        wanted = saliency_at(saliency, points.xy, shape)
    else:
        wanted = np.zeros(len(points))
    return chance[np.argsort(-wanted, kind="stable")]


def rematch_rate(points: TrackedPoints) -> FloatArray:
    """(n,) probability with which each point is known again by its looks.

    The mean of the belief (Beta distribution) that is left of an even one by how often it was
    looked for while it was followed, and found.
    """
    return np.asarray((points.rematches + 1) / (points.rematch_attempts + 2))


def farthest_first(xy: Float32Array, worth: FloatArray, occupied: Float32Array) -> IntArray:
    """Points in such an order that each is far from those before it and from others.

    Args:
        xy: (n, 2) pixels.
        worth: (n,) factors by which distances count.
        occupied: (k, 2) pixels of the others.

    Returns:
        (n,) indices.
    """
    distances = np.hypot(*(xy[:, None] - xy).astype(np.float64).transpose(2, 0, 1))  # (n, n)
    free = np.full(len(xy), FARTHEST)
    if len(occupied):
        others = np.hypot(*(xy[:, None] - occupied).astype(np.float64).transpose(2, 0, 1))
        free = np.minimum(free, others.min(1))
    order: list[int] = []
    left = np.ones(len(xy), np.bool_)
    for _ in range(len(xy)):
        i = int(np.argmax(np.where(left, free * worth, -1.0)))
        order.append(i)
        left[i] = False
        free = np.minimum(free, distances[i])
    return np.asarray(order, np.int64)


def saliency_at(saliency: FloatMap, xy: Float32Array, shape: tuple[int, int]) -> FloatArray:
    """(n,) saliency at pixels (n, 2) of an image of a shape (H, W)."""
    rows, columns = saliency.shape
    column = ((xy[:, 0] + 0.5) * columns / shape[1]).astype(np.int64).clip(0, columns - 1)
    row = ((xy[:, 1] + 0.5) * rows / shape[0]).astype(np.int64).clip(0, rows - 1)
    found: FloatArray = saliency[row, column].astype(np.float64)
    return found
