"""Camera calibrations in YAML and XML from ROS (camera_info.yaml), OpenCV, Kalibr and EuRoC."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from saccade.errors import DriveError
from saccade.io.files import natural_order, one_line, read_text
from saccade.types import FloatArray

CALIBRATIONS = "cam|calib|intrinsic|^ost$"
"""Pattern of file names that must be calibrations; other files may have any content."""
PINHOLE = (
    "|none|pinhole|plumbbob|rationalpolynomial|radialtangential|radtan|brown(conrad(y|ie))?|opencv"
)
"""Pattern for names of the lens model with coefficients k1, k2, p1, p2, k3, in letters only."""
OTHER_LENSES = "fish|equi|kannala|fov|atan|omni|mei|unified|sphere|scaramuzza|inverse"
"""Pattern for names of other lens models, in letters only."""
UNREADABLE = (cv2.error, SystemError, OSError, LookupError, AttributeError, TypeError, ValueError)
"""Exceptions raised for a file that is not a calibration; OpenCV raises SystemError."""


def distortion_of(model: str, coefficients: Sequence[float], name: str) -> tuple[float, ...]:
    """None, four or five coefficients of OpenCV's pinhole model: k1, k2, p1, p2, k3.

    Args:
        model: name of the lens model in the file; empty if it has none.
        coefficients: coefficients in the model's order.
        name: name of the file, for error messages.

    Raises:
        DriveError: another lens model, or higher coefficients that are not zero.
    """
    known = re.fullmatch(PINHOLE, re.sub("[^a-z]", "", model.lower()))
    if not known or any(coefficients[5:]) or len(coefficients) in (1, 2, 3):
        raise DriveError(
            f"{name}: expected a pinhole camera with distortion as plumb_bob, of up to five "
            f"coefficients, found {model!r} with {len(coefficients)}; undistort the images first"
        )
    return tuple(coefficients[:5]) if any(coefficients) else ()


class CameraFile(NamedTuple):
    """A camera in a calibration file."""

    name: str
    """Name of the file, and of the camera in it."""
    size: list[float]
    """Width and height in pixels; empty if unknown."""
    matrix: FloatArray
    """(3, 3) intrinsics of raw images."""
    distortion: list[float]
    model: str
    """Name of the lens model."""
    projection: FloatArray
    """(3, 4) of rectified images; zero if unknown."""


def find_cameras(folder: Path) -> list[CameraFile]:
    """The cameras in the calibration files of a folder, sorted by name.

    Raises:
        DriveError: a file with the name of a calibration has other content.
    """
    cameras = list[CameraFile | None]()
    for file in sorted(folder.iterdir(), key=natural_order):
        if file.suffix.lower() not in (".yaml", ".yml", ".xml"):
            continue
        try:
            content = _parse(file)
            nested = [key for key in content if re.fullmatch(r"cam\d+", key)]
            cameras += [_camera(f"{file}, {key}", content[key], "") for key in nested]
            cameras += [_camera(str(file), content, each) for each in ("", "1", "2") if not nested]
        except UNREADABLE as error:
            if re.search(CALIBRATIONS, file.stem.lower()):
                reason = "expected a calibration from ROS or OpenCV, found other text"
                reason = one_line(error) if isinstance(error, OSError) else reason
                raise DriveError(f"{file}: {reason}") from error
    return [each for each in cameras if each is not None]


def _parse(path: Path) -> Any:
    """The content of a file, read by OpenCV; YAML is adapted to its parser.

    Type tags are removed, since OpenCV may loop forever on a broken tag.
    """
    text = re.sub(r"![\w!-]+|type_id=\S+?(?=[\s>])", "", read_text(path))
    if path.suffix.lower() != ".xml":
        text = re.sub(r"(?m)^(%YAML.*|---.*|\.\.\.)$", "", text)
        text = "%YAML:1.0\n---\n" + re.sub(r"(?m)^( *)- ", r"\1  - ", text)

    def value(node: Any) -> Any:
        if node.isMap():
            return {key: value(node.getNode(key)) for key in node.keys()}  # noqa: SIM118
        if node.isSeq():
            return [value(node.at(i)) for i in range(node.size())]
        return node.string() if node.isString() else node.real()

    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    return value(storage.root())  # nodes are valid only while their storage exists


def _camera(name: str, content: dict[str, Any], number: str) -> CameraFile | None:
    """Camera from the entries of a file; in stereo files the keys end in a number."""
    entries = {re.sub("[^a-z0-9]", "", key.lower()): value for key, value in content.items()}

    def numbers(*keys: str) -> list[float]:
        value: Any = next((entries[key + number] for key in keys if key + number in entries), [])
        array = np.array(value["data"] if isinstance(value, dict) else value, np.float64)
        return array.ravel().tolist()

    matrix, focal = numbers("cameramatrix", "k", "m", "mtx"), numbers("intrinsics")
    if not matrix and len(focal) == 4:
        matrix = [focal[0], 0, focal[2], 0, focal[1], focal[3], 0, 0, 1]
    if len(matrix) != 9:
        return None
    sizes = [entries.get(f"{each}{axis}") for each in ("image", "") for axis in ("width", "height")]
    models = [str(entries.get(key, "")) for key in ("cameramodel", "distortionmodel")]
    models += ["fisheye"] if entries.get("fisheyemodel") else []
    projection = numbers("projectionmatrix", "p")
    return CameraFile(
        name=name,
        size=numbers("resolution", "imagesize") or [each for each in sizes if each][:2],
        matrix=np.reshape(matrix, (3, 3)),
        distortion=numbers(
            *("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "dist", "d")
        ),
        model=" ".join(each for each in models if each not in ("", "pinhole")),
        projection=np.reshape(projection if len(projection) == 12 else np.zeros(12), (3, 4)),
    )
