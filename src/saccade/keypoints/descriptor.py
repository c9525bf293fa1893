"""Orientations and the SIFT descriptor, used by all detectors (B.11-B.12 and section B.2)."""

from collections.abc import Sequence
from math import pi
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.keypoints._gradient_kernels import (
    CELL_SIZE,
    CELLS,
    DIRECTIONS,
    ORIENTATION_BINS,
    ORIENTATION_RADIUS,
    fill_descriptors,
    fill_orientation_histograms,
    normalize,
)
from saccade.keypoints.descriptor_config import DescriptorConfig
from saccade.keypoints.scale_space_points import Points, run_by_octave
from saccade.scale.workspace import SERIAL, Workspace
from saccade.types import Float32Array, IntArray

PEAK_RATIO = 0.8
"""Smallest height of an orientation's peak, as a fraction of the highest."""
LENGTH = CELLS * CELLS * DIRECTIONS
BYTE_SCALE = 512
"""Length of a unit descriptor in bytes."""


def assign_orientations(
    octaves: Sequence[Float32Array],
    points: Points,
    config: DescriptorConfig,
    max_orientations: int | None = None,
    workspace: Workspace = SERIAL,
) -> tuple[IntArray, Float32Array]:
    """The dominant orientations of the gradient around each point (B.11-B.12).

    Args:
        octaves: each (s + 3, h, w) Gaussian planes.
        points: n points in them.
        config: histogram and sampling.
        max_orientations: strongest orientations to keep of a point; None for all.
        workspace: its threads share the points.

    Returns:
        (m,) index of the point, ascending, and (m,) angle in radians from x towards y in
        (-pi, pi]. A point without any gradient around it has none.

    Source: Lowe (2004), section 5.
    """
    histograms = np.zeros((len(points.octave), ORIENTATION_BINS), np.float32)

    def fill(octave: Float32Array, index: IntArray) -> None:
        histograms[index] = orientation_histograms(octave, points.take(index), config)

    run_by_octave(fill, octaves, points, workspace)
    histograms = smoothed(histograms, config.smoothing)
    index, angle, height = histogram_peaks(histograms, config.orientation_bins == "all")
    if max_orientations is not None:
        order = np.lexsort((-height, index))
        rank = np.arange(len(index)) - np.searchsorted(index, index)
        strongest = np.sort(order[rank < max_orientations])
        index, angle = index[strongest], angle[strongest]
    return index, angle


def orientation_histograms(
    octave: Float32Array, points: Points, config: DescriptorConfig
) -> Float32Array:
    """(n, 36) histograms of gradient directions around points of one octave."""
    histograms = np.zeros((len(points.plane), ORIENTATION_BINS), np.float32)
    spacing = config.orientation_spacing or 0.0
    fill_orientation_histograms(
        octave,
        points.plane,
        points.xy,
        points.sigma,
        spacing,
        config.voting == "linear",
        config.subpixel_patches,
        min(max_samples(points.sigma, 2 * ORIENTATION_RADIUS, spacing), octave[0].size),
        histograms,
    )
    return histograms


def smoothed(histograms: Float32Array, passes: int) -> Float32Array:
    """(n, 36) circular histograms after passes of [1 2 1] / 4."""
    quarter, half = np.float32(0.25), np.float32(0.5)
    for _ in range(passes):
        sides = np.roll(histograms, 1, axis=1) + np.roll(histograms, -1, axis=1)
        histograms = quarter * sides + half * histograms
    return histograms


def histogram_peaks(
    histograms: Float32Array, every_bin: bool
) -> tuple[IntArray, Float32Array, Float32Array]:
    """Peaks of circular histograms, interpolated by a parabola.

    Args:
        histograms: (n, 36).
        every_bin: include every bin over `PEAK_RATIO` of the highest, not only local peaks.

    Returns:
        (m,) index of the histogram, ascending; (m,) angle in radians; (m,) height of the peak as a
        fraction of the highest.
    """
    before, after = np.roll(histograms, 1, axis=1), np.roll(histograms, -1, axis=1)
    highest = histograms.max(axis=1, keepdims=True, initial=0)
    # The second of two equal bins is the peak; symmetric patterns have equal bins.
    peaks = (histograms >= before) & (histograms > after) & (histograms >= PEAK_RATIO * highest)
    if every_bin:
        peaks = (histograms == highest) | (histograms > PEAK_RATIO * highest)
        peaks &= highest > 0
    index, bin_number = np.nonzero(peaks)
    left, middle, right = before[peaks], histograms[peaks], after[peaks]
    curvature = left - 2 * middle + right
    offset = 0.5 * (left - right) / curvature
    if every_bin:  # the highest point within a bin on a slope
        offset = np.where(curvature < 0, offset.clip(-0.5, 0.5), 0.5 * np.sign(right - left))
    position = bin_number + offset
    angle = np.remainder(position * (2 * pi / ORIENTATION_BINS) + pi, 2 * pi) - pi
    angle = angle.astype(np.float32)
    angle[angle <= np.float32(-pi)] = pi
    return index, angle, middle / highest[index, 0]


