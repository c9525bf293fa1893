"""Gradients around interest points: their histogram of directions, and their descriptor.

The kernels of `descriptor`.
"""

from math import ceil, cos, floor, pi, sin
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]
Int32Array: TypeAlias = npt.NDArray[np.int32]

ORIENTATION_BINS = 36
ORIENTATION_SIGMA = 1.5
"""Of the Gaussian weight of a gradient, in scales of the point."""
ORIENTATION_RADIUS = 4.5
"""Half a side of the square around the point, in scales: three sigmas of the weight."""

CELLS = 4
"""Subregions to a side of the descriptor."""
DIRECTIONS = 8
CELL_SIZE = 3.0
"""Side of a subregion, in scales of the point."""
CUT = 0.2
"""No entry of a unit descriptor may be larger: against non-linear changes of light."""
PILE = DIRECTIONS + 1
"""Entries to a subregion while they are filled: the last one belongs to the first."""
STRIP = (CELLS + 2) * PILE
"""Entries to a row of subregions: one more on each side takes what falls outside."""
TINY = 1e-12
"""Less than any length or slope that matters."""

A0, A1, A2 = np.float32(0.99997722), np.float32(-0.33262287), np.float32(0.19354066)
A3, A4, A5 = np.float32(-0.11642722), np.float32(0.05264819), np.float32(-0.01171947)
"""Of the odd polynomial nearest to the arctangent on [0, 1]."""
E2, E3, E4 = np.float32(1 / 2), np.float32(1 / 6), np.float32(1 / 24)
"""Of the exponential."""


@kernel()
def fill_orientation_bins(
    octave: Float32Array,
    planes: IntArray,
    xy: Float32Array,
    sigmas: Float32Array,
    spacing: float,
    linear: bool,
    subpixel: bool,
    room: int,
    bins: Float32Array,
) -> None:
    """Add to (n, 36) `bins` the weighted gradients around each point by direction."""
    samples = np.empty((4, room), np.float32)
    lower, shares = np.empty(room, np.int32), np.empty((2, room), np.float32)
    per_radian = ORIENTATION_BINS / (2 * pi)
    circle = np.empty(ORIENTATION_BINS + 2, np.float32)  # the last two are the first two
    for i in range(len(planes)):
        x, y, sigma = float(xy[i, 0]), float(xy[i, 1]), float(sigmas[i])
        radius = ORIENTATION_RADIUS * sigma
        if not subpixel:
            x, y, radius = round(x), round(y), round(radius)
        stride = max(int(spacing * sigma + 0.5), 1)
        plane = octave[planes[i]]
        count = gather_gradients(plane, x, y, 1 / sigma, 0.0, radius / sigma, stride, samples)
        weight_gradients(samples, count, ORIENTATION_SIGMA, per_radian, float(ORIENTATION_BINS))
        interpolate_directions(samples, count, linear, lower, shares)
        circle[:] = 0
        for k in range(count):
            first = np.uint64(np.uint32(lower[k]))
            circle[first] += shares[0, k]
            circle[first + np.uint64(1)] += shares[1, k]
        for k in range(ORIENTATION_BINS):  # assigning a slice takes seconds to compile
            bins[i, k] = circle[k]
        bins[i, 0] += circle[ORIENTATION_BINS]
        bins[i, 1] += circle[ORIENTATION_BINS + 1]


@kernel()
def smooth_circles(bins: Float32Array, passes: int) -> None:
    """Pass [1 2 1] / 4 over each row of (n, m) `bins`, whose last entry is beside its first."""
    count = bins.shape[1]
    wide = np.empty(count + 2, np.float32)
    quarter, half = np.float32(0.25), np.float32(0.5)
    for i in range(len(bins)):
        for _ in range(passes):
            wide[0], wide[count + 1] = bins[i, count - 1], bins[i, 0]
            for k in range(count):
                wide[k + 1] = bins[i, k]
            for k in range(count):
                bins[i, k] = quarter * (wide[k] + wide[k + 2]) + half * wide[k + 1]


@kernel(fastmath=("nnan", "nsz", "contract"))
def interpolate_directions(
    samples: Float32Array, count: int, linear: bool, lower: Int32Array, shares: Float32Array
) -> None:
    """Find the two bins beside the direction of each sample, and what each of them gets.

    Args:
        samples: (4, room) u, v, direction in bins from 0 to two turns, and weight.
        count: of samples.
        linear: share between both; otherwise the nearest takes it all.
        lower: (room,) takes the lower of the two bins.
        shares: (2, room) takes the shares.
    """
    turn, half = np.float32(ORIENTATION_BINS), np.float32(0.5)
    for k in range(count):
        place, fraction = samples[2, k], samples[3, k]
        place = place - turn if place >= turn else place
        low = np.int32(place) if linear else np.int32(place + half)
        part = fraction * (place - np.float32(low)) if linear else np.float32(0)
        lower[k] = low
        shares[0, k] = fraction - part
        shares[1, k] = part


