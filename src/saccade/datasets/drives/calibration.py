"""Calibration of a camera on a robot as TOML: `camera.toml` beside the images.

width, height, fx, fy, cx, cy   pixels; required
baseline                        metres to the right camera of a rectified rig; default 0, no
                                right camera
distortion                      k1, k2, p1, p2 and optionally k3 of OpenCV; default none
place                           [x, y, z] of the camera in the robot's frame, metres; default zeros
rotation                        three rows: from the camera's frame to the robot's; default
                                looking straight ahead
rate                            frames per second of a folder without times; default 30
depth_unit                      metres per step of a depth image; default 0.001
odometry_bias                   as that of `Drive`; default zeros
start                           [x, y, heading] at the first frame; default that of the ground
                                truth, or zeros
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from saccade.datasets.tables import Archive
from saccade.errors import ConfigError, DriveError, Settings, require, setting
from saccade.frames import Camera
from saccade.io.files import atomic_write, read_toml, reading
from saccade.types import Float32Array, FloatArray, Image

CAMERA_FILE = "camera.toml"
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_EXTRINSICS = {"baseline": "baseline", "place": "position", "rotation": "rotation"}
_CAMERA = {name: name for name in _INTRINSICS} | _EXTRINSICS
"""Attributes of `Camera` by their names in the file."""
_OTHERS = ("distortion", "rate", "depth_unit", "odometry_bias", "start")


@dataclass(frozen=True, eq=False)
class Calibration(Settings):
    """A camera, and the other constants of its drive."""

    camera: Camera
    """Without the distortion."""
    distortion: tuple[float, ...] = ()
    """None, four or five coefficients: k1, k2, p1, p2, k3 of OpenCV."""
    rate: float = setting(30.0, above=0, below=1e6)
    """Frames per second, where no file has their times."""
    depth_unit: float = setting(0.001, above=0, below=1e6)
    """Metres per step of a depth image."""
    odometry_bias: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 0, below=1e6)
    """Standard deviations of systematic odometry errors, as in `Drive`."""
    start: tuple[float, float, float] | None = setting(None, -1e9, 1e9)
    """Pose at the first frame; None where it is not known."""

    def __post_init__(self) -> None:
        super().__post_init__()
        known = len(self.distortion) in (0, 4, 5) and np.isfinite(self.distortion).all()
        require(bool(known), "distortion", "k1, k2, p1, p2 and perhaps k3", self.distortion)


def read_calibration(path: Path) -> Calibration:
    """Read a `camera.toml`.

    Raises:
        DriveError: the file is missing, is no TOML, or a value is missing, unknown or invalid;
            names it.
    """
    values = read_toml(path, DriveError)
    known = (*_CAMERA, *_OTHERS)
    unknown = sorted(set(values) - set(known))
    missing = [name for name in _INTRINSICS if name not in values]
    if unknown or missing:
        found = f"{unknown[0]!r}" if unknown else f"no {', '.join(missing)}"
        raise DriveError(f"{path}: expected {', '.join(known)}; found {found}")
    with reading(path, DriveError, "numbers, and lists of numbers", TypeError, ValueError):
        arrays = {name: np.array(value, np.float64) for name, value in values.items()}
    numbers = {n: tuple(each.tolist()) if each.ndim else float(each) for n, each in arrays.items()}
    camera: dict[str, Any] = {_CAMERA[name]: numbers[name] for name in _CAMERA if name in numbers}
    camera |= {_CAMERA[name]: arrays[name] for name in ("place", "rotation") if name in arrays}
    others: dict[str, Any] = {name: numbers[name] for name in _OTHERS if name in numbers}
    try:
        return Calibration(Camera(**camera), **others)
    except (ConfigError, TypeError) as error:  # TypeError: a number in place of several
        raise DriveError(f"{path}: {error}") from error


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a `camera.toml` atomically, with every digit.

    Raises:
        OutputError: the file cannot be written.
    """
    import tomli_w

    camera = calibration.camera
    values = {name: getattr(camera, attribute) for name, attribute in _CAMERA.items()}
    values |= {name: getattr(calibration, name) for name in _OTHERS}
    known = {name: value for name, value in values.items() if value is not None}
    values = {n: np.asarray(v).tolist() if np.ndim(v) else v for n, v in known.items()}
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(values), encoding="utf-8")


KITTI_HEIGHT = 1.65
"""Metres of KITTI's cameras above the road."""


def kitti_extrinsics(file: Path) -> dict[str, Any]:
    """Position (3,) and rotation (3, 3) of KITTI's camera on the robot, by a `calib.npz` if any.

    Its `cam_T_imu` has the rotation from the frame of the inertial unit to that of the camera, but
    its translation is the position of the camera in the frame of the unit. The height is KITTI's.
    """
    if not file.exists():
        return {"position": np.array([0.0, 0.0, KITTI_HEIGHT])}
    matrix = Archive(file).array("cam_T_imu", (4, 4)).astype(np.float64)
    position = np.array([matrix[0, 3], matrix[1, 3], KITTI_HEIGHT])
    return {"position": position, "rotation": np.ascontiguousarray(matrix[:3, :3].T)}


@dataclass(frozen=True, eq=False)
class Lens:
    """Maps the images of a camera with distortion to those of a pinhole camera."""

    camera: Camera
    """The pinhole camera; both have its intrinsics."""
    distortion: tuple[float, ...]
    """k1, k2, p1, p2 and optionally k3 of OpenCV."""

    def undistort(self, pixels: Image, interpolation: int = cv2.INTER_LINEAR) -> Image:
        """The image of the pinhole camera; black outside the field of view of the lens."""
        return cv2.remap(pixels, *self._maps, interpolation)

    @cached_property
    def _maps(self) -> tuple[Float32Array, Float32Array]:
        K, size = camera_matrix(self.camera), (self.camera.width, self.camera.height)
        distortion = np.array(self.distortion)
        x, y = cv2.initUndistortRectifyMap(K, distortion, np.eye(3), K, size, cv2.CV_32FC1)
        return np.asarray(x, np.float32), np.asarray(y, np.float32)


def pinhole(matrix: FloatArray, size: tuple[int, int], **extrinsics: Any) -> Camera:
    """The camera with a matrix (3, 3) or a projection (3, 4), and a width and height in pixels.

    `extrinsics`: baseline, position and rotation of `Camera`.
    """
    return Camera(
        width=int(size[0]),
        height=int(size[1]),
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]),
        cy=float(matrix[1, 2]),
        **extrinsics,
    )


def camera_matrix(camera: Camera) -> FloatArray:
    """(3, 3) intrinsics of a camera."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
