"""Gradients around keypoints: orientation histograms and SIFT descriptors."""

from math import ceil, cos, floor, pi, sin
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

Int32Array: TypeAlias = npt.NDArray[np.int32]

ORIENTATION_BINS = 36
ORIENTATION_SIGMA = 1.5
"""Standard deviation of the Gaussian window, in scales of the keypoint."""
ORIENTATION_RADIUS = 4.5
"""Half a side of the square around the keypoint, in scales: three sigmas of the window."""

CELLS = 4
"""Subregions to a side of the descriptor."""
DIRECTIONS = 8
CELL_SIZE = 3.0
"""Side of a subregion, in scales of the keypoint."""
CLIP = 0.2
"""Largest entry of a unit descriptor, for robustness to non-linear changes of illumination."""
CELL_STRIDE = DIRECTIONS + 1
"""Number of accumulators of a subregion; the last is added to the first."""
ROW_STRIDE = (CELLS + 2) * CELL_STRIDE
"""Number of accumulators of a row of subregions, with one subregion more on each side."""
CORNERS = np.add.outer([0, ROW_STRIDE], np.add.outer([0, CELL_STRIDE], [0, 1])).ravel().astype("u8")
"""(8,) accumulators around a sample, counted from the first."""
EPSILON = 1e-12
"""Smallest length or slope that differs from 0."""

ARCTANGENT = np.array(
    [0.99997722, -0.33262287, 0.19354066, -0.11642722, 0.05264819, -0.01171947], np.float32
)
"""(6,) coefficients of the minimax odd polynomial of the arctangent on [0, 1]."""
EXPONENTIAL = np.array([1, 1, 1 / 2, 1 / 6, 1 / 24], np.float32)
"""(5,) coefficients of the power series of the exponential function."""


@kernel()
def fill_orientation_histograms(
    octave: Float32Array,
    planes: IntArray,
    xy: Float32Array,
    sigmas: Float32Array,
    spacing: float,
    linear: bool,
    subpixel: bool,
    capacity: int,
    histograms: Float32Array,
) -> None:
    """Adds the weighted gradients around each keypoint to (n, 36) `histograms` of directions."""
    samples = np.empty((4, capacity), np.float32)
    lower, weights = np.empty(capacity, np.int32), np.empty((2, capacity), np.float32)
    bins_per_radian = ORIENTATION_BINS / (2 * pi)
    bins = np.empty(ORIENTATION_BINS + 2, np.float32)  # the last two are the first two
    for i in range(len(planes)):
        x, y, sigma = float(xy[i, 0]), float(xy[i, 1]), float(sigmas[i])
        radius = ORIENTATION_RADIUS * sigma
        if not subpixel:
            x, y, radius = round(x), round(y), round(radius)
        stride = max(int(spacing * sigma + 0.5), 1)
        plane = octave[planes[i]]
        count = gather_gradients(plane, x, y, 1 / sigma, 0.0, radius / sigma, stride, samples)
        _weight_gradients(
            samples, count, ORIENTATION_SIGMA, bins_per_radian, float(ORIENTATION_BINS)
        )
        _interpolate_directions(samples, count, linear, lower, weights)
        for k in range(len(bins)):
            bins[k] = 0
        for k in range(count):
            first = np.uint64(np.uint32(lower[k]))
            bins[first] += weights[0, k]
            bins[first + np.uint64(1)] += weights[1, k]
        for k in range(ORIENTATION_BINS):
            histograms[i, k] = bins[k]
        histograms[i, 0] += bins[ORIENTATION_BINS]
        histograms[i, 1] += bins[ORIENTATION_BINS + 1]


