"""Calibration of a camera on a robot as TOML: `camera.toml` beside the images.

width, height, fx, fy, cx, cy   pixels; required
baseline                        meters to the right camera of a rectified rig; default 0, no
                                right camera
lens                            lens model: "pinhole" (default) or "fisheye"
distortion                      coefficients of the lens as OpenCV orders them, such as
                                [k1, k2, p1, p2, k3]; default none
position                        [x, y, z] of the camera in the robot's frame, meters; default zeros
rotation                        three rows: from the camera's frame to the robot's; default
                                looking straight ahead
rate                            frames per second of a folder without times; default 30
depth_unit                      meters per step of an integer depth image; default 0.001
odometry_bias                   see `Drive.odometry_bias`; default zeros
start                           [x, y, heading] at the first frame; default the true pose, or
                                zeros
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saccade.datasets.drives.camera_files import read_camera_file
from saccade.datasets.tables import Archive
from saccade.errors import ConfigError, DriveError, Settings, setting
from saccade.frames import Camera
from saccade.io.files import atomic_write, read_toml, reading
from saccade.types import FloatArray

CAMERA_FILE = "camera.toml"
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_CAMERA = (*_INTRINSICS, "baseline", "position", "rotation", "lens", "distortion")
"""Attributes of `Camera` in the file."""
_OTHERS = ("rate", "depth_unit", "odometry_bias", "start")
"""Attributes of `Calibration` in the file."""


@dataclass(frozen=True, eq=False)
class Calibration(Settings):
    """Camera calibration and other constants of a drive."""

    camera: Camera
    """Camera of the images as recorded."""
    rate: float = setting(30.0, above=0, below=1e6)
    """Frames per second, if no file has the frame times."""
    depth_unit: float = setting(0.001, above=0, below=1e6)
    """Meters per step of an integer depth image."""
    odometry_bias: tuple[float, float, float] = setting((0.0, 0.0, 0.0), 0, below=1e6)
    """Standard deviations of systematic odometry errors, as in `Drive`."""
    start: tuple[float, float, float] | None = setting(None, -1e9, 1e9)
    """Pose at the first frame; None if unknown."""


def load_camera(path: str | Path, size: tuple[int, int] | None = None) -> Camera:
    """The camera of a calibration file: a drive's camera.toml, or YAML or XML of OpenCV or ROS.

    Args:
        path: file with one camera.
        size: width and height of the images, for a file without them.

    Raises:
        DriveError: the file is missing or no calibration, has another lens model, or no size.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        return read_calibration(path).camera
    return read_camera_file(path, size or (0, 0)).camera


def read_calibration(path: Path) -> Calibration:
    """Read a `camera.toml`."""
    values = read_toml(path, DriveError)
    known = (*_CAMERA, *_OTHERS)
    found = [repr(name) for name in sorted(values.keys() - set(known))]
    found += [f"no {name}" for name in _INTRINSICS if name not in values]
    if found:
        raise DriveError(f"{path}: expected {', '.join(known)}; found {found[0]}")
    with reading(path, DriveError, "numbers, and lists of numbers", TypeError, ValueError):
        lens = {"lens": values.pop("lens")} if "lens" in values else {}
        arrays = {name: np.array(value, np.float64) for name, value in values.items()}
    fields: dict[str, Any] = lens | {
        name: array if name in ("position", "rotation") else _number_or_tuple(array)
        for name, array in arrays.items()
    }
    try:
        camera = Camera(**{name: fields.pop(name) for name in [*fields] if name in _CAMERA})
        return Calibration(camera, **fields)
    except (ConfigError, TypeError) as error:  # TypeError: a number instead of a list
        raise DriveError(f"{path}: {error}") from error


def _number_or_tuple(array: FloatArray) -> float | tuple[float, ...]:
    return tuple(array.tolist()) if array.ndim else float(array)


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a `camera.toml` atomically, with every digit."""
    import tomli_w

    values = {name: getattr(calibration.camera, name) for name in _CAMERA}
    values |= {name: getattr(calibration, name) for name in _OTHERS}
    known = {
        name: np.asarray(value).tolist() if np.ndim(value) else value
        for name, value in values.items()
        if value is not None
    }
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(known), encoding="utf-8")


KITTI_HEIGHT = 1.65
"""Height of KITTI's cameras above the road in meters."""


def kitti_extrinsics(file: Path) -> dict[str, Any]:
    """Position (3,) and rotation (3, 3) of KITTI's camera on the robot, using `calib.npz` if any.

    The rotation of `cam_T_imu` maps the inertial unit's frame to the camera frame, but its
    translation is the camera's position in the inertial unit's frame. The height is KITTI's.
    """
    if not file.exists():
        return {"position": np.array([0.0, 0.0, KITTI_HEIGHT])}
    matrix = Archive(file).array("cam_T_imu", (4, 4)).astype(np.float64)
    position = np.array([matrix[0, 3], matrix[1, 3], KITTI_HEIGHT])
    return {"position": position, "rotation": np.ascontiguousarray(matrix[:3, :3].T)}
