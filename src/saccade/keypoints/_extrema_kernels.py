"""Local extrema among the samples of an octave, and duplicates among the refined ones."""

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray

ADJACENT_OCTAVE_SLACK = np.float32(0.01)
"""Fraction of itself by which the plane beyond an octave may exceed an extremum: it lies about
half a plane away then, and the fit decides."""


@kernel()
def mark_duplicates(
    positions: FloatArray, distance: FloatArray, radius: float, out: BoolArray
) -> None:
    """Mark of any two positions within `radius` along every axis the one of larger distance.

    The positions, (n, 3) plane, row and column, are in order of rows.
    """
    for i in range(len(positions)):
        plane, row, column = positions[i]
        j = i + 1
        while j < len(positions) and positions[j, 1] - row <= radius:
            if max(abs(positions[j, 0] - plane), abs(positions[j, 2] - column)) <= radius:
                out[j if distance[i] < distance[j] else i] = True
            j += 1


@kernel()
def find_local_extrema(
    dog: Float32Array,
    threshold: float,
    border: int,
    neighbors: int,
    first: int,
    last: int,
    out: IntArray,
) -> int:
    """Fill `out` with plane, row and column of the local extrema; return their number.

    Rows from `first` to before `last` are searched, row by row and each in all planes.
    """
    planes, _, width = dog.shape
    min_value = np.float32(threshold)
    high, low = np.empty(width, np.float32), np.empty(width, np.float32)
    marks = np.zeros((width + 7) // 8 * 8, np.uint8)
    words = marks.view(np.uint64)
    count = 0
    for row in range(first, last):
        for plane in range(1, planes - 1):
            samples = dog[plane, row]
            _fill_range(dog[plane, row - 1], samples, dog[plane, row + 1], high, low)
            _mark_peaks(samples, high, low, min_value, marks)
            for word in range(len(words)):
                if words[word] == 0:
                    continue
                for column in range(max(8 * word, border), min(8 * word + 8, width - border)):
                    if marks[column] and _is_extremum(dog, plane, row, column, neighbors):
                        out[count, 0], out[count, 1], out[count, 2] = plane, row, column
                        count += 1
    return count


@kernel(fastmath=("nnan", "nsz"))
def _fill_range(
    above: Float32Array,
    middle: Float32Array,
    below: Float32Array,
    high: Float32Array,
    low: Float32Array,
) -> None:
    """Fill the highest and the lowest of three rows, column by column."""
    for c in range(len(middle)):
        high[c] = max(max(above[c], middle[c]), below[c])
        low[c] = min(min(above[c], middle[c]), below[c])


@kernel(fastmath=("nnan", "nsz"))
def _mark_peaks(
    samples: Float32Array,
    high: Float32Array,
    low: Float32Array,
    min_value: np.float32,
    out: npt.NDArray[np.uint8],
) -> None:
    """Mark the samples of a row that no neighbor in its plane exceeds: few need the other 18."""
    for c in range(1, len(samples) - 1):
        v = samples[c]
        highest = max(max(high[c - 1], high[c]), high[c + 1])
        lowest = min(min(low[c - 1], low[c]), low[c + 1])
        out[c] = ((v > min_value) & (v >= highest)) | ((v < -min_value) & (v <= lowest))


@kernel()
def _is_extremum(dog: Float32Array, plane: int, row: int, column: int, neighbors: int) -> bool:
    """Whether a sample lies above or below its neighbors; of equal ones the first does."""
    value = dog[plane, row, column]
    sign = 1 if value > 0 else -1
    before = sign * (dog[plane - 1, row, column] - value)
    after = sign * (dog[plane + 1, row, column] - value)
    if neighbors < 26:  # where octaves meet each may have the extremum beyond its last plane
        slack = ADJACENT_OCTAVE_SLACK * abs(value)
        before -= slack if plane == 1 else np.float32(0)
        after -= slack if plane == len(dog) - 2 else np.float32(0)
    if before >= 0 or after > 0:  # most fail here
        return False
    for p in range(plane - 1, plane + 2):
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                if p != plane and (neighbors < 26 or (r == row and c == column)):
                    continue
                rise = sign * (dog[p, r, c] - value)
                if rise > 0 or (rise == 0 and (p, r, c) < (plane, row, column)):
                    return False
    return True
