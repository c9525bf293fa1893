"""Which images are matched: all pairs, those of a list, neighbors in a sequence or on the map."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
from PIL import Image as Pillow
from PIL.ExifTags import GPS, IFD
from scipy.spatial import cKDTree

from saccade.batch.sources import Source, content_reader, open_source
from saccade.errors import ConfigError, ImageWarning, require
from saccade.io.files import atomic_write, read_text, reading
from saccade.io.keypoint_fields import check_name
from saccade.types import FloatArray

Pair: TypeAlias = tuple[str, str]
"""The names of two images."""
EARTH_RADIUS = 6_371_000.0
"""In meters."""


def read_pairs(path: Path) -> list[Pair]:
    """The pairs in a list, as hloc and COLMAP have it; each once, in the first of its orders.

    A line has two names, separated by blanks, or by tabs where names have blanks, and perhaps a
    score, which is not used. Empty lines and comments after # are skipped.

    Raises:
        ConfigError: the list cannot be read or is empty, or a line is no pair.
    """
    with reading(path, ConfigError):
        lines = read_text(path).splitlines()
    pairs: dict[Pair, None] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        names = line.split("\t") if "\t" in line else line.split()
        if len(names) == 3 and _is_number(names[2]):
            del names[2]
        if len(names) != 2 or names[0] == names[1] or not all(names):
            raise ConfigError(f"{path}, line {number}: expected two images, found {line[:80]!r}")
        if (names[1], names[0]) not in pairs:
            pairs[names[0], names[1]] = None
    if not pairs:
        raise ConfigError(f"{path}: expected pairs of images, found none")
    return list(pairs)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def write_pairs(path: Path, pairs: Sequence[Pair]) -> None:
    """Write a list that `read_pairs` and hloc read."""
    lines = (("\t" if " " in "".join(pair) else " ").join(pair) for pair in pairs)
    with atomic_write(path) as temporary:
        temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def images_and_pairs(
    source: str, wanted: str | Path | None, *, root: str | None = None, out: str | None = None
) -> tuple[Source, list[Pair]]:
    """The images of a source, and their pairs.

    Args:
        source: see `open_source`.
        wanted: a list of pairs; "sequential:N" or "gps:N", see `PAIRINGS`; None for all pairs.
        root: see `open_source`.
        out: folder of results, whose images do not count.

    Raises:
        ImageError: the source does not exist, or holds no image.
        ConfigError: the list is broken, or none of its pairs is in the source; or the source has
            only one image, or no GPS positions.
        KeypointsError: a name that the formats cannot hold, such as an absolute path.
    """
    kind, separator, number = str(wanted).partition(":")
    if kind in PAIRINGS and separator:
        valid = number.isdecimal() and int(number) > 0
        require(valid, "pairs", f"{kind}:N with the number N of neighbors", wanted)
    elif wanted is not None:
        listed = read_pairs(Path(wanted))
        images = open_source(source, root=root, without=out)
        return listed_pairs(source, images, listed, str(wanted))
    images = open_source(source, root=root, without=out)
    if wanted is None:
        pairs = list(combinations([image.name for image in images], 2))
    else:
        pairs = PAIRINGS[kind](images, int(number))
    if not pairs:
        raise ConfigError(f"{source}: expected two images or more, found one")
    return images, pairs


def listed_pairs(
    source: str, found: Source, pairs: list[Pair], listed: str
) -> tuple[Source, list[Pair]]:
    """The pairs of a list whose images are in a source, and these images; warns of the others.

    Raises:
        ConfigError: none of the pairs.
    """
    names = sorted({check_name(name) for pair in pairs for name in pair})
    items = {item.name: item for item in found}
    absent = [name for name in names if name not in items]
    if absent:
        left = [pair for pair in pairs if items.keys() >= {*pair}]
        message = (
            f"{listed}: expected images of {source}, found {absent[0][:80]!r}, which is not there"
            + (f", and {len(absent) - 1} more" if absent[1:] else "")
        )
        if not left:
            raise ConfigError(message)
        warnings.warn(
            f"{message}; {len(pairs) - len(left)} of {len(pairs)} pairs are left out",
            ImageWarning,
            stacklevel=4,
        )
        pairs = left
        names = sorted({name for pair in pairs for name in pair})
    return [items[name] for name in names], pairs


def sequential_pairs(images: Source, count: int) -> list[Pair]:
    """Each image with the next ones in the order of the source."""
    names = [image.name for image in images]
    ends = range(1, count + 1)
    return [
        (name, names[i + k]) for i, name in enumerate(names) for k in ends if i + k < len(names)
    ]


def nearby_pairs(images: Source, count: int) -> list[Pair]:
    """Each image with those whose GPS positions in the EXIF data are nearest.

    Raises:
        ConfigError: fewer than two images have a position.
    """
    read = content_reader()
    positions = {}
    for image in images:
        content = read(image)
        position = gps_of(content) if isinstance(content, bytes) else None
        if position is not None:
            positions[image.name] = position
    if len(positions) < 2:
        found = f"{len(positions)} of {len(images)}"
        raise ConfigError(f"pairs: expected images with GPS positions for gps:N, found {found}")
    if len(positions) < len(images):
        missing = len(images) - len(positions)
        message = f"{missing} of {len(images)} images have no GPS position, and no pairs"
        warnings.warn(message, ImageWarning, stacklevel=4)
    names, xy = [*positions], in_meters(np.array([*positions.values()]))
    nearest = np.asarray(cKDTree(xy).query(xy, min(count + 1, len(names)))[1])
    pairs = {(min(i, j), max(i, j)) for i, row in enumerate(nearest.tolist()) for j in row}
    return [(names[i], names[j]) for i, j in sorted(pairs) if i != j]


PAIRINGS: Mapping[str, Callable[[Source, int], list[Pair]]] = {
    "sequential": sequential_pairs,
    "gps": nearby_pairs,
}
"""Selections of pairs by the number of neighbors of each image."""


def gps_of(content: bytes) -> tuple[float, float] | None:
    """Latitude and longitude in degrees from the EXIF data of an image; None without them."""
    try:
        with Pillow.open(BytesIO(content)) as image:
            tags = Pillow.Image.getexif(image).get_ifd(IFD.GPSInfo)
        latitude, longitude = (
            float(np.dot(np.array(tags[key], float), [1, 1 / 60, 1 / 3600]))
            for key in (GPS.GPSLatitude, GPS.GPSLongitude)
        )
        south = str(tags.get(GPS.GPSLatitudeRef, "N")).upper().startswith("S")
        west = str(tags.get(GPS.GPSLongitudeRef, "E")).upper().startswith("W")
    except Exception:  # Pillow raises arbitrary exceptions of broken EXIF data
        return None
    if not np.isfinite([latitude, longitude]).all():
        return None
    return latitude * (-1 if south else 1), longitude * (-1 if west else 1)


def in_meters(degrees: FloatArray) -> FloatArray:
    """(n, 3) positions in space of (n, 2) latitudes and longitudes on a sphere."""
    latitude, longitude = np.radians(degrees).T
    unit = np.cos(latitude) * [np.cos(longitude), np.sin(longitude)]
    xyz: FloatArray = EARTH_RADIUS * np.stack([*unit, np.sin(latitude)], axis=1)
    return xyz
