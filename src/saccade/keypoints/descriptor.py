"""The orientation and the descriptor of an interest point, used by all detectors.

Both look at the gradients around the point in the plane of the scale space
that is nearest to it in scale, and read its place and scale in samples of
that plane.
"""

from math import ceil, cos, floor, pi, sin
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel, spread
from saccade.types import Float32Array, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]

ORIENTATION_BINS = 36
ORIENTATION_SIGMA = 1.5
"""Of the Gaussian weight of a gradient, in scales of the point."""
ORIENTATION_RADIUS = 4.5
"""Half a side of the square around the point, in scales: three sigmas of the weight."""
PEAK_RATIO = 0.8
"""A direction makes a point if it has this share of the strongest direction."""

CELLS = 4
"""Subregions to a side of the descriptor."""
DIRECTIONS = 8
CELL_SIZE = 3.0
"""Side of a subregion, in scales of the point."""
CUT = 0.2
"""No entry of a unit descriptor may be larger: against non-linear changes of light."""
QUANTUM = 512
"""Of a unit descriptor in 8 bits."""
TINY = 1e-12
"""Less than any length or slope that matters."""
BLOCK = 256
"""Points that a thread takes at a time."""

A0, A1, A2 = np.float32(0.99997722), np.float32(-0.33262287), np.float32(0.19354066)
A3, A4, A5 = np.float32(-0.11642722), np.float32(0.05264819), np.float32(-0.01171947)
"""Of the odd polynomial nearest to the arctangent on [0, 1]."""
E2, E3, E4 = np.float32(1 / 2), np.float32(1 / 6), np.float32(1 / 24)
"""Of the exponential."""


class Frames(NamedTuple):
    """Points in one octave, as its samples count."""

    plane: IntArray
    """(n,) the plane of the octave that is nearest in scale."""
    xy: Float32Array
    """(n, 2) place in samples."""
    sigma: Float32Array
    """(n,) scale in samples."""

    def block(self, index: slice) -> "Frames":
        """Some of them."""
        return Frames(self.plane[index], self.xy[index], self.sigma[index])


def orientations(
    octave: Float32Array,
    frames: Frames,
    *,
    linear: bool,
    smoothing: int,
    subpixel: bool,
    spacing: float = 0.0,
    threads: int = 1,
) -> tuple[IntArray, Float32Array, Float32Array]:
    """The strong directions of the gradient around each point (B.11-B.12).

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        linear: share a gradient between the two bins beside it, not give it to the nearest.
        smoothing: passes of [1 2 1] / 4 over the circular histogram.
        subpixel: centre the window on the point, not on the sample nearest to it.
        spacing: of the samples that are looked at, in scales of the point; 0 for all.
        threads: how many work at a time.

    Returns:
        (m,) index of the point, ascending; (m,) angle in radians from x towards y in
        (-pi, pi]; (m,) height of the peak as a share of the point's highest. A point
        without any gradient around it has none.

    Source: Lowe (2004), section 5.
    """
    bins = np.zeros((len(frames.plane), ORIENTATION_BINS), np.float32)
    room = min(room_for(frames.sigma, 2 * ORIENTATION_RADIUS, spacing), octave[0].size)

    def fill(block: slice) -> None:
        fill_orientation_bins(
            octave, *frames.block(block), spacing, linear, subpixel, room, bins[block]
        )

    spread(fill, len(bins), BLOCK, threads)
    for _ in range(smoothing):
        bins = (np.roll(bins, 1, axis=1) + 2 * bins + np.roll(bins, -1, axis=1)) / np.float32(4)
    before, after = np.roll(bins, 1, axis=1), np.roll(bins, -1, axis=1)
    highest = bins.max(axis=1, keepdims=True, initial=0)
    # Of two equal neighbors the second is the peak: symmetrical patterns have such.
    peaks = (bins >= before) & (bins > after) & (bins >= PEAK_RATIO * highest)
    point, peak = np.nonzero(peaks)
    left, middle, right = before[peaks], bins[peaks], after[peaks]
    place = peak + 0.5 * (left - right) / (left - 2 * middle + right)
    angle = np.remainder(place * (2 * pi / ORIENTATION_BINS) + pi, 2 * pi) - pi
    angle = angle.astype(np.float32)
    angle[angle <= np.float32(-pi)] = pi
    return point, angle, middle / highest[point, 0]


def describe_frames(
    octave: Float32Array,
    frames: Frames,
    angle: Float32Array,
    *,
    window_sigma: float,
    subpixel: bool,
    root: bool,
    spacing: float = 0.0,
    threads: int = 1,
) -> ByteArray:
    """The descriptors of points in one octave (B.2).

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        angle: (n,) in radians from x towards y.
        window_sigma: of the Gaussian window, in sides of the descriptor.
        subpixel: centre the descriptor on the point, not on the sample nearest to it.
        root: L1-normalize and take the square root (RootSIFT).
        spacing: of the samples that are looked at, in scales of the point; 0 for all.
        threads: how many work at a time.

    Returns:
        (n, 128), rows of subregions along the angle; the directions in a subregion turn
        from y towards x, as in OpenCV.

    Source: Lowe (2004), section 6; Arandjelovic & Zisserman (2012) for the root.
    """
    raw = np.empty((len(angle), CELLS * CELLS * DIRECTIONS), np.float32)
    quantized = np.empty(raw.shape, np.uint8)
    room = min(room_for(frames.sigma, (CELLS + 1) * CELL_SIZE, spacing), octave[0].size)

    def fill(block: slice) -> None:
        fill_descriptors(
            octave,
            *frames.block(block),
            angle[block],
            window_sigma,
            spacing,
            subpixel,
            room,
            raw[block],
        )
        quantize(raw[block], root, quantized[block])

    spread(fill, len(raw), BLOCK, threads)
    return quantized


