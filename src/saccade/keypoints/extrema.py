"""Scale-space extrema, localized to a fraction of a sample."""

from typing import NamedTuple

import numpy as np

from saccade.keypoints._extrema_kernels import find_local_extrema, fit_extrema, mark_duplicates
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.workspace import SERIAL, Threads
from saccade.types import Float32Array, FloatArray, IntArray

ROW_BLOCK = 64
"""Rows that a thread searches at a time."""
CANDIDATE_BLOCK = 512
"""Candidates that a thread fits at a time."""
DUPLICATE_RADIUS = 0.5
"""Samples and planes within which two positions are one extremum."""


class Extrema(NamedTuple):
    """Extrema of one octave, in its samples and planes."""

    xy: Float32Array
    """(n, 2)."""
    scale: FloatArray
    """(n,) position between the planes."""
    value: Float32Array
    """(n,) D at the extremum (B.6)."""


def find_extrema(
    dog: Float32Array, config: SiftConfig, threshold: float, threads: Threads = SERIAL
) -> Extrema:
    """The extrema of an octave that have contrast and are not on edges.

    Args:
        dog: (s + 2, h, w) differences of Gaussians, or other responses.
        config: border, candidates, fit and edge ratio.
        threshold: tau_c, the smallest |D| at the extremum (B.6).
        threads: share the rows, then the candidates.

    Returns:
        The extrema by plane, row and column.

    Source: Lowe (2004), sections 3.1 and 4; equations B.4-B.10.
    """
    candidates = find_candidates(dog, config, threshold, threads)
    refit, reject_saddles = config.fit != "once", config.neighbors < 26
    offsets, values = np.empty((len(candidates), 3)), np.empty(len(candidates))  # x, y, plane

    def fit(block: slice) -> None:
        fit_extrema(
            dog,
            config.border,
            threshold,
            config.edge_ratio,
            config.fit == "lagrange",
            refit,
            reject_saddles,
            candidates[block],
            offsets[block],
            values[block],
        )

    threads.run_in_blocks(fit, len(candidates), CANDIDATE_BLOCK)
    kept = np.flatnonzero(values)
    if refit:
        kept = kept[without_duplicates(candidates[kept], offsets[kept])]
    else:
        position = candidates[kept] + offsets[kept, ::-1]
        kept = kept[((position >= 0) & (position <= np.array(dog.shape) - 1)).all(1)]
    plane, row, column = candidates[kept].T
    x, y, scale = offsets[kept].T
    return Extrema(
        np.stack([column + x, row + y], axis=1).astype(np.float32),
        plane + scale,
        values[kept].astype(np.float32),
    )


def find_candidates(
    dog: Float32Array, config: SiftConfig, threshold: float, threads: Threads = SERIAL
) -> IntArray:
    """(n, 3) plane, row and column of the local extrema among the samples, by row."""
    height, width = dog.shape[1:]
    border, neighbors = config.border, config.neighbors
    threshold *= config.candidate_fraction
    found: dict[int, IntArray] = {}

    def search(block: slice) -> None:
        rows = border + block.start, border + block.stop
        capacity = len(dog) * (block.stop - block.start) * width  # pages of it are used as needed
        out = np.empty((capacity, 3), np.int64)
        count = find_local_extrema(dog, threshold, border, neighbors, *rows, out)
        found[block.start] = out[:count].copy()

    threads.run_in_blocks(search, max(height - 2 * border, 0), ROW_BLOCK)
    return np.concatenate([np.empty((0, 3), np.int64), *(found[row] for row in sorted(found))])


def without_duplicates(candidates: IntArray, offsets: FloatArray) -> IntArray:
    """Which candidates to keep, by plane, row and column of the extrema that they lead to.

    Candidates on several sides of an extremum lead to it, or closely past it. The one nearest to
    its extremum is kept, which does not depend on how the image is rotated.
    """
    positions = candidates + offsets[:, ::-1]
    by_row = np.argsort(positions[:, 1])
    distance = np.abs(offsets).max(axis=1, initial=0)[by_row]
    duplicate = np.zeros(len(candidates), np.bool_)
    mark_duplicates(positions[by_row], distance, DUPLICATE_RADIUS, duplicate)
    kept = by_row[~duplicate]
    plane, row, column = np.rint(positions[kept]).T
    return kept[np.lexsort((column, row, plane))]