@kernel()
def fill_descriptors(
    octave: Float32Array,
    planes: IntArray,
    xy: Float32Array,
    sigmas: Float32Array,
    angles: Float32Array,
    window_sigma: float,
    spacing: float,
    subpixel: bool,
    room: int,
    out: Float32Array,
) -> None:
    """Fill (n, 128) `out` with gradients, shared linearly in x, y and direction."""
    samples = np.empty((4, room), np.float32)
    corners, shares = np.empty(room, np.int32), np.empty((8, room), np.float32)
    per_radian = DIRECTIONS / (2 * pi)
    reach = (CELLS + 1) / 2  # how far samples touch a subregion, in subregions
    cells = np.empty((CELLS + 2) * STRIP, np.float32)
    for i in range(len(planes)):
        x, y, angle = float(xy[i, 0]), float(xy[i, 1]), float(angles[i])
        if not subpixel:
            x, y = round(x), round(y)
        cell = CELL_SIZE * sigmas[i]
        stride = max(int(spacing * sigmas[i] + 0.5), 1)
        along, across = cos(angle) / cell, sin(angle) / cell
        count = gather_gradients(octave[planes[i]], x, y, along, across, reach, stride, samples)
        weight_gradients(
            samples, count, CELLS * window_sigma, -per_radian, angle * per_radian + 2 * DIRECTIONS
        )
        interpolate_trilinearly(samples, count, reach, corners, shares)
        cells[:] = 0
        add_weights(corners, shares, count, cells)
        for row in range(CELLS):
            for column in range(CELLS):
                start = (row + 1) * STRIP + (column + 1) * PILE
                cells[start] += cells[start + DIRECTIONS]
                for turn in range(DIRECTIONS):
                    out[i, (row * CELLS + column) * DIRECTIONS + turn] = cells[start + turn]


@kernel(fastmath=("nnan", "nsz", "contract"))
def interpolate_trilinearly(
    samples: Float32Array, count: int, reach: float, corners: Int32Array, shares: Float32Array
) -> None:
    """Find the eight entries around each sample, and what each of them gets.

    Args:
        samples: (4, room) u, v, direction from 0 to 4 turns, and weight.
        count: of samples.
        reach: half a side of the square, in subregions.
        corners: (room,) takes the first entry of the eight.
        shares: (8, room) takes the shares of the entries: first the next direction, then the
            next column, then the next row.
    """
    one, turn = np.float32(1), np.float32(DIRECTIONS)
    shift, last = np.float32(reach), np.float32(2 * reach * (1 - 1e-6))
    for k in range(count):
        column = min(max(samples[0, k] + shift, np.float32(0)), last)
        row = min(max(samples[1, k] + shift, np.float32(0)), last)
        place = samples[2, k]
        place -= turn * np.float32(np.int32(place * (one / turn)))
        r, c, t = np.int32(row), np.int32(column), np.int32(place)
        fr, fc, ft = row - np.float32(r), column - np.float32(c), place - np.float32(t)
        corners[k] = r * np.int32(STRIP) + c * np.int32(PILE) + t
        lower = samples[3, k] * fr
        upper = samples[3, k] - lower
        lower_right, upper_right = lower * fc, upper * fc
        lower_left, upper_left = lower - lower_right, upper - upper_right
        shares[1, k] = upper_left * ft
        shares[0, k] = upper_left - shares[1, k]
        shares[3, k] = upper_right * ft
        shares[2, k] = upper_right - shares[3, k]
        shares[5, k] = lower_left * ft
        shares[4, k] = lower_left - shares[5, k]
        shares[7, k] = lower_right * ft
        shares[6, k] = lower_right - shares[7, k]


@kernel()
def add_weights(corners: Int32Array, shares: Float32Array, count: int, cells: Float32Array) -> None:
    """Add the shares of each sample to the eight entries from its corner."""
    for k in range(count):
        first = np.uint64(np.uint32(corners[k]))
        below = first + np.uint64(STRIP)
        cells[first] += shares[0, k]
        cells[first + np.uint64(1)] += shares[1, k]
        cells[first + np.uint64(PILE)] += shares[2, k]
        cells[first + np.uint64(PILE + 1)] += shares[3, k]
        cells[below] += shares[4, k]
        cells[below + np.uint64(1)] += shares[5, k]
        cells[below + np.uint64(PILE)] += shares[6, k]
        cells[below + np.uint64(PILE + 1)] += shares[7, k]


