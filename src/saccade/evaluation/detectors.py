"""Detectors for evaluation: those of the table, peers, and user functions."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import cv2
import numpy as np

from saccade.errors import require
from saccade.exchange.colmap import import_pycolmap
from saccade.exchange.opencv import from_opencv
from saccade.io.image import as_gray
from saccade.keypoints.detectors import DETECTORS, OWN, make_detector
from saccade.types import Float32Array, Keypoints

EvaluatedDetector: TypeAlias = Callable[[Float32Array], Any]
"""Function from an (H, W, 3) image in [0, 1] to an object with xy (n, 2) and descriptors (n, d)."""

UNLIMITED = 1_000_000
"""Maximum keypoints per image for COLMAP, whose default of 8192 truncates textured images."""


def find_detector(
    detector: str | Callable[..., Any], settings: Any = None, max_keypoints: int | None = None
) -> EvaluatedDetector:
    """Returns the detector with a given name.

    Keypoints are in descending order of strength: `SiftConfig.ranking` for SIFT, response for
    OpenCV, MUST and SymRoID, scale for COLMAP, and the returned order for a function.

    Args:
        detector: a name in `DETECTORS` or `PEERS`, or a function; see `make_detector`.
        settings: of a detector in the table; None for the default.
        max_keypoints: number of keypoints to keep, strongest first; detectors in the table return
            this many, however weak. None for all above the threshold.

    Raises:
        ConfigError: unknown detector, or a library is not installed.
    """
    if not isinstance(detector, str) or ":" in detector:
        return make_detector(detector, settings, max_keypoints=max_keypoints)
    if detector in DETECTORS:
        if max_keypoints is not None:
            settings = DETECTORS[detector].by_number(settings, max_keypoints)
        return make_detector(detector, settings)
    expected = f"{', '.join((*DETECTORS, *PEERS))} or {OWN}"
    require(detector in PEERS, "detector", expected, detector)
    detect = PEERS[detector]()
    return lambda image: detect(image)[:max_keypoints]


def _opencv(root: bool = False) -> EvaluatedDetector:
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


def _colmap() -> EvaluatedDetector:
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


PEERS: dict[str, Callable[[], EvaluatedDetector]] = {
    "opencv": _opencv,
    "opencv-root": partial(_opencv, root=True),
    "colmap": _colmap,
}
"""Detectors of other libraries, with their defaults; their own thresholds always hold."""
