"""Which of the points of a frame become landmarks."""

import numpy as np

from saccade.attention.contrast import contrast_saliency
from saccade.attention.symmetry import SymmetryConfig, symmetry_saliency
from saccade.pyramid import FloatMap
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints
from saccade.visual.config import VisualConfig


def attend(image: Image, config: VisualConfig) -> FloatMap | None:
    """Saliency (h, w) of an image, None where the choice does not ask for it."""
    if config.selection == "contrast":
        return contrast_saliency(image).saliency
    if config.selection == "symmetry":
        return symmetry_saliency(image, SymmetryConfig()).saliency
    return None


def preference(
    points: Keypoints,
    range_share: FloatArray,
    saliency: FloatMap | None,
    shape: tuple[int, int],
    config: VisualConfig,
    frame: int,
) -> IntArray:
    """In which order points are wanted.

    Args:
        points: n points.
        range_share: (n,) deviation of the range, as a share of it.
        saliency: what `attend` gave.
        shape: (H, W) of the image.
        config: how to choose.
        frame: its number; a choice at random is the same in every run.

    Returns:
        (n,) indices, the most wanted first.
    """
    if config.selection == "strength":
        wanted = points.response.astype(np.float64)
    elif config.selection == "range":
        wanted = -range_share
    elif saliency is not None:
        wanted = saliency_at(saliency, points.xy, shape)
    else:
        wanted = np.random.default_rng((config.seed, frame)).random(len(points))
    return np.argsort(-wanted, kind="stable")


def saliency_at(saliency: FloatMap, xy: Float32Array, shape: tuple[int, int]) -> FloatArray:
    """(n,) saliency at pixels (n, 2) of an image of a shape (H, W)."""
    rows, columns = saliency.shape
    column = ((xy[:, 0] + 0.5) * columns / shape[1]).astype(np.int64).clip(0, columns - 1)
    row = ((xy[:, 1] + 0.5) * rows / shape[0]).astype(np.int64).clip(0, rows - 1)
    found: FloatArray = saliency[row, column].astype(np.float64)
    return found
