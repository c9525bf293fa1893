"""The orientation and the descriptor of an interest point, used by all detectors.

Both look at the gradients around the point in the plane of the scale space
that is nearest to it in scale, and read its place and scale in samples of
that plane.
"""

from math import pi
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import run_in_blocks
from saccade.keypoints.gradients import (
    CELL_SIZE,
    CELLS,
    DIRECTIONS,
    ORIENTATION_BINS,
    ORIENTATION_RADIUS,
    fill_descriptors,
    fill_orientation_bins,
    normalize,
    smooth_circles,
)
from saccade.types import Float32Array, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]
Descriptors: TypeAlias = ByteArray | Float32Array

PEAK_RATIO = 0.8
"""A direction makes a point if it has this share of the strongest direction."""
QUANTUM = 512
"""Length of a unit descriptor in 8 bits."""
BLOCK = 256
"""Points that a thread takes at a time."""


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
    every_bin: bool = False,
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
        every_bin: take every bin over `PEAK_RATIO` of the highest, not only local peaks.
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
        smooth_circles(bins[block], smoothing)

    run_in_blocks(fill, len(bins), BLOCK, threads)
    before, after = np.roll(bins, 1, axis=1), np.roll(bins, -1, axis=1)
    highest = bins.max(axis=1, keepdims=True, initial=0)
    # Of two equal neighbors the second is the peak: symmetrical patterns have such.
    peaks = (bins >= before) & (bins > after) & (bins >= PEAK_RATIO * highest)
    if every_bin:
        peaks = (bins == highest) | (bins > PEAK_RATIO * highest)
        peaks &= highest > 0
    point, peak = np.nonzero(peaks)
    left, middle, right = before[peaks], bins[peaks], after[peaks]
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend
    if every_bin:  # of a bin on a slope the highest point within it counts
        shift = np.where(bend < 0, shift.clip(-0.5, 0.5), 0.5 * np.sign(right - left))
    place = peak + shift
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
    as_float: bool = False,
    threads: int = 1,
) -> Descriptors:
    """The descriptors of points in one octave (section B.2).

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        angle: (n,) in radians from x towards y.
        window_sigma: of the Gaussian window, in sides of the descriptor.
        subpixel: centre the descriptor on the point, not on the sample nearest to it.
        root: L1-normalize and take the square root (RootSIFT).
        spacing: of the samples that are looked at, in scales of the point; 0 for all.
        as_float: give float32 of unit length in the place of bytes.
        threads: how many work at a time.

    Returns:
        (n, 128), rows of subregions along the angle; the directions in a subregion turn
        from y towards x, as in OpenCV.

    Source: Lowe (2004), section 6; Arandjelovic & Zisserman (2012) for the root.
    """
    raw = np.empty((len(angle), CELLS * CELLS * DIRECTIONS), np.float32)
    quantized = np.empty(raw.shape if not as_float else (0, 0), np.uint8)
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
        normalize(raw[block], root, 1.0 if as_float else QUANTUM)
        if not as_float:
            quantized[block] = to_bytes(raw[block])

    run_in_blocks(fill, len(raw), BLOCK, threads)
    return raw if as_float else quantized


def describe_literally(
    octave: Float32Array, frames: Frames, angle: Float32Array, as_float: bool
) -> Descriptors:
    """The descriptors of points in one octave as section B.2 prints them.

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        frames: the n points.
        angle: (n,) in radians from x towards y.
        as_float: give float32 of unit length in the place of bytes.

    Returns:
        (n, 128), ordered as those of `describe_frames`.
    """
    from saccade.textbook.sift import descriptor as printed_descriptor  # with SciPy: not for all

    vectors = np.empty((len(angle), CELLS * CELLS * DIRECTIONS), np.float32)
    for i, (plane, (x, y), sigma) in enumerate(zip(*frames, strict=True)):
        vectors[i] = printed_descriptor(octave[plane], x, y, sigma, angle[i]).vector
    # The bins of the textbook turn from x towards y, those of keypoints from y towards x.
    vectors = vectors.reshape(-1, CELLS**2, DIRECTIONS)[:, :, -np.arange(DIRECTIONS)]
    vectors = vectors.reshape(-1, CELLS**2 * DIRECTIONS)
    return vectors if as_float else to_bytes(QUANTUM * vectors)


def to_bytes(scaled: Float32Array) -> ByteArray:
    """Entries rounded to whole numbers, those over 255 to 255."""
    return (np.minimum(scaled, np.float32(255)) + np.float32(0.5)).astype(np.uint8)


def room_for(sigma: Float32Array, side: float, spacing: float) -> int:
    """Samples that a turned square of some scales to a side may hold, at most."""
    widest = float(sigma.max(initial=0))
    # A stride is rounded: it may be down to two thirds of what was asked for.
    stride = max(spacing * widest / 1.5, 1.0)
    return int((side * widest / stride + 4) ** 2)
