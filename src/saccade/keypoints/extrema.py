"""Extrema of the differences of Gaussians, to a fraction of a sample."""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel, spread
from saccade.types import Float32Array, FloatArray, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]

REFITS = 5
"""Moves to a neighboring sample before an extremum is given up."""
ROWS_AT_ONCE = 192
"""That a thread searches at a time."""
SEEDS_AT_ONCE = 2048
"""That a thread fits at a time."""
BETWEEN = 1.5
"""Samples by which the quadratic may overshoot an extremum halfway between two."""
TRUSTED = 0.25
"""Samples by which it may move what the quadratic has found."""
REACH = 6
"""Samples on either side of the nearest that refine a place."""
NODES = np.arange(-REACH, REACH + 1)
LAGRANGE = np.array(
    [
        np.poly(np.delete(NODES, i))[::-1] / np.prod(n - np.delete(NODES, i))
        for i, n in enumerate(NODES)
    ]
).T.copy()
"""(13, 13) by power and sample: the polynomial that is 1 at this sample and 0 at the others."""


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
    threads: int = 1,
) -> Extrema:
    """The extrema of an octave that stand out and are no edges.

    Args:
        dog: (s + 2, h, w) differences of Gaussians.
        border: samples at the edge that are not searched, at least 2.
        candidate_threshold: what a sample must exceed to be looked at.
        contrast_threshold: tau_c, the least |D| at the extremum (B.6).
        edge_ratio: tau_r, the greatest ratio of principal curvatures (B.10).
        lagrange: refine the place by the polynomial through 13 samples each way, and keep
            extrema halfway between two samples, of which the quadratics lead to each other.
        threads: how many work at a time.

    Returns:
        Each extremum once, by plane, row and column.

    Source: Lowe (2004), sections 3.1 and 4; equations B.4-B.10.
    """
    seeds = find_seeds(dog, candidate_threshold, border, threads)  # (n, 3) plane, row, column
    count = len(seeds)
    offsets, values = np.empty((count, 3)), np.empty(count)  # (n, 3) x, y, plane

    def fit(block: slice) -> None:
        part = seeds[block], offsets[block], values[block]
        fit_extrema(dog, border, contrast_threshold, edge_ratio, lagrange, *part)

    spread(fit, count, SEEDS_AT_ONCE, threads)
    kept = np.flatnonzero(values)
    # Seeds on either side of an extremum lead to it from both; few lie a third past a sample.
    z, y, x = np.floor(seeds[kept] + offsets[kept][:, ::-1] + 0.37).astype(np.int64).T
    _, first = np.unique((z * dog.shape[1] + y) * dog.shape[2] + x, return_index=True)
    kept = kept[first]
    plane, row, column = seeds[kept].T
    x, y, scale = offsets[kept].T
    return Extrema(
        plane,
        np.stack([column + x, row + y], axis=1).astype(np.float32),
        plane + scale,
        values[kept].astype(np.float32),
    )


