"""OpenCV's keypoints, and the interface of `cv2.Feature2D` for programs that are written for it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, cast

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import OutputError, require
from saccade.exchange.fields import checked, keypoints_from
from saccade.io.files import atomic_write
from saccade.types import Float32Array, Keypoints

INTERVALS, BASE_SIGMA = 3, 1.6
"""Settings of `cv2.SIFT_create()` that relate the size of a point to the layer of its octave."""
FIRST_OCTAVE, LAST_OCTAVE = -1, 20
"""Octaves of `cv2.SIFT`: the first has twice the resolution of the image."""


def to_opencv(keypoints: Keypoints) -> tuple[list[cv2.KeyPoint], Float32Array | None]:
    """Convert to OpenCV's keypoints.

    The octave and layer follow from the size, as `cv2.SIFT` packs them, which can describe the
    points; `from_opencv` restores the octave of `Keypoints`, which may be another.
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
    columns = (*points.xy.T, points.size, degrees, points.response, _pack_octaves(points))
    rows = zip(*(values.tolist() for values in columns), strict=True)
    converted = [cv2.KeyPoint(*row) for row in rows]
    descriptors = points.descriptors
    return converted, None if descriptors is None else descriptors.astype(np.float32)


def from_opencv(
    points: Sequence[cv2.KeyPoint], descriptors: npt.ArrayLike | None = None
) -> Keypoints:
    """Convert the keypoints of any OpenCV detector; their order stays.

    An angle of -1, which is OpenCV's for none, becomes 0.

    Args:
        points: n `cv2.KeyPoint`s.
        descriptors: (n, d) whole numbers from 0 to 255 in any dtype, as `cv2.SIFT` gives them;
            None for none, which OpenCV also gives for no points.

    Raises:
        KeypointsError: the numbers do not fit, or are NaN.
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


def write_opencv(path: str | Path, keypoints: Keypoints) -> None:
    """Write YAML or XML for `cv::FileStorage`: matrices `keypoints` (n, 7) and `descriptors`.

    Args:
        path: such as points.yml.gz; written whole or not at all.
        keypoints: n points.

    Raises:
        OutputError: the file cannot be written.
    """
    points, descriptors = to_opencv(keypoints)
    rows = [[*p.pt, p.size, p.angle, p.response, p.octave, p.class_id] for p in points]
    with atomic_write(path) as temporary:
        file = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE)
        if not file.isOpened():
            raise OutputError(f"{path}: cannot be written by OpenCV")
        file.write("keypoints", np.array(rows, np.float64).reshape(-1, 7))
        none = np.zeros((0, DESCRIPTOR_SIZE))
        file.write("descriptors", none if descriptors is None else descriptors)
        file.release()


def _pack_octaves(points: Keypoints) -> npt.NDArray[np.int64]:
    """Octave, layer 1 to 3 and the rest of the scale in a byte each, as `cv2.SIFT` packs them.

    The octave is the one in which OpenCV has a layer of the size of a point. The highest byte,
    which OpenCV leaves 0, is by how much it is above the octave of `Keypoints`.
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


Points: TypeAlias = tuple[cv2.KeyPoint, ...]
DESCRIPTOR_SIZE = 128


class Feature2D:
    """A detector of this package with the methods of `cv2.Feature2D`.

    It takes the place of `cv2.SIFT_create()` in Python; OpenCV's classes in C++, such as
    `cv2.AffineFeature`, do not take it.

    Args:
        detector: called with an image, a mask and `describe=`, as `saccade.Sift()`. Its
            descriptors are RootSIFT unless it is configured otherwise
            (`SiftConfig(descriptor="sift")`), as float32.
        bgr: whether color images have OpenCV's order of colors.

    Examples:
        >>> sift = saccade.exchange.Feature2D(saccade.Sift())
        >>> keypoints, descriptors = sift.detectAndCompute(cv2.imread("photo.jpg"), None)
    """

    def __init__(self, detector: Callable[..., Keypoints], *, bgr: bool = True) -> None:
        self._detector = detector
        self._bgr = bgr

    def __repr__(self) -> str:
        return f"Feature2D({self._detector!r})"

    def detectAndCompute(
        self,
        image: Any,
        mask: Any = None,
        descriptors: None = None,
        useProvidedKeypoints: bool = False,
    ) -> tuple[Points, Float32Array | None]:
        """Keypoints, strongest first, and their descriptors.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4), or a `cv2.UMat`.
            mask: (H, W), keypoints are kept where it is not zero; None keeps all.
            descriptors: not used; OpenCV's output array.
            useProvidedKeypoints: False; see `compute` for keypoints from elsewhere.

        Returns:
            n keypoints, and (n, 128) float32; None where there are no keypoints.

        Raises:
            ImageError: not an image, or a mask of another shape.
            ConfigError: `useProvidedKeypoints`.
        """
        require(not useProvidedKeypoints, "useProvidedKeypoints", "False; use compute", True)
        keypoints = self._detector(self._rgb(image), _mask(mask))
        return _points(keypoints), _rows(keypoints)

    def detect(self, image: Any, mask: Any = None) -> Points:
        """Keypoints of an image."""
        return _points(self._detector(self._rgb(image), _mask(mask), describe=False))

    def compute(
        self, image: Any, keypoints: Sequence[Any], descriptors: None = None
    ) -> tuple[Points, Float32Array | None]:
        """Descriptors of keypoints from anywhere, along their angles (0 where OpenCV has -1).

        Args:
            image: see `detectAndCompute`.
            keypoints: n `cv2.KeyPoint`s.
            descriptors: not used; OpenCV's output array.

        Returns:
            The keypoints without those outside of the image or of no size, and their descriptors
            as `detectAndCompute` gives them.

        Raises:
            ImageError: not an image.
            ConfigError: the detector describes no points of others.
        """
        describe = getattr(self._detector, "describe", None)
        require(describe is not None, "detector", "one with `describe`", self._detector)
        pixels = self._rgb(image)
        height, width = pixels.shape[:2]
        inside = tuple(
            point
            for point in keypoints
            if point.size > 0
            and -0.5 <= point.pt[0] <= width - 0.5
            and -0.5 <= point.pt[1] <= height - 0.5
        )
        if not inside:
            return (), None
        return inside, _rows(cast("Any", describe)(pixels, from_opencv(inside)))

    def defaultNorm(self) -> int:
        """`cv2.NORM_L2`."""
        return cv2.NORM_L2

    def descriptorSize(self) -> int:
        """Entries of a descriptor."""
        return DESCRIPTOR_SIZE

    def descriptorType(self) -> int:
        """`cv2.CV_32F`."""
        return cv2.CV_32F

    def empty(self) -> bool:
        """False."""
        return False

    def clear(self) -> None:
        """Do nothing, since nothing is learned."""

    def getDefaultName(self) -> str:
        """The name of the detector."""
        return f"Feature2D.{type(self._detector).__name__}"

    def _rgb(self, image: Any) -> npt.NDArray[Any]:
        pixels = np.asarray(image.get() if isinstance(image, cv2.UMat) else image)
        if not self._bgr or pixels.ndim != 3:
            return pixels
        return pixels[:, :, [2, 1, 0, 3][: pixels.shape[2]]]


def _mask(mask: Any) -> Any:
    return mask.get() if isinstance(mask, cv2.UMat) else mask


def _points(keypoints: Keypoints) -> Points:
    return tuple(to_opencv(replace(keypoints, descriptors=None))[0])


def _rows(keypoints: Keypoints) -> Float32Array | None:
    if not len(keypoints) or keypoints.descriptors is None:
        return None
    return keypoints.descriptors.astype(np.float32)
