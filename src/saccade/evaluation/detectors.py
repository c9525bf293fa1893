"""Detectors by name: those of this package, peers, and any callable of the user."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, TypeAlias, cast

import cv2
import numpy as np

from saccade.errors import ConfigError
from saccade.exchange.colmap import import_pycolmap
from saccade.exchange.opencv import from_opencv
from saccade.extras import import_function
from saccade.io.image import as_gray
from saccade.keypoints import Must, MustConfig, Sift, SiftConfig, SymRoid, SymRoidConfig
from saccade.types import Float32Array, Keypoints

Detector: TypeAlias = Callable[[Float32Array], Any]
"""From an (H, W, 3) image in [0, 1] to an object with xy (n, 2) and descriptors (n, d)."""

OURS: dict[str, tuple[Any, Any, dict[str, float | None]]] = {
    "sift": (Sift, SiftConfig, {"contrast_threshold": None}),
    "must": (Must, MustConfig, {"contrast_threshold": None}),
    "symroid": (SymRoid, SymRoidConfig, {"seed_threshold": 1e-3}),
}
"""Class, configuration, and the threshold that passes all but rounding errors."""
NAMES = (*OURS, "opencv", "opencv-root", "colmap")
"""All names besides module:callable."""
UNLIMITED = 1_000_000
"""Keypoints of an image; COLMAP's default of 8192 truncates the richest images."""


def find_detector(name: str, settings: Any = None, max_keypoints: int | None = None) -> Detector:
    """The detector of a name.

    Keypoints are ordered by descending strength: SIFT's as `SiftConfig.ranking` has it, OpenCV's,
    MUST's and SymRoID's by response, COLMAP's by scale, those of a callable as it returns them.

    Args:
        name: one of `NAMES`, or module:callable.
        settings: configuration of one in `OURS`; None for the default.
        max_keypoints: number of keypoints to keep, the first in this order; one in `OURS` has as
            many, however weak. None for all above a threshold.

    Raises:
        ConfigError: there is no detector of this name, or a library is not installed.
    """
    if name in OURS:
        detector, default, threshold = OURS[name]
        settings = settings or default()
        if max_keypoints is not None:
            settings = replace(settings, max_keypoints=max_keypoints, **threshold)
        return cast("Detector", detector(settings))
    detect = _unlimited_detector(name)

    def first(image: Float32Array) -> Any:
        found = detect(image)
        if isinstance(found, Keypoints):
            return found[:max_keypoints]
        xy, descriptors = found.xy[:max_keypoints], found.descriptors[:max_keypoints]
        return SimpleNamespace(xy=xy, descriptors=descriptors)

    return detect if max_keypoints is None else first


def _unlimited_detector(name: str) -> Detector:
    if name in ("opencv", "opencv-root"):
        return _opencv(root=name == "opencv-root")
    if name == "colmap":
        return _colmap()
    if ":" in name:
        return _of_user(name)
    raise ConfigError(f"detector: expected {', '.join(NAMES)} or module:callable, found {name!r}")


def _opencv(root: bool) -> Detector:
    """OpenCV's SIFT with its defaults; it returns keypoints by location, hence the sorting.

    Args:
        root: whether to take the square roots of the L1-normalized descriptors: RootSIFT.
    """
    sift = cv2.SIFT.create()

    def detect(image: Float32Array) -> Any:
        gray = np.rint(as_gray(image) * 255).astype(np.uint8)
        keypoints, descriptors = sift.detectAndCompute(gray, None)
        points = from_opencv(keypoints, np.zeros((0, 128)) if descriptors is None else descriptors)
        points = points[np.argsort(-points.response, kind="stable")]
        if not root:
            return points
        rows = np.asarray(points.descriptors, np.float32)
        return replace(points, descriptors=np.sqrt(rows / rows.sum(axis=1, keepdims=True).clip(1)))

    return detect


def _colmap() -> Detector:
    """COLMAP's SIFT by descending scale: it has no responses, and prefers large keypoints."""
    pycolmap = import_pycolmap()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = UNLIMITED
    sift = pycolmap.FeatureExtractor.create(options)

    def detect(image: Float32Array) -> Any:
        gray = np.ascontiguousarray(as_gray(image), np.float32)
        keypoints, descriptors = sift.extract_from_float32_array(gray)
        # The center of its first pixel is (0.5, 0.5).
        xy = np.array([(each.x, each.y) for each in keypoints]).reshape(-1, 2) - 0.5
        points = Keypoints.at(xy, [2 * each.compute_scale() for each in keypoints])
        order = np.argsort(-points.size, kind="stable")
        return replace(points, descriptors=np.asarray(descriptors.data, np.uint8))[order]

    return detect


def _of_user(name: str) -> Detector:
    """The callable at module:callable, its results checked."""
    detector = import_function("detector", name)

    def detect(image: Float32Array) -> Any:
        result = detector(image)
        xy, descriptors = getattr(result, "xy", None), getattr(result, "descriptors", None)
        if xy is None or descriptors is None:
            found = type(result).__name__
            raise ConfigError(f"{name}: expected an object with xy and descriptors, found {found}")
        xy, descriptors = np.asarray(xy, np.float64), np.asarray(descriptors)
        if xy.ndim != 2 or xy.shape[1] != 2 or descriptors.ndim != 2 or len(xy) != len(descriptors):
            raise ConfigError(
                f"{name}: expected xy (n, 2) and descriptors (n, d), "
                f"found {xy.shape} and {descriptors.shape}"
            )
        return SimpleNamespace(xy=xy, descriptors=descriptors)

    return detect
