"""Extrema of an octave: search, subsample localization, duplicates and suppression."""

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray

ADJACENT_OCTAVE_SLACK = np.float32(0.01)
"""Largest fraction by which the first or last plane of an octave may exceed an extremum beside it:
such an extremum lies about half a plane away, and the fit decides."""
MAX_FITS = 5
"""Largest number of quadratic fits for one candidate, at neighboring samples."""
MAX_OVERSHOOT = 1.5
"""Largest offset in samples of an extremum halfway between two samples, by the quadratic."""
OCTAVE_OVERLAP = 0.55
"""Largest distance in planes of an extremum beyond the last sample with two neighbors: two octaves
agree to about 0.02."""
MAX_PEAK_CORRECTION = 0.25
"""Largest correction in samples of the quadratic's extremum by the polynomial."""
POLYNOMIAL_RADIUS = 4
"""Number of samples of the polynomial on either side of the nearest sample."""
NODES = np.arange(-POLYNOMIAL_RADIUS, POLYNOMIAL_RADIUS + 1)
LAGRANGE = np.array(
    [
        np.poly(np.delete(NODES, i))[::-1] / np.prod(n - np.delete(NODES, i))
        for i, n in enumerate(NODES)
    ]
).T.copy()
"""(9, 9) coefficients of the Lagrange polynomials, by power and sample."""


@kernel()
def mark_duplicates(
    positions: FloatArray, distance: FloatArray, radius: float, out: BoolArray
) -> None:
    """Marks duplicates: positions within `radius`, along every axis, of one with less distance.

    The positions, (n, 3) plane, row and column, are sorted by row.
    """
    for i in range(len(positions)):
        plane, row, column = positions[i]
        j = i + 1
        while j < len(positions) and positions[j, 1] - row <= radius:
            if max(abs(positions[j, 0] - plane), abs(positions[j, 2] - column)) <= radius:
                out[j if distance[i] < distance[j] else i] = True
            j += 1


@kernel()
def fill_suppression_radii(xy: FloatArray, ends: IntArray, out: FloatArray) -> None:
    """Fills `out` with squared distances of points to the nearest of the first `ends` points.

    The points are (n, 2); where `ends` is 0 the distance is infinite.
    """
    for i in range(len(xy)):
        out[i] = np.inf
        for j in range(ends[i]):
            dx, dy = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
            out[i] = min(out[i], dx * dx + dy * dy)


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
    """Fills `out` with plane, row and column of the local extrema; returns their number.

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
    """Fills the maximum and the minimum of three rows, column by column."""
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
    """Marks the samples of a row that are extrema among the 9 samples of their plane."""
    for c in range(1, len(samples) - 1):
        v = samples[c]
        highest = max(max(high[c - 1], high[c]), high[c + 1])
        lowest = min(min(low[c - 1], low[c]), low[c + 1])
        out[c] = ((v > min_value) & (v >= highest)) | ((v < -min_value) & (v <= lowest))


@kernel()
def _is_extremum(dog: Float32Array, plane: int, row: int, column: int, neighbors: int) -> bool:
    """Whether a sample is an extremum; among equal samples the first one is."""
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


@kernel()
def fit_extrema(
    dog: Float32Array,
    border: int,
    contrast_threshold: float,
    edge_ratio: float,
    lagrange: bool,
    refit: bool,
    reject_saddles: bool,
    candidates: IntArray,
    offsets: FloatArray,
    values: FloatArray,
) -> None:
    """Localizes the extremum of each candidate; a rejected one gets the value 0.

    A candidate is moved to the sample nearest its extremum; without `refit` it stays.

    Args:
        dog: (s + 2, h, w) differences of Gaussians.
        border: samples at the edge that no extremum may lie in.
        contrast_threshold: tau_c (B.6).
        edge_ratio: tau_r (B.10).
        lagrange: refine by the polynomial through 9 samples per axis, and keep extrema halfway
            between two samples, whose quadratics lead to each other.
        refit: fit again at the neighboring sample if it is nearer to the extremum.
        reject_saddles: reject candidates whose 3x3 Hessian is indefinite.
        candidates: (n, 3) plane, row and column; changed.
        offsets: (n, 3) takes x, y and plane from the sample.
        values: (n,) takes D at the extremum.
    """
    planes, height, width = dog.shape
    edge = edge_ratio + 2 + 1 / edge_ratio  # (tau_r + 1)^2 / tau_r, and for an infinite ratio
    for i in range(len(candidates)):
        plane, row, column = candidates[i]
        before = (plane, row, column)
        values[i] = 0
        for attempt in range(MAX_FITS):
            (x, y, scale), value, trace, determinant, determinant_3d = fit_quadratic(
                dog, plane, row, column
            )
            up = step(scale)
            if lagrange and not 1 <= plane + up < planes - 1 and abs(scale) < OCTAVE_OVERLAP:
                up = 0
            after = (plane + up, row + step(y), column + step(x))
            # The quadratics at two neighboring samples may lead to each other.
            returned = after == before or attempt == MAX_FITS - 1
            halfway = returned and max(abs(x), abs(y), abs(scale)) < MAX_OVERSHOOT
            if not refit or after == (plane, row, column) or (lagrange and halfway):
                strong = abs(value) >= contrast_threshold  # B.6
                no_saddle = not reject_saddles or max(trace * value, determinant_3d * value) < 0
                no_edge = determinant > 0 and trace * trace < edge * determinant  # B.10
                if strong and no_saddle and no_edge:
                    if lagrange:
                        quadratic = (x, y, scale)
                        x, y, scale = refine_position(dog, plane, row, column, x, y, scale)
                        if after != (plane, row, column) and (x, y, scale) == quadratic:
                            break
                    candidates[i, 0], candidates[i, 1], candidates[i, 2] = plane, row, column
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


@kernel(inline=True)
def step(offset: float) -> int:
    """The step to the sample nearest an offset, at most one."""
    return int(offset > 0.5) - int(offset < -0.5)


@kernel(inline=True)
def fit_quadratic(
    dog: Float32Array, plane: int, row: int, column: int
) -> tuple[tuple[float, float, float], float, float, float, float]:
    """The stationary point of the quadratic through a sample's neighbors.

    Returns:
        Offset in x, y and plane (B.5), value (B.6), trace and determinant of the
        spatial Hessian (B.8-B.9), determinant of the 3x3 Hessian.
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
    x, y, s, determinant_3d = _newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
    value = v + 0.5 * (gx * x + gy * y + gs * s)
    return (x, y, s), value, xx + yy, xx * yy - xy * xy, determinant_3d