def room_for(sigma: Float32Array, side: float, spacing: float) -> int:
    """Samples that a turned square of some scales to a side may hold, at most."""
    widest = float(sigma.max(initial=0))
    # A stride is rounded: it may be down to two thirds of what was asked for.
    stride = max(spacing * widest / 1.5, 1.0)
    return int((side * widest / stride + 4) ** 2)


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
    per_radian, half = ORIENTATION_BINS / (2 * pi), np.float32(0.5)
    for i in range(len(planes)):
        x, y, sigma = float(xy[i, 0]), float(xy[i, 1]), float(sigmas[i])
        radius = ORIENTATION_RADIUS * sigma
        if not subpixel:
            x, y, radius = round(x), round(y), round(radius)
        stride = max(int(spacing * sigma + 0.5), 1)
        plane = octave[planes[i]]
        count = gather_gradients(plane, x, y, 1 / sigma, 0.0, radius / sigma, stride, samples)
        weigh_gradients(samples, count, ORIENTATION_SIGMA, per_radian, float(ORIENTATION_BINS))
        for k in range(count):
            place, share = samples[2, k], samples[3, k]
            if linear:
                low = int(place)
                part = share * (place - np.float32(low))
                bins[i, low % ORIENTATION_BINS] += share - part
                bins[i, (low + 1) % ORIENTATION_BINS] += part
            else:
                bins[i, int(place + half) % ORIENTATION_BINS] += share


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
    per_radian = DIRECTIONS / (2 * pi)
    reach = (CELLS + 1) / 2  # how far samples touch a subregion, in subregions
    last = np.float32(2 * reach * (1 - 1e-6))
    # One subregion more on each side takes what falls outside.
    cells = np.zeros((CELLS + 2, CELLS + 2, DIRECTIONS), np.float32)
    for i in range(len(planes)):
        x, y, angle = float(xy[i, 0]), float(xy[i, 1]), float(angles[i])
        if not subpixel:
            x, y = round(x), round(y)
        cell = CELL_SIZE * sigmas[i]
        stride = max(int(spacing * sigmas[i] + 0.5), 1)
        along, across = cos(angle) / cell, sin(angle) / cell
        count = gather_gradients(octave[planes[i]], x, y, along, across, reach, stride, samples)
        weigh_gradients(
            samples, count, CELLS * window_sigma, -per_radian, angle * per_radian + 2 * DIRECTIONS
        )
        cells[:] = 0
        for k in range(count):
            column, row = samples[0, k] + np.float32(reach), samples[1, k] + np.float32(reach)
            row, column = min(max(row, np.float32(0)), last), min(max(column, np.float32(0)), last)
            share_trilinearly(cells, row, column, samples[2, k], samples[3, k])
        for row in range(CELLS):
            for column in range(CELLS):
                for turn in range(DIRECTIONS):
                    entry = (row * CELLS + column) * DIRECTIONS + turn
                    out[i, entry] = cells[row + 1, column + 1, turn]


@kernel()
def share_trilinearly(
    cells: Float32Array, row: np.float32, column: np.float32, turn: np.float32, weight: np.float32
) -> None:
    """Add `weight` to the eight entries around a place >= 0; the third axis is circular."""
    r, c, t = int(row), int(column), int(turn)
    fr, fc, ft = row - np.float32(r), column - np.float32(c), turn - np.float32(t)
    first, second = t & (DIRECTIONS - 1), (t + 1) & (DIRECTIONS - 1)
    lower = weight * fr
    upper = weight - lower
    lower_right, upper_right = lower * fc, upper * fc
    lower_left, upper_left = lower - lower_right, upper - upper_right
    cells[r, c, first] += upper_left - upper_left * ft
    cells[r, c, second] += upper_left * ft
    cells[r, c + 1, first] += upper_right - upper_right * ft
    cells[r, c + 1, second] += upper_right * ft
    cells[r + 1, c, first] += lower_left - lower_left * ft
    cells[r + 1, c, second] += lower_left * ft
    cells[r + 1, c + 1, first] += lower_right - lower_right * ft
    cells[r + 1, c + 1, second] += lower_right * ft


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
        u0, v0 = np.float32(across * dy), np.float32(along * dy)
        for k in range(start, stop):
            column = center + k * stride
            dx = np.float32(column - x)
            out[0, count] = np.float32(along) * dx + u0
            out[1, count] = v0 - np.float32(across) * dx
            out[2, count] = plane[row, column + 1] - plane[row, column - 1]
            out[3, count] = plane[row + 1, column] - plane[row - 1, column]
            count += 1
    return count


@kernel(fastmath=("nsz", "contract"))
def weigh_gradients(
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
def quantize(raw: Float32Array, root: bool, out: ByteArray) -> None:
    """Fill (n, d) `out`: unit length, cut, unit length again; in 8 bits, 512 to the unit.

    With `root` the square root of the L1-normalized rows takes the place of the last length.
    """
    tiny, cut, quantum = np.float32(TINY), np.float32(CUT), np.float32(QUANTUM)
    most, half = np.float32(255), np.float32(0.5)
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
            entry = np.sqrt(entry) if root else entry
            out[i, k] = np.uint8(min(entry, most) + half)