def max_samples(sigma: Float32Array, side: float, spacing: float) -> int:
    """Upper bound of the samples in a rotated square.

    Args:
        sigma: (n,) scales of the points.
        side: of the square, in scales.
        spacing: of the samples, in scales; 0 for all samples.
    """
    widest = float(sigma.max(initial=0))
    # A stride is rounded: it may be down to two thirds of the spacing.
    stride = max(spacing * widest / 1.5, 1.0)
    return int((side * widest / stride + 4) ** 2)


ByteArray: TypeAlias = npt.NDArray[np.uint8]
Descriptors: TypeAlias = ByteArray | Float32Array


def describe_points(
    octaves: Sequence[Float32Array],
    points: Points,
    config: DescriptorConfig,
    workspace: Workspace = SERIAL,
) -> Descriptors:
    """The descriptors of points in a scale space (section B.2).

    Args:
        octaves: each (s + 3, h, w) Gaussian planes.
        points: n points in them.
        config: kind and sampling.
        workspace: its threads share the points.

    Returns:
        (n, 128) bytes or floats of unit length, rows of subregions along the angle; the
        directions in a subregion turn from y towards x, as in OpenCV.

    Source: Lowe (2004), section 6; Arandjelovic & Zisserman (2012) for the root.
    """
    vectors_of = published_vectors if config.descriptor == "kootstra2010" else descriptor_vectors
    dtype = np.dtype(config.descriptor_dtype)
    descriptors: Descriptors = np.empty((len(points.octave), LENGTH), dtype)

    def fill(octave: Float32Array, index: IntArray) -> None:
        vectors = vectors_of(octave, points.take(index), config)
        descriptors[index] = quantized(vectors) if dtype == np.uint8 else vectors

    run_by_octave(fill, octaves, points, workspace)
    return descriptors


def descriptor_vectors(
    octave: Float32Array, points: Points, config: DescriptorConfig
) -> Float32Array:
    """(n, 128) descriptors of unit length of points in one octave."""
    vectors = np.empty((len(points.plane), LENGTH), np.float32)
    spacing = config.descriptor_spacing or 0.0
    fill_descriptors(
        octave,
        points.plane,
        points.xy,
        points.sigma,
        points.angle,
        config.window_sigma,
        spacing,
        config.subpixel_patches,
        min(max_samples(points.sigma, (CELLS + 1) * CELL_SIZE, spacing), octave[0].size),
        vectors,
    )
    normalize(vectors, config.descriptor == "root")
    return vectors


def published_vectors(
    octave: Float32Array, points: Points, config: DescriptorConfig
) -> Float32Array:
    """(n, 128) descriptors as section B.2 has them, ordered as `descriptor_vectors`."""
    from saccade.textbook.sift import descriptor as published_descriptor  # with SciPy: not for all

    vectors = np.empty((len(points.plane), LENGTH), np.float32)
    for i, (plane, (x, y), sigma, angle) in enumerate(
        zip(points.plane, points.xy, points.sigma, points.angle, strict=True)
    ):
        vectors[i] = published_descriptor(octave[plane], x, y, sigma, angle).vector
    # Directions of the textbook turn from x towards y, directions of keypoints from y towards x.
    cells = vectors.reshape(-1, CELLS**2, DIRECTIONS)[:, :, -np.arange(DIRECTIONS)]
    return cells.reshape(-1, LENGTH)


def quantized(vectors: Float32Array) -> ByteArray:
    """Unit vectors as bytes: `BYTE_SCALE` to the unit, at most 255."""
    scaled: Float32Array = np.minimum(np.float32(BYTE_SCALE) * vectors, np.float32(255))
    return (scaled + np.float32(0.5)).astype(np.uint8)
