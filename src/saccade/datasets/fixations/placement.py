"""Images of fixations by name, their places on the screen, and units of positions."""

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np

from saccade.datasets.fixations.exports import Texts
from saccade.errors import LogError
from saccade.io.files import IMAGE_SUFFIXES, natural_order, read_bytes, reading
from saccade.io.image import read_header
from saccade.types import FloatArray

LARGEST_UNIT = 100
"""Maximum size of an image on the screen in units other than pixels."""
SAME_ASPECT = 0.02
"""Maximum relative difference of equal aspects."""
TURNED = 5
"""First EXIF orientation that exchanges width and height."""


def list_files(folder: Path, suffixes: Collection[str]) -> list[str]:
    """Names of the files in a folder and its subfolders, relative to it, in natural order."""
    with reading(folder, LogError):
        found = [each for each in folder.rglob("*") if each.suffix.lower() in suffixes]
        names = [each.relative_to(folder).as_posix() for each in found if not each.is_dir()]
    return sorted(names, key=natural_order)


class FileNames:
    """The files of a folder, found by a relative path, its end, or either without suffix.

    Two names are of one file if the shorter, by its folders, is the end of the longer.
    """

    def __init__(self, folder: Path, suffixes: Collection[str]) -> None:
        self._folder, self._of_end = folder, dict[str, list[str]]()
        for name in list_files(folder, suffixes):
            for key in {name_parts(name)[-1], name_parts(without_suffix(name))[-1]}:
                self._of_end.setdefault(key, []).append(name)

    def find(self, name: str) -> str | None:
        """The file of a name; None if there is none.

        Raises:
            LogError: several files have this name.
        """
        wanted = name_parts(name)
        known = self._of_end.get(wanted[-1], [])
        stems = {each: without_suffix(each) for each in known}
        fits = [each for each in known if ends_agree(wanted, *map(name_parts, (each, stems[each])))]
        for same in (str, str.casefold):
            exact = [each for each in fits if same(name) == same(each)]
            exact = exact or [each for each in fits if same(name) == same(stems[each])]
            fits = exact if len(exact) == 1 else fits
        if len(fits) > 1:
            raise LogError(
                f"{self._folder}: {name} could be {' or '.join(fits[:3])}; name it by its folder"
            )
        return fits[0] if fits else None


def name_parts(name: str) -> tuple[str, ...]:
    """Folders and file of a name with either kind of slashes, without case."""
    path = PureWindowsPath(name)
    return tuple(part.casefold() for part in path.parts if part not in (path.anchor, "..")) or ("",)


def without_suffix(name: str) -> str:
    """A path without the suffix of its file."""
    return PurePosixPath(name).with_suffix("").as_posix() if PurePosixPath(name).suffix else name


def ends_agree(wanted: Sequence[str], *names: Sequence[str]) -> bool:
    """Whether the shorter of two names is the end of the longer."""
    counts = (min(len(wanted), len(name)) for name in names)
    return any(wanted[-n:] == name[-n:] for n, name in zip(counts, names, strict=True))


def resolve_images(names: Texts, folder: Path) -> Texts:
    """The file of each image name in a folder and its subfolders.

    A name is a path relative to the folder, or its end; case, and a missing suffix, do not matter.

    Args:
        names: (n,) names in a table.
        folder: folder of the images.

    Returns:
        (n,) paths relative to the folder; names without a file are unchanged.

    Raises:
        LogError: a name could be several files, or names of several images are one file.
    """
    files = FileNames(folder, IMAGE_SUFFIXES)
    unique, inverse = np.unique(names, return_inverse=True)
    resolved = [files.find(name) or name for name in unique.tolist()]
    first = dict[str, str]()
    for name, file in zip(unique.tolist(), resolved, strict=True):
        other = first.setdefault(file, name)
        one, two = name_parts(without_suffix(other))[:-1], name_parts(without_suffix(name))[:-1]
        n = min(len(one), len(two))
        if n and one[-n:] != two[-n:]:
            raise LogError(f"{folder}: {other} and {name} are two images, found {file} alone")
    return np.array(resolved)[inverse.reshape(-1)]


def image_shape(path: Path) -> tuple[int, int]:
    """(H, W) of an image file, upright by its EXIF orientation, from its header.

    Raises:
        ImageError: not an image.
    """
    with reading(path, LogError):
        header = read_header(read_bytes(path), str(path))
    size = header.height, header.width
    return size[::-1] if header.orientation >= TURNED else size


