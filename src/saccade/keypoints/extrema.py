"""Extrema of the differences of Gaussians, to a fraction of a sample."""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel, run_in_blocks
from saccade.keypoints._refinement_kernels import fit_extrema
from saccade.types import Float32Array, FloatArray, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]

ROWS_AT_ONCE = 64
"""That a thread searches at a time."""
SEEDS_AT_ONCE = 512
"""That a thread fits at a time."""
MEETING = np.float32(0.01)
"""Share of itself by which the plane beyond an octave may exceed an extremum: it lies about
half a plane away then, and the fit decides."""
SAME = 0.5
"""Samples and planes within which two places are one extremum."""


class Extrema(NamedTuple):
    """Extrema of one octave, as its samples count."""

    plane: IntArray
    """(n,) the nearest plane."""
    xy: Float32Array
    """(n, 2)."""
    scale: FloatArray
    """(n,) place between the planes."""
    value: Float32Array
    """(n,) D at the extremum (B.6)."""


def find_extrema(
    dog: Float32Array,
    *,
    border: int,
    candidate_threshold: float,
    contrast_threshold: float,
    edge_ratio: float,
    lagrange: bool,
    refit: bool = True,
    neighbors: int = 26,
    threads: int = 1,
) -> Extrema:
    """The extrema of an octave that stand out and are no edges.

    Args:
        dog: (s + 2, h, w) differences of Gaussians.
        border: samples at the edge that are not searched, at least 2.
        candidate_threshold: what a sample must exceed to be looked at.
        contrast_threshold: tau_c, the least |D| at the extremum (B.6).
        edge_ratio: tau_r, the greatest ratio of principal curvatures (B.10).
        lagrange: refine the place by the polynomial through 9 samples each way, and keep
            extrema halfway between two samples, of which the quadratics lead to each other.
        refit: go on from the neighboring sample while that is nearer to the extremum, and keep
            each extremum once; without it every seed is fitted once, and kept where that leads
            to a place inside of `dog`.
        neighbors: samples that one must not be exceeded by, 26 or 10: the 8 in its plane, and
            of the planes beside it all 18 or 2. Of 10, what the quadratic has for a saddle
            is left out.
        threads: how many work at a time.

    Returns:
        Each extremum, by plane, row and column.

    Source: Lowe (2004), sections 3.1 and 4; equations B.4-B.10.
    """
    seeds = find_seeds(
        dog, candidate_threshold, border, neighbors, threads
    )  # (n, 3) plane, row, column
    count = len(seeds)
    offsets, values = np.empty((count, 3)), np.empty(count)  # (n, 3) x, y, plane

    def fit(block: slice) -> None:
        part = seeds[block], offsets[block], values[block]
        kinds = lagrange, refit, neighbors < 26
        fit_extrema(dog, border, contrast_threshold, edge_ratio, *kinds, *part)

    run_in_blocks(fit, count, SEEDS_AT_ONCE, threads)
    kept = np.flatnonzero(values)
    if refit:
        kept = kept[nearest_of_each(seeds[kept], offsets[kept])]
    else:
        place = seeds[kept] + offsets[kept, ::-1]
        kept = kept[((place >= 0) & (place <= np.array(dog.shape) - 1)).all(1)]
    plane, row, column = seeds[kept].T
    x, y, scale = offsets[kept].T
    return Extrema(
        plane,
        np.stack([column + x, row + y], axis=1).astype(np.float32),
        plane + scale,
        values[kept].astype(np.float32),
    )


def nearest_of_each(seeds: IntArray, offsets: FloatArray) -> IntArray:
    """Which seeds to keep, in order of plane, row and column of what they lead to.

    Seeds on several sides of an extremum lead to it, or closely past it. The one that is
    nearest to where it leads is kept, which does not depend on how the image is turned.
    """
    places = seeds + offsets[:, ::-1]
    by_row = np.argsort(places[:, 1])
    distance = np.abs(offsets).max(axis=1, initial=0)[by_row]
    farther = np.zeros(len(seeds), np.bool_)
    mark_farther(places[by_row], distance, SAME, farther)
    kept = by_row[~farther]
    plane, row, column = np.rint(places[kept]).T
    return kept[np.lexsort((column, row, plane))]