def find_seeds(dog: Float32Array, threshold: float, border: int, threads: int) -> IntArray:
    """(n, 3) plane, row and column of the extrema among the samples, in order of rows."""
    height, width = dog.shape[1:]
    searched = max(height - 2 * border, 0)
    found: dict[int, IntArray] = {}

    def search(block: slice) -> None:
        first, last = border + block.start, border + block.stop
        out = np.empty(((last - first) * width // 32 + 64, 3), np.int64)
        count = find_candidates(dog, threshold, border, first, last, out)
        if count > len(out):
            out = np.empty((count, 3), np.int64)
            find_candidates(dog, threshold, border, first, last, out)
        found[first] = out[:count]

    spread(search, searched, ROWS_AT_ONCE, threads)
    return np.concatenate([np.empty((0, 3), np.int64), *(found[row] for row in sorted(found))])


@kernel()
def find_candidates(
    dog: Float32Array, threshold: float, border: int, first: int, last: int, out: IntArray
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
                    if marks[column] and is_extremum(dog, plane, row, column):
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
def is_extremum(dog: Float32Array, plane: int, row: int, column: int) -> bool:
    """Whether a sample lies above or below its 26 neighbors; of equal ones the first does."""
    value = dog[plane, row, column]
    sign = 1 if value > 0 else -1
    before, after = dog[plane - 1, row, column], dog[plane + 1, row, column]
    if sign * (before - value) > 0 or sign * (after - value) > 0:  # most fail here
        return False
    for p in range(plane - 1, plane + 2):
        for r in range(row - 1, row + 2):
            for c in range(column - 1, column + 2):
                rise = sign * (dog[p, r, c] - value)
                if rise > 0 or (rise == 0 and (p, r, c) < (plane, row, column)):
                    return False
    return True


@kernel()
def fit_extrema(
    dog: Float32Array,
    border: int,
    contrast_threshold: float,
    edge_ratio: float,
    lagrange: bool,
    seeds: IntArray,
    offsets: FloatArray,
    values: FloatArray,
) -> None:
    """Move each seed to the sample nearest its extremum; value 0 where there is none to keep."""
    planes, height, width = dog.shape
    edge = edge_ratio + 2 + 1 / edge_ratio  # (tau_r + 1)^2 / tau_r, and for an infinite ratio
    for i in range(len(seeds)):
        plane, row, column = seeds[i]
        before = (plane, row, column)
        values[i] = 0
        for refit in range(REFITS):
            x, y, scale, value, trace, determinant = fit_quadratic(dog, plane, row, column)
            after = (plane + step(scale), row + step(y), column + step(x))
            # Halfway between two samples the quadratic at each may point to the other.
            returned = after == before or refit == REFITS - 1
            between = returned and max(abs(x), abs(y), abs(scale)) < BETWEEN
            if after == (plane, row, column) or (lagrange and between):
                strong = abs(value) >= contrast_threshold  # B.6
                if strong and determinant > 0 and trace * trace < edge * determinant:  # B.10
                    if lagrange:
                        rough = (x, y, scale)
                        x, y, scale = refine_place(dog, plane, row, column, x, y, scale)
                        if after != (plane, row, column) and (x, y, scale) == rough:
                            break
                    seeds[i, 0], seeds[i, 1], seeds[i, 2] = plane, row, column
                    offsets[i, 0], offsets[i, 1], offsets[i, 2] = x, y, scale
                    values[i] = value
                break
            before = (plane, row, column)
            plane, row, column = after
            if not (
                1 <= plane < planes - 1
                and border <= row < height - border
                and border <= column < width - border
            ):
                break


@kernel()
def step(offset: float) -> int:
    """Towards the neighbor that is nearer than this sample, if any."""
    return int(offset > 0.5) - int(offset < -0.5)


@kernel()
def halfway(offset: float) -> float:
    """An offset, but at most half a sample."""
    return min(max(offset, -0.5), 0.5)


@kernel()
def fit_quadratic(
    dog: Float32Array, plane: int, row: int, column: int
) -> tuple[float, float, float, float, float, float]:
    """Where the quadratic through a sample's neighbors is flat, and how it is shaped there.

    Returns:
        Offset in x, y and plane (B.5), value (B.6), trace and determinant of the
        spatial Hessian (B.8-B.9).
    """
    p, r, c = plane, row, column
    v = float(dog[p, r, c])
    gx = 0.5 * (dog[p, r, c + 1] - dog[p, r, c - 1])
    gy = 0.5 * (dog[p, r + 1, c] - dog[p, r - 1, c])
    gs = 0.5 * (dog[p + 1, r, c] - dog[p - 1, r, c])
    xx = dog[p, r, c + 1] - 2 * v + dog[p, r, c - 1]
    yy = dog[p, r + 1, c] - 2 * v + dog[p, r - 1, c]
    ss = dog[p + 1, r, c] - 2 * v + dog[p - 1, r, c]
    xy = 0.25 * (
        dog[p, r + 1, c + 1] - dog[p, r + 1, c - 1] - dog[p, r - 1, c + 1] + dog[p, r - 1, c - 1]
    )
    xs = 0.25 * (
        dog[p + 1, r, c + 1] - dog[p + 1, r, c - 1] - dog[p - 1, r, c + 1] + dog[p - 1, r, c - 1]
    )
    ys = 0.25 * (
        dog[p + 1, r + 1, c] - dog[p + 1, r - 1, c] - dog[p - 1, r + 1, c] + dog[p - 1, r - 1, c]
    )
    x, y, s = newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
    return x, y, s, v + 0.5 * (gx * x + gy * y + gs * s), xx + yy, xx * yy - xy * xy


@kernel()
def refine_place(
    dog: Float32Array, plane: int, row: int, column: int, x: float, y: float, scale: float
) -> tuple[float, float, float]:
    """Where the polynomial through 3x13x13 samples is flat.

    Newton's method (B.5) from the offset given; that comes back where it leads away, and
    where not all of the samples lie in the octave.
    """
    height, width = dog.shape[1:]
    if min(row, column, height - 1 - row, width - 1 - column) < REACH:
        return x, y, scale
    weights_x, weights_y = np.empty((3, len(NODES))), np.empty((3, len(NODES)))
    columns = np.empty((3, len(NODES)))
    start = halfway(x), halfway(y), halfway(scale)
    u, v, t = start
    for _ in range(3):
        lagrange_weights(u, weights_x)
        lagrange_weights(v, weights_y)
        gx = gy = gs = xx = yy = ss = xy = xs = ys = 0.0
        for i in range(3):
            side = i - 1
            at, slope, bend = 0.5 * t * (t + side), t + 0.5 * side, 1.0
            if side == 0:
                at, slope, bend = 1 - t * t, -2 * t, -2.0
            around = dog[
                plane + side, row - REACH : row + REACH + 1, column - REACH : column + REACH + 1
            ]
            level, dx, dy, dxx, dxy, dyy = interpolate(around, weights_x, weights_y, columns)
            gx += at * dx
            gy += at * dy
            gs += slope * level
            xx += at * dxx
            yy += at * dyy
            ss += bend * level
            xy += at * dxy
            xs += slope * dx
            ys += slope * dy
        du, dv, dt = newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
        u, v, t = u + du, v + dv, t + dt
        if not max(abs(u - start[0]), abs(v - start[1]), abs(t - start[2])) < TRUSTED:
            return x, y, scale
    return u, v, t


@kernel(fastmath=("nsz", "contract", "reassoc"))
def interpolate(
    samples: Float32Array, weights_x: FloatArray, weights_y: FloatArray, columns: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """The value and the derivatives x, y, xx, xy and yy of what (n, n) samples hold.

    Args:
        samples: (n, n).
        weights_x: (3, n) what they weigh along a row in value, slope and curvature.
        weights_y: (3, n) the same down a column.
        columns: (3, n) takes value, slope and curvature of every column.
    """
    columns[:] = 0
    for j in range(len(samples)):
        w, dw, ddw = weights_y[0, j], weights_y[1, j], weights_y[2, j]
        for k in range(len(samples)):
            sample = float(samples[j, k])
            columns[0, k] += w * sample
            columns[1, k] += dw * sample
            columns[2, k] += ddw * sample
    level = dx = dy = dxx = dxy = dyy = 0.0
    for k in range(len(samples)):
        w, dw, ddw = weights_x[0, k], weights_x[1, k], weights_x[2, k]
        level += w * columns[0, k]
        dx += dw * columns[0, k]
        dxx += ddw * columns[0, k]
        dy += w * columns[1, k]
        dxy += dw * columns[1, k]
        dyy += w * columns[2, k]
    return level, dx, dy, dxx, dxy, dyy


@kernel(fastmath=("nsz", "contract", "reassoc"))
def lagrange_weights(t: float, out: FloatArray) -> None:
    """Fill (3, 13) `out` with what samples at -6..6 weigh at `t` in the polynomial through them.

    The rows are for its value, slope and curvature.
    """
    value, slope, bend = out[0], out[1], out[2]
    out[:] = 0
    for power in range(len(LAGRANGE) - 1, -1, -1):  # Horner's rule, for the derivatives too
        for node in range(len(value)):
            bend[node] = bend[node] * t + 2 * slope[node]
            slope[node] = slope[node] * t + value[node]
            value[node] = value[node] * t + LAGRANGE[power, node]


@kernel()
def newton_step(
    gx: float,
    gy: float,
    gs: float,
    xx: float,
    yy: float,
    ss: float,
    xy: float,
    xs: float,
    ys: float,
) -> tuple[float, float, float]:
    """-H^-1 g by cofactors of the symmetric H (B.5); not finite where H has no inverse."""
    cxx, cxy, cxs = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    cyy, cys, css = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    whole = xx * cxx + xy * cxy + xs * cxs
    return (
        -(cxx * gx + cxy * gy + cxs * gs) / whole,
        -(cxy * gx + cyy * gy + cys * gs) / whole,
        -(cxs * gx + cys * gy + css * gs) / whole,
    )