def image_sizes(names: Texts, folder: Path) -> FloatArray:
    """(n, 2) width and height of the image of each name."""
    unique, inverse = np.unique(names, return_inverse=True)
    shapes = [image_shape(folder / str(name)) for name in unique]
    return np.array([(w, h) for h, w in shapes], np.float64)[inverse.reshape(-1)]


def placed(placement: str, screen: Sequence[float], sizes: FloatArray) -> FloatArray:
    """(n, 5) boxes, see `Box`, of images of sizes (n, 2) on a screen (width, height).

    Args:
        placement: "native", at its own size in the upper left corner; "centered", at its own size
            in the middle; "fit", enlarged or reduced to the screen with its aspect, in the middle;
            "stretch", at the size of the screen.
        screen: width and height in pixels.
        sizes: width and height of the images.
    """
    size = np.asarray(screen, np.float64)
    shown = sizes
    if placement == "fit":
        shown = sizes * (size / sizes).min(axis=1, keepdims=True)
    elif placement == "stretch":
        shown = np.broadcast_to(size, sizes.shape)
    corner = np.zeros_like(sizes) if placement == "native" else (size - shown) / 2
    return np.column_stack([corner, shown, np.zeros(len(sizes))])


PLACEMENTS = ("native", "centered", "fit", "stretch")
"""Places of images on the screen; `placed` describes them."""


UNITS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "norm": lambda screens: screens / 2,
    "height": lambda screens: screens[:, 1:],
    "pix": np.ones_like,
    "deg": np.ones_like,
}
"""Pixels per unit, from the width and height (n, 2) of the screens, of PsychoPy's units about the
center of the screen, with y up; "deg" is in degrees, times the pixels per degree."""


def from_center(xy: FloatArray, unit: str, screens: FloatArray) -> FloatArray:
    """(n, 2) pixels of the screens, y down, from positions in one of `UNITS`.

    Args:
        xy: (n, 2) positions about the center, y up; degrees times the pixels per degree.
        unit: name of the unit.
        screens: (n, 2) width and height in pixels.
    """
    return np.asarray(screens / 2 + UNITS[unit](screens) * xy * (1, -1) - 0.5)


def to_image_pixels(xy: FloatArray, boxes: FloatArray, sizes: FloatArray) -> FloatArray:
    """Converts positions on the screen to pixels of the images.

    The center of a pixel has integer coordinates, both on the screen and in the image; fractions,
    percentages and lengths start at the edge of the image.

    Args:
        xy: (n, 2) positions in the units of the boxes.
        boxes: (n, 5) positions of the images on the screen, see `Box`.
        sizes: (n, 2) width and height of the images in pixels.
    """
    shown = np.where(np.isnan(boxes[:, 2:4]), sizes, boxes[:, 2:4])
    corner = boxes[:, :2] - boxes[:, 4:] * shown / 2
    half = np.where(shown.max(axis=1, keepdims=True) > LARGEST_UNIT, 0.5, 0)
    pixels = (xy - corner + half) * (sizes / shown) - 0.5
    pixels = np.round(pixels, 6)  # undo rounding errors of the division
    edge = sizes - 0.5
    pixels = np.where(pixels == edge, edge - 1e-6, pixels)  # in the last pixel
    return np.where(np.isnan(boxes[:, :1]), xy, pixels)


def require_aspect(shown: Sequence[float], sizes: FloatArray, source: str) -> None:
    """Rejects one size on the screen, in pixels, for images of another aspect."""
    width, height = shown
    if max(width, height) <= LARGEST_UNIT:
        return
    aspects = np.unique(sizes, axis=0)
    off = np.abs(aspects[:, 0] / aspects[:, 1] / (width / height) - 1)
    if (off > SAME_ASPECT).any():
        w, h = aspects[np.argmax(off)]
        size = f"{width:g},{height:g}"
        raise LogError(
            f"{source}: --xy {size} has not the aspect of an image of {w:.0f} x {h:.0f}; pass "
            f"--placement fit {size} if each image was scaled to the screen with its aspect, "
            f"centered {size} if it was shown at its own size, stretch {size} if it was distorted"
        )