@kernel()
def mark_farther(
    places: FloatArray, distance: FloatArray, radius: float, out: npt.NDArray[np.bool_]
) -> None:
    """Mark of any two places within `radius` along every axis the one of larger distance.

    The places, (n, 3) plane, row and column, are in order of rows.
    """
    for i in range(len(places)):
        plane, row, column = places[i]
        j = i + 1
        while j < len(places) and places[j, 1] - row <= radius:
            if max(abs(places[j, 0] - plane), abs(places[j, 2] - column)) <= radius:
                out[j if distance[i] < distance[j] else i] = True
            j += 1


def find_seeds(
    dog: Float32Array, threshold: float, border: int, neighbors: int, threads: int
) -> IntArray:
    """(n, 3) plane, row and column of the extrema among the samples, in order of rows."""
    height, width = dog.shape[1:]
    searched = max(height - 2 * border, 0)
    found: dict[int, IntArray] = {}

    def search(block: slice) -> None:
        first, last = border + block.start, border + block.stop
        out = np.empty(((last - first) * width // 32 + 64, 3), np.int64)
        count = find_candidates(dog, threshold, border, neighbors, first, last, out)
        if count > len(out):
            out = np.empty((count, 3), np.int64)
            find_candidates(dog, threshold, border, neighbors, first, last, out)
        found[first] = out[:count]

    run_in_blocks(search, searched, ROWS_AT_ONCE, threads)
    return np.concatenate([np.empty((0, 3), np.int64), *(found[row] for row in sorted(found))])


@kernel()
def find_candidates(
    dog: Float32Array,
    threshold: float,
    border: int,
    neighbors: int,
    first: int,
    last: int,
    out: IntArray,
) -> int:
    """Fill `out` with plane, row and column of the extrema; return how many there are.

    Rows from `first` to before `last` are searched, row by row and each in all planes.
    """
    planes, _, width = dog.shape
    least = np.float32(threshold)
    high, low = np.empty(width, np.float32), np.empty(width, np.float32)
    marks = np.zeros((width + 7) // 8 * 8, np.uint8)
    words = marks.view(np.uint64)
    count = 0
    for row in range(first, last):
        for plane in range(1, planes - 1):
            here = dog[plane, row]
            fill_range(dog[plane, row - 1], here, dog[plane, row + 1], high, low)
            mark_peaks(here, high, low, least, marks)
            for word in range(len(words)):
                if words[word] == 0:
                    continue
                for column in range(max(8 * word, border), min(8 * word + 8, width - border)):
                    if marks[column] and is_extremum(dog, plane, row, column, neighbors):
                        if count < len(out):
                            out[count, 0], out[count, 1], out[count, 2] = plane, row, column
                        count += 1
    return count


@kernel(fastmath=("nnan", "nsz"))
def fill_range(
    above: Float32Array,
    here: Float32Array,
    below: Float32Array,
    high: Float32Array,
    low: Float32Array,
) -> None:
    """Fill the highest and the lowest of three rows, column by column."""
    for c in range(len(here)):
        high[c] = max(max(above[c], here[c]), below[c])
        low[c] = min(min(above[c], here[c]), below[c])


@kernel(fastmath=("nnan", "nsz"))
def mark_peaks(
    here: Float32Array, high: Float32Array, low: Float32Array, least: np.float32, out: ByteArray
) -> None:
    """Mark the samples of a row that no neighbor in its plane exceeds: few need the other 18."""
    for c in range(1, len(here) - 1):
        v = here[c]
        highest = max(max(high[c - 1], high[c]), high[c + 1])
        lowest = min(min(low[c - 1], low[c]), low[c + 1])
        out[c] = ((v > least) & (v >= highest)) | ((v < -least) & (v <= lowest))


@kernel()
def is_extremum(dog: Float32Array, plane: int, row: int, column: int, neighbors: int) -> bool:
    """Whether a sample lies above or below its neighbors; of equal ones the first does."""
    value = dog[plane, row, column]
    sign = 1 if value > 0 else -1
    before = sign * (dog[plane - 1, row, column] - value)
    after = sign * (dog[plane + 1, row, column] - value)
    if neighbors < 26:  # where octaves meet each may see the extremum on the other's side
        slack = MEETING * abs(value)
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
