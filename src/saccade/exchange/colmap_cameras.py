"""COLMAP's cameras: lists of them, rows of a database, and the camera record of this package."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self, TypeAlias

import numpy as np

from saccade.errors import ConfigError, require
from saccade.frames import LENSES, Camera
from saccade.io.files import read_text, reading

PIXEL_CENTER = 0.5
"""Center of the first pixel in COLMAP."""
MODELS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"),
    *("FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"),
)
"""COLMAP's camera models, in the order of their numbers in a database."""
LENS_PARAMETERS = {
    "SIMPLE_PINHOLE": ("pinhole", "f cx cy"),
    "PINHOLE": ("pinhole", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("pinhole", "f cx cy k1"),
    "RADIAL": ("pinhole", "f cx cy k1 k2"),
    "OPENCV": ("pinhole", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("pinhole", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("fisheye", "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", "f cx cy k1"),
    "RADIAL_FISHEYE": ("fisheye", "f cx cy k1 k2"),
}
"""Lens model of `saccade.frames.Camera` and names of the parameters, by COLMAP's model."""
MAX_COEFFICIENTS = 8
"""Number of distortion coefficients of a pinhole that COLMAP's models have, of those of OpenCV."""


class ColmapCamera(NamedTuple):
    """A COLMAP camera, in pixels with the first centered at (0.5, 0.5)."""

    model: str
    """Camera model, such as PINHOLE."""
    params: tuple[float, ...] = ()
    """Parameters, such as fx, fy, cx, cy; guessed if empty."""
    size: tuple[int, int] | None = None
    """Width and height of the images; None for any size."""

    def to_camera(self, size: tuple[int, int] | None = None) -> Camera:
        """The camera record, as `saccade.verify` and drives have it.

        Args:
            size: width and height of the images, for a camera without them.

        Raises:
            ConfigError: a model without a counterpart, another number of parameters, no size, or
                parameters out of range.
        """
        known = ", ".join(LENS_PARAMETERS)
        require(self.model in LENS_PARAMETERS, "camera", f"one of {known}", self.model)
        lens, names = LENS_PARAMETERS[self.model]
        valid = len(self.params) == len(names.split())
        require(valid, "camera", f"{self.model} with {names}", self.params)
        size = self.size or size
        if size is None:
            raise ConfigError("size: expected width and height of the images, found None")
        values = dict(zip(names.split(), self.params, strict=True))
        focal = values.get("f", 0.0)
        coefficients = LENSES[lens].parameters[:MAX_COEFFICIENTS]
        distortion = tuple(values.get(name, 0.0) for name in coefficients)
        return Camera(
            *size,
            values.get("fx", focal),
            values.get("fy", focal),
            values["cx"] - PIXEL_CENTER,
            values["cy"] - PIXEL_CENTER,
            lens=lens,
            distortion=distortion if lens == "fisheye" or any(distortion) else (),
        )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parses MODEL or MODEL,PARAMETER,...; raises `ConfigError`."""
        model, *words = text.split(",")
        return cls(model.strip().upper(), _numbers("camera", "MODEL,fx,fy,cx,cy or alike", words))


Cameras: TypeAlias = ColmapCamera | Mapping[str, ColmapCamera] | None
"""A camera for all images, a camera per image, or None for COLMAP's guess."""


def read_cameras(path: Path) -> dict[str, ColmapCamera]:
    """Reads the cameras in a list of hloc, by image name, or in COLMAP's cameras.txt, by number.

    Each line has NAME MODEL WIDTH HEIGHT PARAMETER ...

    Raises:
        ConfigError: the list cannot be read, or a line is malformed.
    """
    with reading(path, ConfigError):
        lines = read_text(path).splitlines()
    cameras = {}
    for number, line in enumerate(lines, 1):
        name, *words = line.split() or ["#"]
        if not name.startswith("#"):
            where, expected = f"{path}, line {number}", "NAME MODEL WIDTH HEIGHT PARAMETER ..."
            require(len(words) > 2, where, expected, line[:80])
            width, height, *values = _numbers(where, expected, words[1:])
            size = int(width), int(height)
            cameras[name] = ColmapCamera(words[0].upper(), tuple(values), size)
    return cameras


def _numbers(name: str, expected: str, words: Sequence[str]) -> tuple[float, ...]:
    try:
        values = tuple(map(float, words))
    except ValueError:
        values = (np.nan,)
    require(bool(np.isfinite(values).all()), name, expected, " ".join(words)[:80])
    return values


def parse_cameras(text: str | None) -> Cameras:
    """Parses --camera: a camera for all images, or a file for `read_cameras`.

    Raises:
        ConfigError: the text is neither.
    """
    if text is None:
        return None
    return read_cameras(Path(text)) if Path(text).is_file() else ColmapCamera.parse(text)


def camera_of_row(model: int, size: tuple[int, int], params: bytes) -> ColmapCamera:
    """The camera of a row of a database; the model is a number where its name is not known."""
    name = MODELS[model] if 0 <= model < len(MODELS) else str(model)
    return ColmapCamera(name, tuple(np.frombuffer(params or b"", "<f8").tolist()), size)
