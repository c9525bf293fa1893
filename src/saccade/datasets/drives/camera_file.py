"""Calibration of a camera on a robot as TOML: `camera.toml` beside the images.

width, height, fx, fy, cx, cy   pixels; all needed
baseline                        metres to the right camera of a rectified rig; 0
distortion                      k1, k2, p1, p2 and k3 of OpenCV; none
place                           [x, y, z] of the camera in the robot's frame, metres; zeros
rotation                        three rows: turns vectors of the camera into the robot's;
                                one that looks straight ahead
rate                            frames per second of a folder without times; 30
depth_unit                      metres of one step in a depth image; 0.001
odometry_bias                   as that of `Drive`; zeros
start                           [x, y, heading] of the first frame; that of the truth, or zeros
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saccade.errors import ConfigError, DriveError, require
from saccade.files import atomic_write, read_text
from saccade.frames import AHEAD, Camera
from saccade.types import FloatArray

CAMERA_FILE = "camera.toml"
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera, and what else has to be known to read its drive."""

    camera: Camera
    """Without the distortion."""
    distortion: tuple[float, ...] = ()
    """None, four or five coefficients: k1, k2, p1, p2, k3 of OpenCV."""
    rate: float = 30.0
    """Frames per second where no file tells their times."""
    depth_unit: float = 0.001
    """Metres of one step in a depth image."""
    odometry_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """As that of `Drive`."""
    start: tuple[float, float, float] | None = None
    """Pose at the first frame; None where nobody says."""

    def __post_init__(self) -> None:
        known = len(self.distortion) in (0, 4, 5)
        require(known, "distortion", "k1, k2, p1, p2 and perhaps k3", self.distortion)
        for name in ("rate", "depth_unit"):
            require(0 < getattr(self, name) < 1e6, name, "over 0, under 1e6", getattr(self, name))
        for name in ("odometry_bias", "start"):
            value = getattr(self, name)
            require(value is None or len(value) == 3, name, "three numbers", value)


def read_calibration(path: Path) -> Calibration:
    """Read a `camera.toml`.

    Raises:
        DriveError: the file is missing, is no TOML, or a value is missing, unknown or makes no
            sense; names it.
    """
    try:
        values = tomllib.loads(read_text(path))
    except OSError as error:
        raise DriveError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DriveError(f"{path}: expected TOML: {error}") from error
    optional = (
        *("baseline", "place", "rotation", "distortion"),
        *("rate", "depth_unit", "odometry_bias", "start"),
    )
    unknown = sorted(set(values) - {*_INTRINSICS, *optional})
    missing = [name for name in _INTRINSICS if name not in values]
    if unknown or missing:
        found = f"{unknown[0]!r}" if unknown else f"no {', '.join(missing)}"
        expected = ", ".join((*_INTRINSICS, *optional))
        raise DriveError(f"{path}: expected {expected}; found {found}")
    numbers = {name: _numbers(path, name, value) for name, value in values.items()}
    try:
        return _calibration(numbers)
    except (ConfigError, TypeError, ValueError, IndexError) as error:
        raise DriveError(f"{path}: {error}") from error


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a `camera.toml`, whole or not at all, with every digit.

    Raises:
        OutputError: the file cannot be written.
    """
    import tomli_w

    camera = calibration.camera
    values: dict[str, Any] = {name: getattr(camera, name) for name in _INTRINSICS}
    values |= {
        "baseline": camera.baseline,
        "place": camera.position.tolist(),
        "rotation": camera.rotation.tolist(),
        "distortion": list(calibration.distortion),
        "rate": calibration.rate,
        "depth_unit": calibration.depth_unit,
        "odometry_bias": list(calibration.odometry_bias),
    }
    if calibration.start is not None:
        values["start"] = list(calibration.start)
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(values), encoding="utf-8")


def _calibration(values: dict[str, FloatArray]) -> Calibration:
    def number(name: str, default: float = 0.0) -> float:
        return float(values[name].reshape(())) if name in values else default

    def triple(name: str) -> tuple[float, float, float] | None:
        if name not in values:
            return None
        x, y, z = values[name].tolist()
        return x, y, z

    place = values.get("place", np.zeros(3))
    placed = place.shape == (3,) and bool(np.isfinite(place).all())
    require(placed, "place", "three numbers in metres", place.tolist())
    camera = Camera(
        width=int(number("width")),
        height=int(number("height")),
        fx=number("fx"),
        fy=number("fy"),
        cx=number("cx"),
        cy=number("cy"),
        baseline=number("baseline"),
        position=place,
        rotation=values.get("rotation", AHEAD.copy()),
    )
    return Calibration(
        camera=camera,
        distortion=tuple(values.get("distortion", np.zeros(0)).tolist()),
        rate=number("rate", 30.0),
        depth_unit=number("depth_unit", 0.001),
        odometry_bias=triple("odometry_bias") or (0.0, 0.0, 0.0),
        start=triple("start"),
    )


def _numbers(path: Path, name: str, value: Any) -> FloatArray:
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError) as error:
        raise DriveError(f"{path}: {name}: expected numbers, found {value!r}") from error
    if not np.isfinite(array).all():
        raise DriveError(f"{path}: {name}: expected finite numbers, found {value!r}")
    return array
