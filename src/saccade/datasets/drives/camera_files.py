"""Camera calibrations in YAML and XML from ROS (camera_info.yaml), OpenCV, Kalibr and EuRoC."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from saccade.errors import ConfigError, DriveError
from saccade.frames import LENSES, Camera
from saccade.io.files import natural_order, one_line, read_text
from saccade.types import FloatArray

CALIBRATIONS = "cam|calib|intrinsic|^ost$"
"""Pattern of file names that must be calibrations; other files may have any content."""
UNREADABLE = (SystemError, OSError, LookupError, AttributeError, TypeError, ValueError)
"""Exceptions raised for a file that is not a calibration; OpenCV raises SystemError."""


def lens_of(model: str, coefficients: Sequence[float], name: str) -> dict[str, Any]:
    """The fields `lens` and `distortion` of a camera.

    Args:
        model: name of the lens model in the file; empty if it has none.
        coefficients: coefficients in OpenCV's order.
        name: name of the file, for error messages.

    Raises:
        DriveError: an unknown lens model, or a number of coefficients that it does not have.
    """
    letters = re.sub("[^a-z]", "", model.lower())
    for lens, row in LENSES.items():
        if re.fullmatch(row.names, letters) and len(coefficients) in row.counts:
            is_ideal = lens == "pinhole" and not any(coefficients)
            return {"lens": lens, "distortion": () if is_ideal else tuple(coefficients)}
    counts = ", ".join(f"{name} with {_either(row.counts)}" for name, row in LENSES.items())
    raise DriveError(
        f"{name}: expected the lens {counts} coefficients, found {model!r} with "
        f"{len(coefficients)}; undistort the images first"
    )


def _either(counts: Sequence[int]) -> str:
    *some, last = map(str, counts)
    return f"{', '.join(some)} or {last}" if some else last


class CameraFile(NamedTuple):
    """A camera in a calibration file."""

    name: str
    """Name of the file, and of the camera in it."""
    camera: Camera
    """Camera of the images as recorded."""
    rectified: Camera | None
    """Camera of the images that another program rectifies; None if unknown."""
    offset: float
    """Position of the rectified camera in the pair, in meters to the right of the left one."""


def camera_file(
    name: str,
    matrix: FloatArray,
    size: tuple[int, int],
    lens: tuple[str, Sequence[float]],
    projection: FloatArray,
) -> CameraFile:
    """A camera from the entries that ROS and OpenCV write.

    Args:
        name: name of the file, for error messages.
        matrix: (3, 3) camera matrix of the images as recorded.
        size: width and height in pixels.
        lens: name of the lens model, and distortion coefficients.
        projection: (3, 4) of the rectified images; zeros if unknown.

    Raises:
        DriveError: an unknown lens model, or a number out of range.
    """
    try:
        camera = Camera.from_matrix(matrix, size, **lens_of(*lens, name))
        focal = float(projection[0, 0])
        if focal <= 0:
            return CameraFile(name, camera, None, 0.0)
        rectified = Camera.from_matrix(projection, size)
        return CameraFile(name, camera, rectified, -float(projection[0, 3]) / focal)
    except ConfigError as error:
        raise DriveError(f"{name}: {error}") from error


def find_cameras(folder: Path, size: tuple[int, int]) -> list[CameraFile]:
    """The cameras in the calibration files of a folder, sorted by name.

    `size` is the width and height of the images, for files without it.

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
            cameras += [_camera(f"{file}, {key}", content[key], "", size) for key in nested]
            if not nested:
                cameras += [_camera(str(file), content, each, size) for each in ("", "1", "2")]
        except DriveError:
            raise
        except UNREADABLE as error:
            if re.search(CALIBRATIONS, file.stem.lower()):
                reason = "expected a calibration from ROS or OpenCV, found other text"
                reason = one_line(error) if isinstance(error, OSError) else reason
                raise DriveError(f"{file}: {reason}") from error
    return [each for each in cameras if each is not None]


def read_camera_file(path: Path, size: tuple[int, int]) -> CameraFile:
    """The only camera of a file; `size` is that of the images, for a file without it.

    Raises:
        DriveError: the file is no calibration, or has another lens model.
    """
    try:
        camera = _camera(str(path), _parse(path), "", size)
    except DriveError:
        raise
    except UNREADABLE as error:
        reason = one_line(error) if isinstance(error, OSError) else "found other text"
        raise DriveError(f"{path}: expected a calibration of a camera: {reason}") from error
    if camera is None:
        raise DriveError(f"{path}: expected intrinsics of a camera, found none")
    return camera


def sensor_pose(path: Path) -> FloatArray:
    """The pose (4, 4) of a sensor in the body: `T_BS` of EuRoC's sensor.yaml.

    Raises:
        DriveError: the file has no such pose.
    """
    try:
        pose = np.reshape(np.array(_parse(path)["T_BS"]["data"], np.float64), (4, 4))
    except UNREADABLE as error:
        raise DriveError(f"{path}: expected T_BS with a (4, 4) matrix, found none") from error
    R = pose[:3, :3]
    if not (np.isfinite(pose).all() and np.abs(R @ R.T - np.eye(3)).max() < 1e-3):
        raise DriveError(f"{path}: expected T_BS with a rotation, found {pose.tolist()}")
    return pose


def _parse(path: Path) -> Any:
    """The content of a file, read by OpenCV; YAML is adapted to its parser.

    Type tags are removed, since OpenCV may loop forever on a broken tag.

    Raises:
        ValueError: OpenCV cannot read the file.
    """
    import cv2  # slow to import

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

    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        return value(storage.root())  # nodes are valid only while their storage exists
    except cv2.error as error:
        raise ValueError(error.err) from error


def _camera(
    name: str, content: dict[str, Any], number: str, size: tuple[int, int]
) -> CameraFile | None:
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
    width, height = (
        numbers("resolution", "imagesize") or [each for each in sizes if each][:2] or size
    )
    models = [str(entries.get(key, "")) for key in ("cameramodel", "distortionmodel")]
    models += ["fisheye"] if entries.get("fisheyemodel") else []
    model = " ".join(each for each in models if each not in ("", "pinhole"))
    distortion = numbers(
        *("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distcoeff", "dist", "d")
    )
    projection = numbers("projectionmatrix", "p")
    return camera_file(
        name,
        np.reshape(matrix, (3, 3)),
        (int(width), int(height)),
        (model, distortion),
        np.reshape(projection if len(projection) == 12 else np.zeros(12), (3, 4)),
    )