@kernel(fastmath=("nnan", "nsz", "contract"))
def _interpolate_directions(
    samples: Float32Array, count: int, linear: bool, lower: Int32Array, weights: Float32Array
) -> None:
    """Finds the two bins beside the direction of each sample, and its weights in both.

    Args:
        samples: (4, capacity) u, v, direction in bins from 0 to two turns, and weight.
        count: of samples.
        linear: interpolate between both bins; otherwise the nearest has the whole weight.
        lower: (capacity,) takes the lower of the two bins.
        weights: (2, capacity) takes the weights.
    """
    turn, half = np.float32(ORIENTATION_BINS), np.float32(0.5)
    for k in range(count):
        position, weight = samples[2, k], samples[3, k]
        position = position - turn if position >= turn else position
        low = np.int32(position) if linear else np.int32(position + half)
        upper = weight * (position - np.float32(low)) if linear else np.float32(0)
        lower[k] = low
        weights[0, k] = weight - upper
        weights[1, k] = upper


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
    capacity: int,
    out: Float32Array,
) -> None:
    """Fills (n, 128) `out` with gradients, interpolated linearly in x, y and direction."""
    samples = np.empty((4, capacity), np.float32)
    corners, weights = np.empty(capacity, np.int32), np.empty((8, capacity), np.float32)
    bins_per_radian = DIRECTIONS / (2 * pi)
    radius = (CELLS + 1) / 2  # of the samples that touch a subregion, in subregions
    cells = np.empty((CELLS + 2) * ROW_STRIDE, np.float32)
    for i in range(len(planes)):
        x, y, angle = float(xy[i, 0]), float(xy[i, 1]), float(angles[i])
        if not subpixel:
            x, y = round(x), round(y)
        cell = CELL_SIZE * sigmas[i]
        stride = max(int(spacing * sigmas[i] + 0.5), 1)
        cosine, sine = cos(angle) / cell, sin(angle) / cell
        count = gather_gradients(octave[planes[i]], x, y, cosine, sine, radius, stride, samples)
        _weight_gradients(
            samples,
            count,
            CELLS * window_sigma,
            -bins_per_radian,
            angle * bins_per_radian + 2 * DIRECTIONS,
        )
        _interpolate_trilinearly(samples, count, radius, corners, weights)
        for k in range(len(cells)):
            cells[k] = 0
        for k in range(count):
            first = np.uint64(np.uint32(corners[k]))
            for corner in range(len(CORNERS)):
                cells[first + CORNERS[corner]] += weights[corner, k]
        for row in range(CELLS):
            for column in range(CELLS):
                start = (row + 1) * ROW_STRIDE + (column + 1) * CELL_STRIDE
                cells[start] += cells[start + DIRECTIONS]
                for turn in range(DIRECTIONS):
                    out[i, (row * CELLS + column) * DIRECTIONS + turn] = cells[start + turn]


@kernel(fastmath=("nnan", "nsz", "contract"))
def _interpolate_trilinearly(
    samples: Float32Array, count: int, radius: float, corners: Int32Array, weights: Float32Array
) -> None:
    """Finds the eight accumulators around each sample, and its weights in these.

    Args:
        samples: (4, capacity) u, v, direction from 0 to 4 turns, and weight.
        count: of samples.
        radius: half a side of the square, in subregions.
        corners: (capacity,) takes the first accumulator of the eight.
        weights: (8, capacity) takes the weights: first the next direction, then the next column,
            then the next row.
    """
    one, turn = np.float32(1), np.float32(DIRECTIONS)
    shift, last = np.float32(radius), np.float32(2 * radius * (1 - 1e-6))
    for k in range(count):
        column = min(max(samples[0, k] + shift, np.float32(0)), last)
        row = min(max(samples[1, k] + shift, np.float32(0)), last)
        position = samples[2, k]
        position -= turn * np.float32(np.int32(position * (one / turn)))
        r, c, t = np.int32(row), np.int32(column), np.int32(position)
        fr, fc, ft = row - np.float32(r), column - np.float32(c), position - np.float32(t)
        corners[k] = r * np.int32(ROW_STRIDE) + c * np.int32(CELL_STRIDE) + t
        lower = samples[3, k] * fr
        upper = samples[3, k] - lower
        lower_right, upper_right = lower * fc, upper * fc
        lower_left, upper_left = lower - lower_right, upper - upper_right
        weights[1, k] = upper_left * ft
        weights[0, k] = upper_left - weights[1, k]
        weights[3, k] = upper_right * ft
        weights[2, k] = upper_right - weights[3, k]
        weights[5, k] = lower_left * ft
        weights[4, k] = lower_left - weights[5, k]
        weights[7, k] = lower_right * ft
        weights[6, k] = lower_right - weights[7, k]


