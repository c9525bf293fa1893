"""Image files of a drive: listed, numbered, and read on demand."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from saccade.datasets.drives.frame_loader import SourceImage
from saccade.errors import DriveError, ImageError
from saccade.image import find_images, read_stored


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """Reads image i from its file; an `ImageSource`."""

    paths: Sequence[Path | None]
    """(n,) None where there is no image."""
    unit: float = 1.0
    """Metres per step, of depth images."""

    def __call__(self, i: int) -> SourceImage | None:
        """Image i.

        Raises:
            ImageError: the file is missing or broken.
        """
        path = self.paths[i]
        return None if path is None else SourceImage(read_stored(path), str(path), self.unit)


def list_images(folder: Path) -> list[Path]:
    """The images of a folder, sorted by name.

    Raises:
        DriveError: there is no such folder, or none in it.
    """
    if not folder.is_dir():
        raise DriveError(f"{folder}: expected a folder of images, found none")
    try:
        return find_images(folder)
    except ImageError as error:
        raise DriveError(str(error)) from error


def are_numbered(paths: Sequence[Path]) -> bool:
    """Whether all file names are numbers."""
    return all(path.stem.isascii() and path.stem.isdecimal() for path in paths)


def index_images(paths: Sequence[Path], count: int) -> dict[int, Path]:
    """Images by frame number: the number in the file name, or else the position in the list.

    Args:
        paths: sorted by name.
        count: number of frames.

    Raises:
        DriveError: a number beyond the frames.
    """
    numbers = [int(path.stem) for path in paths] if are_numbered(paths) else range(len(paths))
    frames = dict(zip(numbers, paths, strict=True))
    if frames and max(frames) >= count:
        raise DriveError(
            f"{frames[max(frames)]}: expected one of {count} frames as there are times, "
            f"found number {max(frames)}"
        )
    return frames


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image.

    Raises:
        DriveError: it cannot be read.
    """
    try:
        height, width = read_stored(path).shape[:2]
    except ImageError as error:
        raise DriveError(str(error)) from error
    return width, height
