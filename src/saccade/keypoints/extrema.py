"""Scale-space extrema, localized to a fraction of a sample."""

from typing import NamedTuple

import numpy as np

from saccade.keypoints._extrema_kernels import find_local_extrema, fit_extrema, mark_duplicates
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.workspace import SERIAL, Workspace
from saccade.types import Float32Array, FloatArray, IntArray

EXTREMA_ROW_BLOCK = 64
"""Number of rows in the block of a thread."""
DUPLICATE_RADIUS = 0.5
"""Largest distance, in samples and planes, of two positions of one extremum."""


class Extrema(NamedTuple):
    """Extrema of one octave, in its samples and planes."""

    xy: Float32Array
    """(n, 2)."""
    scale: FloatArray
    """(n,) position between the planes."""
    value: Float32Array
    """(n,) D at the extremum (B.6)."""


def find_extrema(
    dog: Float32Array, config: SiftConfig, threshold: float, workspace: Workspace = SERIAL
) -> Extrema:
    """Extrema of an octave with enough contrast, not on edges.

    Args:
        dog: (s + 2, h, w) differences of Gaussians, or other responses.
        config: border, candidates, fit and edge ratio.
        threshold: tau_c, the smallest |D| at the extremum (B.6).
        workspace: its threads share the rows.

    Returns:
        The extrema by plane, row and column.

    Source: Lowe (2004), sections 3.1 and 4; equations B.4-B.10.
    """
    height, width = dog.shape[1:]
    border, neighbors, refit = config.border, config.neighbors, config.fit != "once"
    sample_threshold, lagrange = threshold * config.candidate_fraction, config.fit == "lagrange"
    found = {-1: (np.empty((0, 3), np.int64), np.empty((0, 3)), np.empty(0))}

    def search(block: slice) -> None:
        rows = border + block.start, border + block.stop
        capacity = len(dog) * (block.stop - block.start) * width  # pages of it are used as needed
        samples = np.empty((capacity, 3), np.int64)
        count = find_local_extrema(dog, sample_threshold, border, neighbors, *rows, samples)
        samples, offsets, values = samples[:count].copy(), np.empty((count, 3)), np.empty(count)
        fit_extrema(
            *(dog, border, threshold, config.edge_ratio, lagrange, refit, neighbors < 26),
            *(samples, offsets, values),
        )
        kept = values != 0
        found[block.start] = samples[kept], offsets[kept], values[kept]

    workspace.run_in_blocks(search, max(height - 2 * border, 0), EXTREMA_ROW_BLOCK)
    parts = zip(*(found[row] for row in sorted(found)), strict=True)
    samples, offsets, values = map(np.concatenate, parts)
    position = samples + offsets[:, ::-1]  # (n, 3) plane, row and column
    if refit:
        kept = without_duplicates(position, offsets)
    else:
        kept = np.flatnonzero(((position >= 0) & (position <= np.array(dog.shape) - 1)).all(1))
    xy, scale = position[kept, :0:-1].astype(np.float32), position[kept, 0]
    return Extrema(xy, scale, values[kept].astype(np.float32))


def without_duplicates(position: FloatArray, offsets: FloatArray) -> IntArray:
    """Which extrema to keep, by plane, row and column.

    Several candidates around an extremum lead to positions close together. The position with the
    smallest offset from its candidate is kept; this choice is invariant to rotations of the image.

    Args:
        position: (n, 3) plane, row and column of the extrema.
        offsets: (n, 3) of these from their candidates.
    """
    by_row = np.argsort(position[:, 1])
    distance = np.abs(offsets).max(axis=1, initial=0)[by_row]
    duplicate = np.zeros(len(position), np.bool_)
    mark_duplicates(position[by_row], distance, DUPLICATE_RADIUS, duplicate)
    kept = by_row[~duplicate]
    plane, row, column = np.rint(position[kept]).T
    return kept[np.lexsort((column, row, plane))]
