"""The interface of `cv2.Feature2D`, for programs that are written for `cv2.SIFT_create()`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeAlias, cast

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.exchange.opencv import from_opencv, to_opencv
from saccade.types import Float32Array, Image, Keypoints

Points: TypeAlias = tuple[cv2.KeyPoint, ...]
DESCRIPTOR_SIZE = 128


class Detector(Protocol):
    """`saccade.Sift`, or `saccade.Must`, which has no `describe`."""

    def __call__(
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect keypoints where the mask is not zero."""


class Feature2D:
    """A detector of this package with the methods of `cv2.Feature2D`.

    It takes the place of `cv2.SIFT_create()` in Python; OpenCV's classes in C++, such as
    `cv2.AffineFeature`, do not take it.

    Args:
        detector: such as `saccade.Sift()`. Its descriptors are RootSIFT unless it is configured
            otherwise (`SiftConfig(descriptor="sift")`), as float32.
        bgr: whether color images have OpenCV's order of colors.

    Examples:
        >>> sift = saccade.exchange.Feature2D(saccade.Sift())
        >>> keypoints, descriptors = sift.detectAndCompute(cv2.imread("photo.jpg"), None)
    """

    def __init__(self, detector: Detector, *, bgr: bool = True) -> None:
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

    def detect(self, image: Any, mask: Any = None) -> Points | tuple[Points, ...]:
        """Keypoints of an image, or of each of several with masks or None."""
        if not _is_image(image):
            masks = [None] * len(image) if mask is None else mask
            pairs = zip(image, masks, strict=True)
            return tuple(cast("Points", self.detect(*pair)) for pair in pairs)
        return _points(self._detector(self._rgb(image), _mask(mask), describe=False))

    def compute(
        self, image: Any, keypoints: Sequence[Any], descriptors: None = None
    ) -> tuple[tuple[Any, ...], Any]:
        """Descriptors of keypoints from anywhere, along their angles (0 where OpenCV has -1).

        Args:
            image: an image, or several.
            keypoints: n `cv2.KeyPoint`s, or as many sequences of them as there are images.
            descriptors: not used; OpenCV's output array.

        Returns:
            The keypoints without those outside of the image or of no size, and their descriptors
            as `detectAndCompute` gives them; of several images, a tuple of either for each.

        Raises:
            ImageError: not an image.
            ConfigError: the detector describes no points of others.
        """
        if not _is_image(image):
            pairs = zip(image, keypoints, strict=True)
            kept, rows = zip(*(self.compute(*pair) for pair in pairs), strict=True)
            return kept, rows
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


def _is_image(image: Any) -> bool:
    return isinstance(image, np.ndarray | cv2.UMat)


def _mask(mask: Any) -> Any:
    return mask.get() if isinstance(mask, cv2.UMat) else mask


def _points(keypoints: Keypoints) -> Points:
    return tuple(to_opencv(replace(keypoints, descriptors=None))[0])


def _rows(keypoints: Keypoints) -> Float32Array | None:
    if not len(keypoints) or keypoints.descriptors is None:
        return None
    return keypoints.descriptors.astype(np.float32)
