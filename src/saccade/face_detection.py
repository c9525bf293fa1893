"""OpenCV's face detectors, from a model file or from the installed version of OpenCV.

OpenCV 4 bundles cascades (`.xml`), which are less reliable than YuNet (`.onnx`). OpenCV 5 bundles
no model.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from saccade.errors import ConfigError
from saccade.io.files import check_file, reading
from saccade.io.image import as_gray, check_image, in_unit_range

if TYPE_CHECKING:
    from collections.abc import Callable

    from saccade.types import FloatArray, Image

CASCADE = "haarcascade_frontalface_alt.xml"
"""The frontal cascade of OpenCV 4 with the fewest false faces."""
LONGER_SIDE = 800
"""Maximum longer side in pixels; larger images are reduced to it."""
MIN_SCORE = 0.7
"""Minimum score of a YuNet detection, up to 1."""
MIN_NEIGHBORS = 4
"""Minimum number of overlapping detections of a cascade for a face."""
MIN_FACE = 24
"""Minimum side of a face for a cascade, in pixels."""


def find_face_detector(model: Path | None = None) -> "Callable[[Image], FloatArray] | None":
    """A detector of faces.

    Args:
        model: YuNet's `.onnx` or a cascade's `.xml`; None for the cascade bundled with OpenCV.

    Returns:
        A function from an image to (n, 4) boxes: left, top, width and height in pixels; None if no
        file is given and OpenCV bundles no detector.

    Raises:
        ConfigError: the file is missing, or OpenCV cannot read it.
    """
    if model is None:
        model = _carried()
        if model is None:
            return None
    with reading(model, ConfigError, "a face detector of OpenCV (.onnx or .xml)", cv2.error):
        check_file(model)
        detect = _cascade(model) if model.suffix.lower() == ".xml" else _yunet(model)

    def boxes(image: "Image") -> "FloatArray":
        pixels = check_image(image)
        scale = min(1.0, LONGER_SIDE / max(pixels.shape[:2]))
        small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        levels = np.rint(in_unit_range(small) * 255).clip(0, 255).astype(np.uint8)
        found: FloatArray = np.asarray(detect(levels), np.float64).reshape(-1, 4) / scale
        return found

    return boxes


def _carried() -> Path | None:
    """The cascade bundled with OpenCV, or None."""
    folder = getattr(getattr(cv2, "data", None), "haarcascades", "")
    path = Path(folder) / CASCADE
    return path if path.is_file() and hasattr(cv2, "CascadeClassifier") else None


def _yunet(model: Path) -> "Callable[[Any], Any]":
    detector = cv2.FaceDetectorYN.create(str(model), "", (320, 320), MIN_SCORE)

    def detect(levels: Any) -> Any:
        rgb = levels if levels.ndim == 3 else np.repeat(levels[:, :, None], 3, 2)
        detector.setInputSize((rgb.shape[1], rgb.shape[0]))
        found = detector.detect(np.ascontiguousarray(rgb[:, :, ::-1]))[1]
        return [] if found is None else found[:, :4]

    return detect


def _cascade(model: Path) -> "Callable[[Any], Any]":
    make = getattr(cv2, "CascadeClassifier", None)
    if make is None:
        raise ConfigError(f"{model}: OpenCV {cv2.__version__} reads no cascades; give an .onnx")
    classifier = make(str(model))
    if classifier.empty():
        raise ConfigError(f"{model}: expected a cascade of OpenCV, found another file")

    def detect(levels: Any) -> Any:
        gray = np.rint(255 * as_gray(levels)).astype(np.uint8)
        return classifier.detectMultiScale(gray, 1.1, MIN_NEIGHBORS, minSize=(MIN_FACE, MIN_FACE))

    return detect
