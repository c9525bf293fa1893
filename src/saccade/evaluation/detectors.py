"""Detectors by name: built-in detectors, peers, and user callables."""

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
"""Function from an (H, W, 3) image in [0, 1] to an object with xy (n, 2) and descriptors (n, d)."""

OURS: dict[str, tuple[Any, Any, dict[str, float | None]]] = {
    "sift": (Sift, SiftConfig, {"contrast_threshold": None}),
    "must": (Must, MustConfig, {"contrast_threshold": None}),
    "symroid": (SymRoid, SymRoidConfig, {"seed_threshold": 1e-3}),
}
"""Class, configuration, and the settings that disable the contrast threshold."""
NAMES = (*OURS, "opencv", "opencv-root", "colmap")
"""All names besides module:callable."""
UNLIMITED = 1_000_000
"""Maximum keypoints per image for COLMAP, whose default of 8192 truncates textured images."""


def find_detector(name: str, settings: Any = None, max_keypoints: int | None = None) -> Detector:
    """Returns the detector with a given name.

    Keypoints are in descending order of strength: `SiftConfig.ranking` for SIFT, response for
    OpenCV, MUST and SymRoID, scale for COLMAP, and the returned order for a callable.

    Args:
        name: one of `NAMES`, or module:callable.
        settings: configuration of a built-in detector; None for the default.
        max_keypoints: number of keypoints to keep, strongest first; built-in detectors return this
            many, however weak. None for all above the threshold.

    Raises:
        ConfigError: unknown detector, or a library is not installed.
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
    """OpenCV's SIFT with its defaults, sorted by response, since OpenCV sorts by location.

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
    """COLMAP's SIFT in descending order of scale, since it has no responses."""
    pycolmap = import_pycolmap()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = UNLIMITED
    sift = pycolmap.FeatureExtractor.create(options)

    def detect(image: Float32Array) -> Any:
        gray = np.ascontiguousarray(as_gray(image), np.float32)
        keypoints, descriptors = sift.extract_from_float32_array(gray)
        # COLMAP's first pixel has its center at (0.5, 0.5).
        xy = np.array([(each.x, each.y) for each in keypoints]).reshape(-1, 2) - 0.5
        points = Keypoints.at(xy, [2 * each.compute_scale() for each in keypoints])
        order = np.argsort(-points.size, kind="stable")
        return replace(points, descriptors=np.asarray(descriptors.data, np.uint8))[order]

    return detect


def _of_user(name: str) -> Detector:
    """The user's detector module:callable, with checked results."""
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
