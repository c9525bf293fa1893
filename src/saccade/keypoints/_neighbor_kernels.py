"""Nearest neighbors from blocks of distances of descriptors."""

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

LANES = 128
"""Number of running minima of a row, which the compiler updates as vectors."""


@kernel()
def update_neighbors(
    distances: Float32Array,
    first_column: int,
    first_row: int,
    nearest: npt.NDArray[np.int32],
    distance: Float32Array,
    second_distance: Float32Array,
    reverse: IntArray,
    reverse_distance: Float32Array,
) -> None:
    """Updates the nearest neighbors, both ways, with a block of squared distances, in one pass.

    Args:
        distances: (r, c) of r descriptors from c others.
        first_column: index of the first column, written to `reverse`.
        first_row: index of the first row, written to `nearest`.
        nearest: (c,) nearest row so far of each column.
        distance: (c,) its distance.
        second_distance: (c,) distance of the second nearest row so far.
        reverse: (r,) nearest column so far of each row.
        reverse_distance: (r,) its distance.
    """
    lanes = np.empty(LANES, np.float32)
    for row in range(len(distances)):
        index = np.int32(first_row + row)
        _update_columns(distances[row], index, nearest, distance, second_distance)
        least = _least(distances[row], lanes)
        if least < reverse_distance[row]:
            reverse_distance[row] = least
            reverse[row] = first_column + _first(distances[row], least)


@kernel(fastmath=("nnan", "nsz"))
def _update_columns(
    distances: Float32Array,
    row: np.int32,
    nearest: npt.NDArray[np.int32],
    distance: Float32Array,
    second_distance: Float32Array,
) -> None:
    for k in range(len(distances)):
        d, best = distances[k], distance[k]
        nearest[k] = row if d < best else nearest[k]
        second_distance[k] = min(second_distance[k], max(d, best))
        distance[k] = min(d, best)


@kernel(fastmath=("nnan", "nsz"))
def _least(values: Float32Array, lanes: Float32Array) -> np.float32:
    """Minimum of values; `lanes` is overwritten."""
    lanes[:] = np.inf
    for start in range(0, len(values), len(lanes)):
        part = values[start : start + len(lanes)]
        for k in range(len(part)):
            lanes[k] = min(lanes[k], part[k])
    least = np.float32(lanes[0])
    for k in range(1, len(lanes)):
        least = min(least, lanes[k])
    return least


@kernel()
def _first(values: Float32Array, value: np.float32) -> int:
    """Index of the first element that equals a value."""
    for k in range(len(values)):
        if values[k] == value:
            return k
    return -1
