"""OpenCV's `cv2.KeyPoint`, in memory."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from saccade.exchange.fields import checked, keypoints_from
from saccade.types import Float32Array, Keypoints

INTERVALS, BASE_SIGMA = 3, 1.6
"""Of `cv2.SIFT_create()`: they say which plane of an octave a size belongs to."""


def to_opencv(keypoints: Keypoints) -> tuple[list[cv2.KeyPoint], Float32Array | None]:
    """Points as OpenCV's own detectors give them.

    The octave is packed with its plane as `cv2.SIFT` does, which can describe the points.
    OpenCV keeps an angle as float32 degrees: it comes back within 1e-6 rad.

    Args:
        keypoints: n points.

    Returns:
        n `cv2.KeyPoint`s; and (n, d) descriptors, float32 as matchers and SIFT want them,
        or None.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
    """
    points = checked("keypoints", keypoints)
    degrees = np.degrees(points.angle.astype(np.float64)) % 360
    rows = zip(
        *points.xy.T.tolist(),
        points.size.tolist(),
        degrees.tolist(),
        points.response.tolist(),
        _packed_octave(points).tolist(),
        strict=True,
    )
    found = [cv2.KeyPoint(*row) for row in rows]
    described = points.descriptors
    return found, None if described is None else described.astype(np.float32)


def from_opencv(
    points: Sequence[cv2.KeyPoint], descriptors: npt.ArrayLike | None = None
) -> Keypoints:
    """Points of any OpenCV detector, in their order.

    An angle of -1, OpenCV's word for none, becomes 0.

    Args:
        points: n `cv2.KeyPoint`s.
        descriptors: (n, d) whole numbers from 0 to 255 in any dtype, as `cv2.SIFT` gives
            them; None for none, which is also what OpenCV gives for no points.

    Raises:
        KeypointsError: the numbers do not fit, or are NaN.
    """
    n = len(points)
    degrees = np.array([point.angle for point in points], np.float64).reshape(n)
    octave = np.array([point.octave for point in points], np.int64).reshape(n) & 255
    return keypoints_from(
        "points",
        np.array([point.pt for point in points], np.float32).reshape(n, 2),
        np.array([point.size for point in points], np.float32),
        _half_turns(np.where(degrees == -1, 0, degrees)),
        np.array([point.response for point in points], np.float32),
        np.where(octave < 128, octave, octave - 256),
        descriptors,
    )


def _packed_octave(points: Keypoints) -> npt.NDArray[np.int64]:
    """Octave in the lowest byte, plane in the second, as `cv2.SIFT` packs them."""
    octave = points.octave.astype(np.int64)
    sigma = np.maximum(points.size, 1e-6) / 2.0 ** (octave + 1)
    plane = np.rint(INTERVALS * np.log2(sigma / BASE_SIGMA)).clip(0, INTERVALS + 1)
    packed: npt.NDArray[np.int64] = (octave & 255) | (plane.astype(np.int64) << 8)
    return packed


def _half_turns(degrees: npt.NDArray[np.float64]) -> Float32Array:
    """Angles in radians in (-pi, pi]."""
    turned = np.radians(180 - (180 - degrees) % 360).astype(np.float32)
    return np.where(turned <= np.float32(-np.pi), np.float32(np.pi), turned)
