"""The orientation and the descriptor of an interest point, used by all detectors.

Both look at the gradients around the point in the plane of the scale space
that is nearest to it in scale, and read its place and scale in samples of
that plane.
"""

from math import ceil, cos, exp, floor, pi, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
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

A0, A1, A2 = np.float32(0.99997722), np.float32(-0.33262287), np.float32(0.19354066)
A3, A4, A5 = np.float32(-0.11642722), np.float32(0.05264819), np.float32(-0.01171947)
"""Of the odd polynomial nearest to the arctangent on [0, 1]."""


class Frames(NamedTuple):
    """Points in one octave, as its samples count."""

    plane: IntArray
    """(n,) the plane of the octave that is nearest in scale."""
    xy: Float32Array
    """(n, 2) place in samples."""
    sigma: Float32Array
    """(n,) scale in samples."""


def orientations(
    octave: Float32Array, frames: Frames, *, linear: bool, smoothing: int, subpixel: bool
) -> tuple[IntArray, Float32Array, Float32Array]:
    """The strong directions of the gradient around each point (B.11-B.12).

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        linear: share a gradient between the two bins beside it, not give it to the nearest.
        smoothing: passes of [1 2 1] / 4 over the circular histogram.
        subpixel: centre the window on the point, not on the sample nearest to it.

    Returns:
        (m,) index of the point, ascending; (m,) angle in radians from x towards y in
        (-pi, pi]; (m,) height of the peak as a share of the point's highest. A point
        without any gradient around it has none.

    Source: Lowe (2004), section 5.
    """
    bins = np.zeros((len(frames.plane), ORIENTATION_BINS), np.float32)
    fill_orientation_bins(octave, *frames, linear, subpixel, bins)
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
) -> ByteArray:
    """The descriptors of points in one octave (B.2).

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        angle: (n,) in radians from x towards y.
        window_sigma: of the Gaussian window, in sides of the descriptor.
        subpixel: centre the descriptor on the point, not on the sample nearest to it.
        root: L1-normalize and take the square root (RootSIFT).

    Returns:
        (n, 128), rows of subregions along the angle; the directions in a subregion turn
        from y towards x, as in OpenCV.

    Source: Lowe (2004), section 6; Arandjelovic & Zisserman (2012) for the root.
    """
    raw = np.empty((len(angle), CELLS * CELLS * DIRECTIONS), np.float32)
    fill_descriptors(octave, *frames, angle, window_sigma, subpixel, raw)
    return quantize(unit_rows(np.minimum(unit_rows(raw), np.float32(CUT))), root=root)


def unit_rows(rows: Float32Array) -> Float32Array:
    """Each row at unit length; a row of zeros stays so."""
    length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    unit: Float32Array = rows / np.maximum(length, np.finfo(np.float32).tiny)[:, None]
    return unit


def quantize(unit: Float32Array, *, root: bool) -> ByteArray:
    """Unit descriptors in 8 bits: 512 to the unit, saturated at 255."""
    if root:
        total = np.maximum(unit.sum(axis=1), np.finfo(np.float32).tiny)
        unit = np.sqrt(unit / total[:, None])
    quantized: ByteArray = np.rint(np.minimum(unit * np.float32(QUANTUM), 255)).astype(np.uint8)
    return quantized


@kernel()
def fill_orientation_bins(
    octave: Float32Array,
    planes: IntArray,
    xy: Float32Array,
    sigmas: Float32Array,
    linear: bool,
    subpixel: bool,
    bins: Float32Array,
) -> None:
    """Add to (n, 36) `bins` the weighted gradients around each point by direction."""
    height, width = octave.shape[1:]
    magnitude, direction = np.empty(width, np.float32), np.empty(width, np.float32)
    weight = np.empty(width, np.float32)
    for i in range(len(planes)):
        x, y = float(xy[i, 0]), float(xy[i, 1])
        radius = ORIENTATION_RADIUS * sigmas[i]
        if not subpixel:
            x, y, radius = round(x), round(y), round(radius)
        sigma = ORIENTATION_SIGMA * sigmas[i]
        left, right = max(ceil(x - radius), 1), min(floor(x + radius), width - 2) + 1
        fill_window(weight, left, right, x, sigma)
        for row in range(max(ceil(y - radius), 1), min(floor(y + radius), height - 2) + 1):
            fill_gradients(octave[planes[i]], row, left, right, magnitude, direction)  # B.11-B.12
            row_weight = exp(-0.5 * ((row - y) / sigma) ** 2)
            for column in range(left, right):
                place = direction[column] * (ORIENTATION_BINS / (2 * pi)) + ORIENTATION_BINS
                share = row_weight * weight[column] * magnitude[column]
                if linear:
                    low = int(place)
                    bins[i, low % ORIENTATION_BINS] += share * (low + 1 - place)
                    bins[i, (low + 1) % ORIENTATION_BINS] += share * (place - low)
                else:
                    bins[i, int(place + 0.5) % ORIENTATION_BINS] += share