@kernel()
def gather_gradients(
    plane: Float32Array,
    x: float,
    y: float,
    cosine: float,
    sine: float,
    radius: float,
    stride: int,
    out: Float32Array,
) -> int:
    """Fills columns of (4, capacity) `out` with samples in a rotated square; returns their number.

    The rows are u and v, the position in the frame of the square, then the gradient in x and y.
    Samples lie `stride` apart, symmetrically about the sample nearest to the keypoint, so that a
    mirrored patch has the mirrored samples. `cosine` and `sine` of the square's angle are divided
    by the samples to a unit of u and v, in which `radius` is half a side.
    """
    height, width = plane.shape
    middle, center = floor(y + 0.5), floor(x + 0.5)
    low, high = -radius - 1e-6, radius + 1e-6
    extent = high * (abs(cosine) + abs(sine)) / (cosine * cosine + sine * sine)
    first = max(ceil((y - extent - middle) / stride), -((middle - 1) // stride))
    last = min(floor((y + extent - middle) / stride), (height - 2 - middle) // stride)
    count = 0
    for j in range(first, last + 1):
        row = middle + j * stride
        dy = row - y
        left, right = x - extent, x + extent
        if abs(cosine) > EPSILON:
            bounds = (low - sine * dy) / cosine, (high - sine * dy) / cosine
            left, right = max(left, x + min(bounds)), min(right, x + max(bounds))
        if abs(sine) > EPSILON:
            bounds = (cosine * dy - high) / sine, (cosine * dy - low) / sine
            left, right = max(left, x + min(bounds)), min(right, x + max(bounds))
        start = max(ceil((left - center) / stride), -((center - 1) // stride))
        stop = min(floor((right - center) / stride), (width - 2 - center) // stride) + 1
        if stop > start:
            columns = slice(center + start * stride, center + (stop - 1) * stride + 1)
            part = out[:, count : count + stop - start]
            u0, v0 = sine * dy, cosine * dy
            if stride == 1:
                _gather_row(plane[row - 1 : row + 2], columns, x, u0, v0, cosine, sine, part)
            else:
                for k in range(start, stop):
                    column = center + k * stride
                    dx = np.float32(column - x)
                    part[0, k - start] = np.float32(cosine) * dx + np.float32(u0)
                    part[1, k - start] = np.float32(v0) - np.float32(sine) * dx
                    part[2, k - start] = plane[row, column + 1] - plane[row, column - 1]
                    part[3, k - start] = plane[row + 1, column] - plane[row - 1, column]
            count += stop - start
    return count


@kernel(fastmath=("nsz", "contract"))
def _gather_row(
    rows: Float32Array,
    columns: slice,
    x: float,
    u0: float,
    v0: float,
    cosine: float,
    sine: float,
    out: Float32Array,
) -> None:
    """Fills columns of `out` with all samples of the middle row between two columns."""
    first, last = columns.start, columns.stop
    left, right = rows[1, first - 1 : last - 1], rows[1, first + 1 : last + 1]
    above, below = rows[0, first:last], rows[2, first:last]
    u, v, gx, gy = out[0], out[1], out[2], out[3]
    a, b, c, d = np.float32(cosine), np.float32(sine), np.float32(u0), np.float32(v0)
    start = np.float32(first - x)
    for k in range(len(above)):
        dx = start + np.float32(k)
        u[k] = a * dx + c
        v[k] = d - b * dx
        gx[k] = right[k] - left[k]
        gy[k] = below[k] - above[k]


@kernel(fastmath=("nsz", "contract"))
def _weight_gradients(
    samples: Float32Array, count: int, window_sigma: float, bins_per_radian: float, first_bin: float
) -> None:
    """Replaces gradients, rows 2 and 3 of `samples`, by orientation bin and weight (B.11-B.12).

    The bin is `first_bin + bins_per_radian * direction`, the weight the gradient's magnitude under
    a Gaussian of u and v. Arctangent and exponential are polynomials, exact to 2e-6 and 1e-5, for
    the loop to be vectorized.
    """
    half_turn, a, b = np.float32(pi), ARCTANGENT, EXPONENTIAL
    scale, shift = np.float32(bins_per_radian), np.float32(first_bin)
    decay = np.float32(-0.5 / (window_sigma * window_sigma) / 64)
    for k in range(count):
        u, v, dx, dy = samples[0, k], samples[1, k], samples[2, k], samples[3, k]
        wide, high = abs(dx), abs(dy)
        steep = high > wide
        run, rise = (high, wide) if steep else (wide, high)
        slope = rise / run if run > 0 else np.float32(0)
        s = slope * slope
        angle = slope * (a[0] + s * (a[1] + s * (a[2] + s * (a[3] + s * (a[4] + s * a[5])))))
        angle = half_turn / 2 - angle if steep else angle
        angle = half_turn - angle if dx < 0 else angle
        angle = -angle if dy < 0 else angle
        t = decay * (u * u + v * v)
        e = b[0] + t * (b[1] + t * (b[2] + t * (b[3] + t * b[4])))
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e
        e = e * e  # exp(t)^64
        samples[2, k] = shift + scale * angle
        samples[3, k] = e * np.sqrt(dx * dx + dy * dy)


@kernel(fastmath=("nsz", "contract", "reassoc", "arcp"))
def normalize(vectors: Float32Array, root: bool) -> None:
    """Normalize the rows of (n, d) `vectors`, clip them, and normalize them again.

    With `root` the result is the square root of the L1-normalized rows.
    """
    epsilon, clip, one = np.float32(EPSILON), np.float32(CLIP), np.float32(1)
    for i in range(len(vectors)):
        row = vectors[i]
        square = np.float32(0)
        for k in range(len(row)):
            square += row[k] * row[k]
        limit = clip * np.sqrt(square)  # before the length is 1
        square, total = np.float32(0), np.float32(0)
        for k in range(len(row)):
            entry = min(row[k], limit)
            square += entry * entry
            total += entry
        scale = one / max(np.sqrt(square), epsilon)
        if root:
            scale = one / max(total, epsilon)
        for k in range(len(row)):
            entry = min(row[k], limit) * scale
            row[k] = np.sqrt(entry) if root else entry
