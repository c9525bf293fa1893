"""The SIFT descriptor, used by all detectors (section B.2)."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.keypoints._gradient_kernels import (
    CELL_SIZE,
    CELLS,
    DIRECTIONS,
    fill_descriptors,
    normalize,
)
from saccade.keypoints.descriptor_config import DescriptorConfig
from saccade.keypoints.orientation import max_samples
from saccade.keypoints.scale_space_points import Points, run_by_octave
from saccade.scale.workspace import SERIAL, Threads
from saccade.types import Float32Array, IntArray

ByteArray: TypeAlias = npt.NDArray[np.uint8]
Descriptors: TypeAlias = ByteArray | Float32Array

LENGTH = CELLS * CELLS * DIRECTIONS
BYTE_SCALE = 512
"""Length of a unit descriptor in bytes."""


def describe_points(
    octaves: Sequence[Float32Array],
    points: Points,
    config: DescriptorConfig,
    threads: Threads = SERIAL,
) -> Descriptors:
    """The descriptors of points in a scale space (section B.2).

    Args:
        octaves: each (s + 3, h, w) Gaussian planes.
        points: n points in them.
        config: kind and sampling.
        threads: share the points.

    Returns:
        (n, 128) bytes or floats of unit length, rows of subregions along the angle; the
        directions in a subregion turn from y towards x, as in OpenCV.

    Source: Lowe (2004), section 6; Arandjelovic & Zisserman (2012) for the root.
    """
    vectors_of = printed_vectors if config.descriptor == "kootstra2010" else descriptor_vectors
    dtype = np.dtype(config.descriptor_dtype)
    descriptors: Descriptors = np.empty((len(points.octave), LENGTH), dtype)

    def fill(octave: Float32Array, index: IntArray) -> None:
        vectors = vectors_of(octave, points.take(index), config)
        descriptors[index] = quantized(vectors) if dtype == np.uint8 else vectors

    run_by_octave(fill, octaves, points, threads)
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


def printed_vectors(octave: Float32Array, points: Points, config: DescriptorConfig) -> Float32Array:
    """(n, 128) descriptors as section B.2 prints them, ordered as `descriptor_vectors`."""
    from saccade.textbook.sift import descriptor as printed_descriptor  # with SciPy: not for all

    vectors = np.empty((len(points.plane), LENGTH), np.float32)
    for i, (plane, (x, y), sigma, angle) in enumerate(
        zip(points.plane, points.xy, points.sigma, points.angle, strict=True)
    ):
        vectors[i] = printed_descriptor(octave[plane], x, y, sigma, angle).vector
    # The bins of the textbook turn from x towards y, those of keypoints from y towards x.
    cells = vectors.reshape(-1, CELLS**2, DIRECTIONS)[:, :, -np.arange(DIRECTIONS)]
    return cells.reshape(-1, LENGTH)


def quantized(vectors: Float32Array) -> ByteArray:
    """Unit vectors as bytes: `BYTE_SCALE` to the unit, at most 255."""
    scaled: Float32Array = np.minimum(np.float32(BYTE_SCALE) * vectors, np.float32(255))
    return (scaled + np.float32(0.5)).astype(np.uint8)
