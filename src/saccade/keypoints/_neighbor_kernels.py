"""Nearest neighbors from blocks of products of descriptors."""

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

CHUNK = 256
"""Columns of which the minimum is taken at a time, and searched for its index if it is lower."""


@kernel()
def update_neighbors(
    products: Float32Array,
    column_norms: Float32Array,
    row_norms: Float32Array,
    first_column: int,
    first_row: int,
    nearest: npt.NDArray[np.int32],
    distance: Float32Array,
    second_distance: Float32Array,
    reverse: IntArray,
    reverse_distance: Float32Array,
) -> None:
    """Updates the nearest neighbors, both ways, with a block of products, in one pass.

    Args:
        products: (r, c) products of r descriptors with c others, times -2.
        column_norms: (c,) squared lengths of the others.
        row_norms: (r,) squared lengths.
        first_column: index of the first column, written to `reverse`.
        first_row: index of the first row, written to `nearest`.
        nearest: (c,) nearest row so far of each column.
        distance: (c,) its squared distance.
        second_distance: (c,) squared distance of the second nearest row so far.
        reverse: (r,) nearest column so far of each row.
        reverse_distance: (r,) its squared distance.
    """
    distances = np.empty(len(column_norms), np.float32)
    for row in range(len(row_norms)):
        _fill_distances(products[row], column_norms, row_norms[row], distances)
        index = np.int32(first_row + row)
        _update_columns(distances, index, nearest, distance, second_distance)
        for start in range(0, len(distances), CHUNK):
            chunk = distances[start : start + CHUNK]
            least = chunk.min()
            if least < reverse_distance[row]:
                reverse_distance[row] = least
                reverse[row] = first_column + start + _first(chunk, least)


@kernel()
def _fill_distances(
    products: Float32Array, norms: Float32Array, norm: np.float32, out: Float32Array
) -> None:
    for k in range(len(out)):
        out[k] = products[k] + norms[k] + norm


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


@kernel()
def _first(values: Float32Array, value: np.float32) -> int:
    """Index of the first element that equals a value."""
    for k in range(len(values)):
        if values[k] == value:
            return k
    return -1
