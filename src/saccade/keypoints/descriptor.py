"""The orientation and the descriptor of an interest point, used by all detectors.

Both look at the gradients around the point in the plane of the scale space
that is nearest to it in scale, and read its place and scale in samples of
that plane.
"""

from math import atan2, ceil, cos, exp, floor, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

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
    angle[angle <= -pi] = pi
    return point, angle.astype(np.float32), middle / highest[point, 0]


def describe(
    octave: Float32Array,
    frames: Frames,
    angle: Float32Array,
    *,
    window_sigma: float,
    subpixel: bool,
    root: bool,
) -> npt.NDArray[np.uint8]:
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
    return rows / np.maximum(length, np.finfo(np.float32).tiny)[:, None]


def quantize(unit: Float32Array, *, root: bool) -> npt.NDArray[np.uint8]:
    """Unit descriptors in 8 bits: 512 to the unit, saturated at 255."""
    if root:
        total = np.maximum(unit.sum(axis=1), np.finfo(np.float32).tiny)
        unit = np.sqrt(unit / total[:, None])
    return np.rint(np.minimum(unit * np.float32(QUANTUM), 255)).astype(np.uint8)


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
    for i in range(len(planes)):
        plane = octave[planes[i]]
        x, y = float(xy[i, 0]), float(xy[i, 1])
        radius = ORIENTATION_RADIUS * sigmas[i]
        falloff = -0.5 / (ORIENTATION_SIGMA * sigmas[i]) ** 2
        if not subpixel:
            x, y, radius = round(x), round(y), round(radius)
        for row in range(max(ceil(y - radius), 1), min(floor(y + radius), height - 2) + 1):
            for column in range(max(ceil(x - radius), 1), min(floor(x + radius), width - 2) + 1):
                dx, dy = gradient(plane, row, column)
                weight = exp(falloff * ((column - x) ** 2 + (row - y) ** 2)) * hypot(dx, dy)
                place = atan2(dy, dx) * (ORIENTATION_BINS / (2 * pi))        # B.12
                if linear:
                    low = floor(place)
                    share = place - low
                    bins[i, low % ORIENTATION_BINS] += weight * (1 - share)
                    bins[i, (low + 1) % ORIENTATION_BINS] += weight * share
                else:
                    bins[i, round(place) % ORIENTATION_BINS] += weight


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
    reach = (CELLS + 1) / 2  # of the outermost samples that touch a subregion, in subregions
    falloff = -0.5 / (CELLS * window_sigma) ** 2
    # One subregion more on each side takes what falls outside.
    cells = np.zeros((CELLS + 2, CELLS + 2, DIRECTIONS), np.float32)
    for i in range(len(planes)):
        plane = octave[planes[i]]
        x, y = float(xy[i, 0]), float(xy[i, 1])
        if not subpixel:
            x, y = round(x), round(y)
        cell = CELL_SIZE * sigmas[i]
        along, across = cos(angles[i]) / cell, sin(angles[i]) / cell
        radius = cell * reach * sqrt(2.0)
        cells[:] = 0
        for row in range(max(ceil(y - radius), 1), min(floor(y + radius), height - 2) + 1):
            for column in range(max(ceil(x - radius), 1), min(floor(x + radius), width - 2) + 1):
                u = along * (column - x) + across * (row - y)
                v = along * (row - y) - across * (column - x)
                if abs(u) >= reach or abs(v) >= reach:
                    continue
                dx, dy = gradient(plane, row, column)
                weight = exp(falloff * (u * u + v * v)) * hypot(dx, dy)
                turn = (angles[i] - atan2(dy, dx)) * (DIRECTIONS / (2 * pi))
                share_trilinearly(cells, v + reach, u + reach, turn, weight)
        out[i] = cells[1:-1, 1:-1].copy().reshape(-1)


@kernel()
def share_trilinearly(
    cells: Float32Array, row: float, column: float, turn: float, weight: float
) -> None:
    """Add `weight` to the eight entries around a place; the third axis is circular."""
    r, c, t = floor(row), floor(column), floor(turn)
    fr, fc, ft = row - r, column - c, turn - t
    first, second = t % DIRECTIONS, (t + 1) % DIRECTIONS
    for dr in range(2):
        for dc in range(2):
            part = weight * (fr if dr else 1 - fr) * (fc if dc else 1 - fc)
            cells[r + dr, c + dc, first] += part * (1 - ft)
            cells[r + dr, c + dc, second] += part * ft


@kernel()
def gradient(plane: Float32Array, row: int, column: int) -> tuple[float, float]:
    """Differences of the neighbors along x and y (B.11)."""
    return (
        plane[row, column + 1] - plane[row, column - 1],
        plane[row + 1, column] - plane[row - 1, column],
    )
