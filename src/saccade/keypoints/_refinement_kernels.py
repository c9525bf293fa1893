"""Where between the samples the extrema of the differences of Gaussians lie.

The kernels of `extrema`.
"""

import numpy as np

from saccade._jit import kernel
from saccade.types import Float32Array, FloatArray, IntArray

REFITS = 5
"""Moves to a neighboring sample before an extremum is given up."""
BETWEEN = 1.5
"""Samples by which the quadratic may overshoot an extremum halfway between two."""
OVERLAP = 0.55
"""Planes by which an extremum may lie outside an octave: two octaves agree to about 0.02."""
TRUSTED = 0.25
"""Samples by which it may move what the quadratic has found."""
REACH = 4
"""Samples on either side of the nearest that refine a place."""
NODES = np.arange(-REACH, REACH + 1)
LAGRANGE = np.array(
    [
        np.poly(np.delete(NODES, i))[::-1] / np.prod(n - np.delete(NODES, i))
        for i, n in enumerate(NODES)
    ]
).T.copy()
"""(9, 9) by power and sample: the polynomial that is 1 at this sample and 0 at the others."""


@kernel()
def fit_extrema(
    dog: Float32Array,
    border: int,
    contrast_threshold: float,
    edge_ratio: float,
    lagrange: bool,
    refit: bool,
    definite: bool,
    seeds: IntArray,
    offsets: FloatArray,
    values: FloatArray,
) -> None:
    """Move each seed to the sample nearest its extremum; value 0 where there is none to keep.

    Without `refit` it stays at its sample wherever the quadratic leads. Where it must be
    `definite` it is none that only has no higher or lower sample beside it.
    """
    planes, height, width = dog.shape
    edge = edge_ratio + 2 + 1 / edge_ratio  # (tau_r + 1)^2 / tau_r, and for an infinite ratio
    for i in range(len(seeds)):
        plane, row, column = seeds[i]
        before = (plane, row, column)
        values[i] = 0
        for attempt in range(REFITS):
            (x, y, scale), value, trace, determinant, solid = fit_quadratic(dog, plane, row, column)
            up = step(scale)
            if lagrange and not 1 <= plane + up < planes - 1 and abs(scale) < OVERLAP:
                up = 0
            after = (plane + up, row + step(y), column + step(x))
            # Halfway between two samples the quadratic at each may point to the other.
            returned = after == before or attempt == REFITS - 1
            between = returned and max(abs(x), abs(y), abs(scale)) < BETWEEN
            if not refit or after == (plane, row, column) or (lagrange and between):
                strong = abs(value) >= contrast_threshold  # B.6
                summit = not definite or max(trace * value, solid * value) < 0
                if (
                    strong and summit and determinant > 0 and trace * trace < edge * determinant
                ):  # B.10
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
) -> tuple[tuple[float, float, float], float, float, float, float]:
    """Where the quadratic through a sample's neighbors is flat, and how it is shaped there.

    Returns:
        Offset in x, y and plane (B.5), value (B.6), trace and determinant of the
        spatial Hessian (B.8-B.9), determinant of the whole Hessian.
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
    x, y, s, solid = newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
    value = v + 0.5 * (gx * x + gy * y + gs * s)
    return (x, y, s), value, xx + yy, xx * yy - xy * xy, solid


@kernel()
def refine_place(
    dog: Float32Array, plane: int, row: int, column: int, x: float, y: float, scale: float
) -> tuple[float, float, float]:
    """Where the polynomial through 3x9x9 samples is flat.

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
    for _ in range(2):
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
        du, dv, dt, _ = newton_step(gx, gy, gs, xx, yy, ss, xy, xs, ys)
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
    """Fill (3, 9) `out` with what samples at -4..4 weigh at `t` in the polynomial through them.

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
) -> tuple[float, float, float, float]:
    """-H^-1 g by cofactors of the symmetric H (B.5), and its determinant.

    Not finite where H has no inverse.
    """
    cxx, cxy, cxs = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
    cyy, cys, css = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
    whole = xx * cxx + xy * cxy + xs * cxs
    return (
        -(cxx * gx + cxy * gy + cxs * gs) / whole,
        -(cxy * gx + cyy * gy + cys * gs) / whole,
        -(cxs * gx + cys * gy + css * gs) / whole,
        whole,
    )