@kernel()
def fill_descriptors(
    octave: Float32Array,
    planes: IntArray,
    xy: Float32Array,
    sigmas: Float32Array,
    angles: Float32Array,
    window_sigma: float,
    subpixel: bool,
    out: Float32Array,
) -> None:
    """Fill (n, 128) `out` with gradients, shared linearly in x, y and direction."""
    height, width = octave.shape[1:]
    magnitude, direction = np.empty(width, np.float32), np.empty(width, np.float32)
    weight = np.empty(width, np.float32)
    reach = np.float32((CELLS + 1) / 2)  # how far samples touch a subregion, in subregions
    # One subregion more on each side takes what falls outside.
    cells = np.zeros((CELLS + 2, CELLS + 2, DIRECTIONS), np.float32)
    for i in range(len(planes)):
        x, y = float(xy[i, 0]), float(xy[i, 1])
        if not subpixel:
            x, y = round(x), round(y)
        cell = CELL_SIZE * sigmas[i]
        along, across = np.float32(cos(angles[i]) / cell), np.float32(sin(angles[i]) / cell)
        radius = cell * reach * sqrt(2.0)
        left, right = max(ceil(x - radius), 1), min(floor(x + radius), width - 2) + 1
        window = CELLS * window_sigma * cell
        fill_window(weight, left, right, x, window)
        cells[:] = 0
        for row in range(max(ceil(y - radius), 1), min(floor(y + radius), height - 2) + 1):
            fill_gradients(octave[planes[i]], row, left, right, magnitude, direction)
            row_weight = np.float32(exp(-0.5 * ((row - y) / window) ** 2))
            dy = np.float32(row - y)
            for column in range(left, right):
                dx = np.float32(column - x)
                u = along * dx + across * dy
                v = along * dy - across * dx
                if abs(u) < reach and abs(v) < reach:
                    turn = (angles[i] - direction[column]) * np.float32(DIRECTIONS / (2 * pi))
                    turn += np.float32(2 * DIRECTIONS)
                    share = row_weight * weight[column] * magnitude[column]
                    share_trilinearly(cells, v + reach, u + reach, turn, share)
        out[i] = cells[1:-1, 1:-1].copy().reshape(-1)


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
def fill_window(out: Float32Array, left: int, right: int, center: float, sigma: float) -> None:
    """Fill `out[left:right]` with the Gaussian of the distance to `center`."""
    for column in range(left, right):
        out[column] = exp(-0.5 * ((column - center) / sigma) ** 2)


@kernel(fastmath=("nsz", "contract"))
def fill_gradients(
    plane: Float32Array,
    row: int,
    left: int,
    right: int,
    magnitude: Float32Array,
    direction: Float32Array,
) -> None:
    """Fill columns `left` to `right` with the length and direction of the gradient (B.11-B.12).

    The arctangent is a polynomial, within 2e-6 rad: a call per sample took most of the time.
    """
    above, here, below = plane[row - 1], plane[row], plane[row + 1]
    half_turn = np.float32(pi)
    for column in range(left, right):
        dx = here[column + 1] - here[column - 1]
        dy = below[column] - above[column]
        wide, high = abs(dx), abs(dy)
        steep = high > wide
        run, rise = (high, wide) if steep else (wide, high)
        slope = rise / run if run > 0 else np.float32(0)
        s = slope * slope
        angle = slope * (A0 + s * (A1 + s * (A2 + s * (A3 + s * (A4 + s * A5)))))
        angle = half_turn / 2 - angle if steep else angle
        angle = half_turn - angle if dx < 0 else angle
        direction[column] = -angle if dy < 0 else angle
        magnitude[column] = np.sqrt(dx * dx + dy * dy)
