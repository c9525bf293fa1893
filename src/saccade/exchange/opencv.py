"""OpenCV's keypoints."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from saccade.io.keypoint_fields import checked, keypoints_from
from saccade.types import Float32Array, Keypoints

INTERVALS = 3
"""Layers per octave of `cv2.SIFT_create()`."""
BASE_SIGMA = 1.6
"""Blur of the first layer of `cv2.SIFT_create()`, in pixels of its octave."""
FIRST_OCTAVE = -1
"""First octave of `cv2.SIFT`, with twice the resolution of the image."""
LAST_OCTAVE = 20
"""Maximum octave that fits into the packed field."""


def to_opencv(keypoints: Keypoints) -> tuple[list[cv2.KeyPoint], Float32Array | None]:
    """Converts keypoints to OpenCV's.

    Octave and layer follow from the size and are packed as by `cv2.SIFT`, which can then describe
    the points; `from_opencv` restores the octave of `Keypoints`, which may differ. Angles are
    float32 degrees in OpenCV and are restored within 1e-6 rad.

    Args:
        keypoints: n points.

    Returns:
        n `cv2.KeyPoint`s; and (n, d) descriptors in float32, as used by matchers and SIFT, or None.

    Raises:
        KeypointsError: inconsistent shapes, or NaN.
    """
    points = checked("keypoints", keypoints)
    degrees = np.degrees(points.angle.astype(np.float64)) % 360
    columns = (*points.xy.T, points.size, degrees, points.response, _pack_octaves(points))
    rows = zip(*(values.tolist() for values in columns), strict=True)
    converted = [cv2.KeyPoint(*row) for row in rows]
    descriptors = points.descriptors
    return converted, None if descriptors is None else descriptors.astype(np.float32)


def from_opencv(
    points: Sequence[cv2.KeyPoint], descriptors: npt.ArrayLike | None = None
) -> Keypoints:
    """Converts the keypoints of any OpenCV detector, in the same order.

    OpenCV's angle of -1, which means none, becomes 0.

    Args:
        points: n `cv2.KeyPoint`s.
        descriptors: (n, d) numbers in any dtype. Integers from 0 to 255, as from `cv2.SIFT`,
            become bytes; others, as of RootSIFT, stay float32. None without descriptors or points.

    Raises:
        KeypointsError: invalid numbers, or NaN.
    """
    n = len(points)
    degrees = np.array([point.angle for point in points], np.float64).reshape(n)
    packed = np.array([point.octave for point in points], np.int64).reshape(n)
    octave, above = packed & 255, packed.clip(0) >> 24  # 0 in octaves of OpenCV
    return keypoints_from(
        "points",
        np.array([point.pt for point in points], np.float32).reshape(n, 2),
        descriptors,
        size=np.array([point.size for point in points], np.float32),
        angle=_wrap_to_radians(np.where(degrees == -1, 0, degrees)),
        response=np.array([point.response for point in points], np.float32),
        octave=np.where(octave < 128, octave, octave - 256)
        - np.where(above < 64, above, above - 128),
    )


def _pack_octaves(points: Keypoints) -> npt.NDArray[np.int64]:
    """Packs octave, layer 1 to 3 and fractional scale into one byte each, as `cv2.SIFT` does.

    The octave has an OpenCV layer for the size of the point. The highest byte, which is 0 in
    OpenCV, stores the difference from the octave of `Keypoints`.
    """
    sigma = np.maximum(points.size.astype(np.float64), 1e-6) / 2
    scale = INTERVALS * np.log2(sigma / BASE_SIGMA)  # 1 to 3 in octave 0
    octave = np.floor((scale - 0.5) / INTERVALS).clip(FIRST_OCTAVE, LAST_OCTAVE)
    layer = np.rint(scale - INTERVALS * octave).clip(1, INTERVALS)
    rest = np.rint((scale - INTERVALS * octave - layer + 0.5) * 255).clip(0, 255)
    packed: npt.NDArray[np.int64]
    octave, layer, rest = (values.astype(np.int64) for values in (octave, layer, rest))
    above = (octave - points.octave).clip(-64, 63) & 127
    packed = (octave & 255) | (layer << 8) | (rest << 16) | (above << 24)
    return packed


def _wrap_to_radians(degrees: npt.NDArray[np.float64]) -> Float32Array:
    """Angles in radians in (-pi, pi]."""
    wrapped = np.radians(180 - (180 - degrees) % 360).astype(np.float32)
    return np.where(wrapped <= np.float32(-np.pi), np.float32(np.pi), wrapped)
