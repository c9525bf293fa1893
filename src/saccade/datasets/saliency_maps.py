"""Saliency maps in files: the formats, and the map of each image in a folder."""

from collections.abc import Callable, Collection
from pathlib import Path, PurePosixPath
from typing import Any

import numpy.typing as npt

from saccade.datasets.fixations.placement import (
    ends_agree,
    list_files,
    name_parts,
    without_suffix,
)
from saccade.datasets.matlab import read_matrix
from saccade.errors import ImageError, LogError
from saccade.io.files import IMAGE_SUFFIXES
from saccade.io.image import read_stored
from saccade.io.npz import map_array

FORMATS: dict[str, Callable[[Path], npt.NDArray[Any]]] = {
    ".npy": map_array,
    ".mat": read_matrix,
    ".tiff": read_stored,
    ".tif": read_stored,
    **dict.fromkeys(IMAGE_SUFFIXES, read_stored),
}
"""Readers of maps by suffix; of several files for an image, the first suffix is read."""
SUFFIXES = tuple(FORMATS)


def read_map(path: Path) -> npt.NDArray[Any]:
    """The values of a map: an array of any shape, or the stored pixels of an image.

    Raises:
        ImageError: the file is missing, broken or of another format.
    """
    try:
        return FORMATS[path.suffix.lower()](path)
    except LogError as error:
        raise ImageError(str(error)) from error
    except (OSError, ValueError) as error:
        if isinstance(error, ImageError):
            raise
        expected = f"a map as {path.suffix.lower()}"
        raise ImageError(f"{path}: expected {expected}, found another file") from error


class MapFiles:
    """The maps in a folder and its subfolders, by the paths of their images.

    A map has the path of its image with another suffix, or the image's whole name and a suffix.
    The shorter path is the end of the longer, if it is of no other image.

    Args:
        folder: folder of the maps.
        images: paths of all images, relative to their folder.
    """

    def __init__(self, folder: Path, images: Collection[str]) -> None:
        self._folder = folder
        self._maps, self._images = dict[str, list[str]](), dict[str, list[str]]()
        for name in list_files(folder, SUFFIXES):
            stem = without_suffix(name)
            inner = PurePosixPath(stem).suffix.lower() in IMAGE_SUFFIXES
            for each in {stem, without_suffix(stem)} if inner else {stem}:
                self._maps.setdefault(name_parts(each)[-1], []).append(name)
        for name in images:
            self._images.setdefault(name_parts(without_suffix(name))[-1], []).append(name)

    def find(self, image: str) -> Path:
        """The map of an image.

        Raises:
            ImageError: there is no map, or it could be that of another image, or one of several.
        """
        wanted = name_parts(without_suffix(image))
        whole = name_parts(image)
        fits = dict[tuple[str, ...], list[str]]()
        for name in self._maps.get(wanted[-1], []):
            parts = name_parts(without_suffix(name))
            if ends_agree(wanted, parts) or ends_agree(whole, parts):
                fits.setdefault(parts, []).append(name)
        if whole in fits:
            return self._first(fits[whole])
        if wanted in fits:
            return self._unrivaled(image, wanted, wanted, fits[wanted])
        if not fits:
            raise ImageError(
                f"{self._folder}: expected a map for {image}, of that path with a suffix such as "
                ".npy, .mat, .png or .jpg, found none"
            )
        if len(fits) > 1:
            names = " or ".join(each[0] for each in list(fits.values())[:3])
            raise ImageError(f"{self._folder}: the map of {image} could be {names}")
        return self._unrivaled(image, wanted, *fits.popitem())

    def _unrivaled(
        self, image: str, wanted: tuple[str, ...], parts: tuple[str, ...], names: list[str]
    ) -> Path:
        """The first of the maps of a path, unless it could be that of another image."""
        for other in self._images.get(wanted[-1], []):
            stem = name_parts(without_suffix(other))
            shared = stem == wanted or (parts != wanted and ends_agree(stem, parts))
            if other != image and shared:
                raise ImageError(
                    f"{self._folder}: {names[0]} could be the map of {image} or of {other}; name "
                    "the maps by the folders and names of their images"
                )
        return self._first(names)

    def _first(self, names: list[str]) -> Path:
        order = {suffix: number for number, suffix in enumerate(SUFFIXES)}
        return self._folder / min(names, key=lambda each: order[PurePosixPath(each).suffix.lower()])
