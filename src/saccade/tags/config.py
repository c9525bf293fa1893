"""Settings of the detection of tags: family, size and errors."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from saccade.errors import ConfigError, Settings, require, setting

FAMILIES = {
    **{f"tag{name}": f"APRILTAG_{name}" for name in ("16h5", "25h9", "36h10", "36h11")},
    **{
        f"{n}x{n}_{count}": f"{n}X{n}_{count}"
        for n in (4, 5, 6, 7)
        for count in (50, 100, 250, 1000)
    },
    "aruco_original": "ARUCO_ORIGINAL",
    "aruco_mip_36h12": "ARUCO_MIP_36h12",
}
"""Families of tags, and the names of their dictionaries in `cv2.aruco`, without DICT_."""
LARGEST_SIZE = 3.0
"""Largest plausible side of a tag in meters; a larger number is probably in millimeters."""


@dataclass(frozen=True)
class TagConfig(Settings):
    """Tags to detect, and the errors of their positions.

    Raises:
        ConfigError: unknown family, or a setting out of range.
    """

    family: str = "tag36h11"
    """Family of the tags: one of `FAMILIES`."""
    size: Any = None
    """Side of the black square in meters: a number, or a table by id, whose tags alone are then
    located; None if unknown, for corners alone."""
    size_sigma: float = setting(0.01, 0, 0.5)
    """Relative standard deviation of the size."""
    focal_sigma: float = setting(0.005, 0, 0.5)
    """Relative standard deviation of the focal length."""
    tilt_sigma_deg: float = setting(0.5, 0, 45)
    """Standard deviation of the camera's pitch and roll in degrees; displaces tags above and below
    the camera."""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "family", family_name(self.family))
        if isinstance(self.size, Mapping):
            sizes = {_tag_id(key, self.family): _length(value) for key, value in self.size.items()}
            object.__setattr__(self, "size", sizes)
        elif self.size is not None:
            object.__setattr__(self, "size", _length(self.size))

    def size_of(self, tag: int) -> float | None:
        """Side of a tag in meters; None if unknown."""
        size: float | None = self.size.get(tag) if isinstance(self.size, dict) else self.size
        return size


def family_name(name: str) -> str:
    """Name of a family in `FAMILIES`, from any usual spelling."""
    plain = re.sub("apriltag_?", "tag", name.lower().removeprefix("dict_"))
    plain = f"tag{plain}" if f"tag{plain}" in FAMILIES else plain
    require(plain in FAMILIES, "family", f"one of {', '.join(FAMILIES)}", name)
    return plain


def _length(value: Any) -> float:
    """A side in meters."""
    known = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    require(known and value > 0, "size", "the side of the black square in meters, above 0", value)
    hint = (
        f"meters, at most {LARGEST_SIZE:g}, not millimeters ({value:g} mm are {value / 1000:g} m)"
    )
    require(value <= LARGEST_SIZE, "size", hint, value)
    return float(value)


def _tag_id(key: Any, family: str) -> int:
    """Id of a tag from an id or a label."""
    text = str(key).removeprefix(f"{family}:")
    require(text.isascii() and text.isdecimal(), "size", "a table by ids of tags", key)
    return int(text)


def parse_sizes(text: str) -> float | dict[int, float]:
    """Sizes of tags from text: a number, or a list such as `0-13=0.165,20=0.3`.

    Raises:
        ConfigError: anything else.
    """
    sizes = dict[int, float]()
    try:
        if "=" not in text:
            return float(text)
        for part in text.split(","):
            ids, _, size = part.partition("=")
            sizes |= dict.fromkeys(parse_ids(ids), float(size))
    except ValueError as error:
        expected = "a number in meters, or IDS=METERS with commas, such as 0-13=0.165,20=0.3"
        raise ConfigError(f"--tag-size: expected {expected}, found {text!r}") from error
    return sizes


def parse_ids(text: str) -> list[int]:
    """Ids of tags from text such as `0-13` or `3,5,8-10`.

    Raises:
        ConfigError: anything else.
    """
    found = list[int]()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        known = all(each.isascii() and each.isdecimal() for each in (first, last or first))
        require(known and len(part) < 20, "ids", "ids such as 0-13 or 3,5,8-10", text)
        low, high = int(first), int(last or first)
        require(low <= high < 10_000, "ids", "ascending ids below 10000", part)
        found += range(low, high + 1)
    return list(dict.fromkeys(found))
