"""The orientation and the descriptor of an interest point, used by all detectors.

Both look at the gradients around the point in the plane of the scale space
that is nearest to it in scale, and read its place and scale in samples of
that plane.
"""

from math import pi
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade._jit import spread
from saccade.keypoints.gradients import (
    CELL_SIZE,
    CELLS,
    DIRECTIONS,
    ORIENTATION_BINS,
    ORIENTATION_RADIUS,
    fill_descriptors,
    fill_orientation_bins,
    quantize,
    smooth_circles,
)
from saccade.types import Float32Array, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]

PEAK_RATIO = 0.8
"""A direction makes a point if it has this share of the strongest direction."""
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
        smooth_circles(bins[block], smoothing)

    spread(fill, len(bins), BLOCK, threads)
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
    """The descriptors of points in one octave (section B.2).

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