@kernel()
def gather_gradients(
    plane: Float32Array,
    x: float,
    y: float,
    along: float,
    across: float,
    reach: float,
    stride: int,
    out: Float32Array,
) -> int:
    """Fill columns of (4, room) `out` with the samples in a turned square; return how many.

    The rows are u and v, the place in the frame of the square whose half side is `reach`,
    then the gradient along x and y. Samples lie `stride` apart, evenly about the one that
    is nearest to the point, so that a mirrored patch has the mirrored samples.
    """
    height, width = plane.shape
    middle, center = floor(y + 0.5), floor(x + 0.5)
    least, most = -reach - 1e-6, reach + 1e-6
    extent = most * (abs(along) + abs(across)) / (along * along + across * across)
    first = max(ceil((y - extent - middle) / stride), -((middle - 1) // stride))
    last = min(floor((y + extent - middle) / stride), (height - 2 - middle) // stride)
    count = 0
    for j in range(first, last + 1):
        row = middle + j * stride
        dy = row - y
        left, right = x - extent, x + extent
        if abs(along) > TINY:
            bounds = (least - across * dy) / along, (most - across * dy) / along
            left, right = max(left, x + min(bounds)), min(right, x + max(bounds))
        if abs(across) > TINY:
            bounds = (along * dy - most) / across, (along * dy - least) / across
            left, right = max(left, x + min(bounds)), min(right, x + max(bounds))
        start = max(ceil((left - center) / stride), -((center - 1) // stride))
        stop = min(floor((right - center) / stride), (width - 2 - center) // stride) + 1
        if stop > start:
            columns = slice(center + start * stride, center + (stop - 1) * stride + 1)
            part = out[:, count : count + stop - start]
            u0, v0 = across * dy, along * dy
            if stride == 1:
                gather_row(plane[row - 1 : row + 2], columns, x, u0, v0, along, across, part)
            else:
                for k in range(start, stop):
                    column = center + k * stride
                    dx = np.float32(column - x)
                    part[0, k - start] = np.float32(along) * dx + np.float32(u0)
                    part[1, k - start] = np.float32(v0) - np.float32(across) * dx
                    part[2, k - start] = plane[row, column + 1] - plane[row, column - 1]
                    part[3, k - start] = plane[row + 1, column] - plane[row - 1, column]
            count += stop - start
    return count


@kernel(fastmath=("nsz", "contract"))
def gather_row(
    rows: Float32Array,
    columns: slice,
    x: float,
    u0: float,
    v0: float,
    along: float,
    across: float,
    out: Float32Array,
) -> None:
    """Fill columns of `out` with all samples between two columns of the middle of three rows."""
    first, last = columns.start, columns.stop
    left, right = rows[1, first - 1 : last - 1], rows[1, first + 1 : last + 1]
    above, below = rows[0, first:last], rows[2, first:last]
    u, v, gx, gy = out[0], out[1], out[2], out[3]
    a, b, c, d = np.float32(along), np.float32(across), np.float32(u0), np.float32(v0)
    start = np.float32(first - x)
    for k in range(len(above)):
        dx = start + np.float32(k)
        u[k] = a * dx + c
        v[k] = d - b * dx
        gx[k] = right[k] - left[k]
        gy[k] = below[k] - above[k]


@kernel(fastmath=("nsz", "contract"))
def weight_gradients(
    samples: Float32Array, count: int, window_sigma: float, per_radian: float, offset: float
) -> None:
    """Turn gradients, rows 2 and 3 of `samples`, into place among directions and weight.

    The place is `offset + per_radian * direction`, the weight the gradient's length (B.11-B.12)
    under a Gaussian of u and v. Arctangent and exponential are polynomials, within 2e-6 and
    1e-5: calls per sample took most of the time, and kept the loop from being vectorized.
    """
    half_turn, one = np.float32(pi), np.float32(1)
    scale, shift = np.float32(per_radian), np.float32(offset)
    decay = np.float32(-0.5 / (window_sigma * window_sigma) / 64)
    for k in range(count):
        u, v, dx, dy = samples[0, k], samples[1, k], samples[2, k], samples[3, k]
        wide, high = abs(dx), abs(dy)
        steep = high > wide
        run, rise = (high, wide) if steep else (wide, high)
        slope = rise / run if run > 0 else np.float32(0)
        s = slope * slope
        angle = slope * (A0 + s * (A1 + s * (A2 + s * (A3 + s * (A4 + s * A5)))))
        angle = half_turn / 2 - angle if steep else angle
        angle = half_turn - angle if dx < 0 else angle
        angle = -angle if dy < 0 else angle
        t = decay * (u * u + v * v)
        e = one + t * (one + t * (E2 + t * (E3 + t * E4)))
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e  # exp(t)^64
        samples[2, k] = shift + scale * angle
        samples[3, k] = e * np.sqrt(dx * dx + dy * dy)


@kernel(fastmath=("nsz", "contract", "reassoc", "arcp"))
def normalize(raw: Float32Array, root: bool, length: float) -> None:
    """Bring the rows of (n, d) `raw` to unit length, cut them, and bring them to `length`.

    With `root` the square root of the L1-normalized rows takes the place of the last length.
    """
    tiny, cut, quantum = np.float32(TINY), np.float32(CUT), np.float32(length)
    for i in range(len(raw)):
        row = raw[i]
        square = np.float32(0)
        for k in range(len(row)):
            square += row[k] * row[k]
        limit = cut * np.sqrt(square)  # the cut, before the length is known to be 1
        square, total = np.float32(0), np.float32(0)
        for k in range(len(row)):
            entry = min(row[k], limit)
            square += entry * entry
            total += entry
        scale = quantum / max(np.sqrt(square), tiny)
        if root:
            scale = quantum * quantum / max(total, tiny)
        for k in range(len(row)):
            entry = min(row[k], limit) * scale
            row[k] = np.sqrt(entry) if root else entry