@kernel(inline=True)
def refine_position(
    dog: Float32Array, plane: int, row: int, column: int, x: float, y: float, scale: float
) -> tuple[float, float, float]:
    """Stationary point of the polynomial through 3x9x9 samples, by Newton's method (B.5).

    The initial offset is returned if the correction is too large, or if samples lie outside the
    octave.
    """
    height, width = dog.shape[1:]
    if min(row, column, height - 1 - row, width - 1 - column) < POLYNOMIAL_RADIUS:
        return x, y, scale
    weights_x, weights_y = np.empty((3, len(NODES))), np.empty((3, len(NODES)))
    columns = np.empty((3, len(NODES)))
    start = (min(max(x, -0.5), 0.5), min(max(y, -0.5), 0.5), min(max(scale, -0.5), 0.5))
    u, v, t = start
    for _ in range(2):
        lagrange_weights(u, weights_x)
        lagrange_weights(v, weights_y)
        gx = gy = gs = xx = yy = ss = xy = xs = ys = 0.0
        for i in range(3):
            side = i - 1
            at, slope, bend = 0.5 * t * (t + side), t + 0.5 * side, 1.0
            if side == 0:
                at, slope, bend = 1 - t * t, -2 * t, -2.0
            samples = dog[
                plane + side,
                row - POLYNOMIAL_RADIUS : row + POLYNOMIAL_RADIUS + 1,
                column - POLYNOMIAL_RADIUS : column + POLYNOMIAL_RADIUS + 1,
            ]
            level, dx, dy, dxx, dxy, dyy = interpolate(samples, weights_x, weights_y, columns)
            gx += at * dx
            gy += at * dy
            gs += slope * level
            xx += at * dxx
            yy += at * dyy
            ss += bend * level
            xy += at * dxy
            xs += slope * dx
            ys += slope * dy
        du, dv, dt, _ = _newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
        u, v, t = u + du, v + dv, t + dt
        if not max(abs(u - start[0]), abs(v - start[1]), abs(t - start[2])) < MAX_PEAK_CORRECTION:
            return x, y, scale
    return u, v, t


@kernel(fastmath=("nsz", "contract", "reassoc"))
def interpolate(
    samples: Float32Array, weights_x: FloatArray, weights_y: FloatArray, columns: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Value and derivatives x, y, xx, xy and yy of the polynomial through (n, n) samples.

    Args:
        samples: (n, n).
        weights_x: (3, n) weights of value, slope and curvature along a row.
        weights_y: (3, n) the same down a column.
        columns: (3, n) takes value, slope and curvature of every column.
    """
    for i in range(3):
        for k in range(len(samples)):
            columns[i, k] = 0
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
    """Fills (3, 9) `out` with the weights of samples at -4..4 in the polynomial at `t`.

    The rows are for value, slope and curvature.
    """
    value, slope, bend = out[0], out[1], out[2]
    for node in range(len(value)):
        value[node] = slope[node] = bend[node] = 0
    for power in range(len(LAGRANGE) - 1, -1, -1):  # Horner's rule, for the derivatives too
        for node in range(len(value)):
            bend[node] = bend[node] * t + 2 * slope[node]
            slope[node] = slope[node] * t + value[node]
            value[node] = value[node] * t + LAGRANGE[power, node]


@kernel()
def _newton_step(
    gx: float,
    gy: float,
    gs: float,
    xx: float,
    yy: float,
    ss: float,
    xy: float,
    xs: float,
    ys: float,
) -> tuple[float, float, float, float]:
    """-H^-1 g by cofactors of the symmetric H (B.5), and its determinant.

    Not finite where H has no inverse.
    """
    cxx, cxy, cxs = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    cyy, cys, css = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    determinant = xx * cxx + xy * cxy + xs * cxs
    return (
        -(cxx * gx + cxy * gy + cxs * gs) / determinant,
        -(cxy * gx + cyy * gy + cys * gs) / determinant,
        -(cxs * gx + cys * gy + css * gs) / determinant,
        determinant,
    )
