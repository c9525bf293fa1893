"""Which of the points of a frame become landmarks."""

import numpy as np

from saccade.attention.contrast import contrast_saliency
from saccade.attention.symmetry import SymmetryConfig, symmetry_saliency
from saccade.pyramid import FloatMap
from saccade.types import Float32Array, FloatArray, Image, IntArray
from saccade.visual.config import VisualConfig
from saccade.visual.frontend import Followed

FARTHEST = 100.0
"""Pixels from other landmarks beyond which a point stands as free as any."""


def attend(image: Image, config: VisualConfig) -> FloatMap | None:
    """Saliency (h, w) of an image, None where the choice does not ask for it."""
    if config.selection == "contrast":
        return contrast_saliency(image).saliency
    if config.selection == "symmetry":
        return symmetry_saliency(image, SymmetryConfig()).saliency
    return None


def preference(
    points: Followed,
    range_share: FloatArray,
    saliency: FloatMap | None,
    shape: tuple[int, int],
    taken: Float32Array,
    config: VisualConfig,
    frame: int,
) -> IntArray:
    """In which order points are wanted.

    Args:
        points: n points that are followed.
        range_share: (n,) deviation of the range, as a share of it.
        saliency: what `attend` gave.
        shape: (H, W) of the image.
        taken: (k, 2) pixels of landmarks in view.
        config: how to choose.
        frame: its number; what is left to chance is the same in every run.

    Returns:
        (n,) indices, the most wanted first; equally wanted ones in random order.
    """
    chance = np.random.default_rng((config.seed, frame)).permutation(len(points))
    points = points[chance]
    if config.selection == "proven-spread":
        return chance[farthest_first(points.xy, proof(points), taken)]
    if config.selection == "strength":
        wanted = points.response.astype(np.float64)
    elif config.selection == "range":
        wanted = -range_share[chance]
    elif config.selection == "proven":
        wanted = proof(points)
    elif config.selection == "proven-range":
        wanted = proof(points) * (1 - range_share[chance] / (2 * config.range_share))
    elif saliency is not None:
        wanted = saliency_at(saliency, points.xy, shape)
    else:
        wanted = np.zeros(len(points))
    return chance[np.argsort(-wanted, kind="stable")]


def proof(points: Followed) -> FloatArray:
    """(n,) probability with which each point is known again by its looks.

    The mean of the belief (Beta distribution) that is left of an even one by how often it was
    looked for while it was followed, and found.
    """
    return np.asarray((points.proven + 1) / (points.rehearsed + 2))


def farthest_first(xy: Float32Array, worth: FloatArray, taken: Float32Array) -> IntArray:
    """Points in such an order that each is far from those before it and from others.

    Args:
        xy: (n, 2) pixels.
        worth: (n,) factors by which distances count.
        taken: (k, 2) pixels of the others.

    Returns:
        (n,) indices.
    """
    apart = np.hypot(*(xy[:, None] - xy).astype(np.float64).transpose(2, 0, 1))  # (n, n)
    free = np.full(len(xy), FARTHEST)
    if len(taken):
        others = np.hypot(*(xy[:, None] - taken).astype(np.float64).transpose(2, 0, 1))
        free = np.minimum(free, others.min(1))
    order: list[int] = []
    left = np.ones(len(xy), np.bool_)
    for _ in range(len(xy)):
        i = int(np.argmax(np.where(left, free * worth, -1.0)))
        order.append(i)
        left[i] = False
        free = np.minimum(free, apart[i])
    return np.asarray(order, np.int64)


def saliency_at(saliency: FloatMap, xy: Float32Array, shape: tuple[int, int]) -> FloatArray:
    """(n,) saliency at pixels (n, 2) of an image of a shape (H, W)."""
    rows, columns = saliency.shape
    column = ((xy[:, 0] + 0.5) * columns / shape[1]).astype(np.int64).clip(0, columns - 1)
    row = ((xy[:, 1] + 0.5) * rows / shape[0]).astype(np.int64).clip(0, rows - 1)
    found: FloatArray = saliency[row, column].astype(np.float64)
    return found
