"""Images of a drive: which there are, and each read when it is wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from saccade.datasets.drives.undistortion import Lens
from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Frame
from saccade.image import find_images, read_stored
from saccade.types import FloatArray, Image, IntArray

NO_DEPTH = 0
"""What a depth image has where it knows nothing."""


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """Reads frame i of a drive from its files; what `Drive.load` is."""

    camera: Camera
    """Without the distortion."""
    time: FloatArray
    """(n,) seconds."""
    left: Sequence[Path | None]
    """(n,) of the (left) camera."""
    right: Sequence[Path | None] = ()
    """(n,) of the right one, or nothing."""
    depth: Sequence[Path | None] = ()
    """(n,) depth images, or nothing."""
    depth_unit: float = 0.001
    """Metres of one step in them."""
    lens: Lens | None = None
    """Of the left camera and of the depth; None where the images are straight already."""
    right_lens: Lens | None = None
    """Of the right camera."""

    def __call__(self, i: int) -> Frame:
        """Frame i.

        Raises:
            ImageError: a file is missing or broken, or has another size than the calibration.
        """
        return Frame(
            time=float(self.time[i]),
            image=self._image(self.left, self.lens, i),
            right=self._image(self.right, self.right_lens, i),
            depth=self._metres(i),
        )

    def _image(self, paths: Sequence[Path | None], lens: Lens | None, i: int) -> Image | None:
        path = paths[i] if paths else None
        return None if path is None else undistort(read_stored(path), self.camera, lens, str(path))

    def _metres(self, i: int) -> FloatArray | None:
        path = self.depth[i] if self.depth else None
        if path is None:
            return None
        steps = read_stored(path)
        return metres(steps, self.depth_unit, self.camera, self.lens, str(path))


def undistort(pixels: Image, camera: Camera, lens: Lens | None, name: str) -> Image:
    """An image without the distortion of its lens.

    Raises:
        ImageError: it has another size than the calibration; `name` is in the message.
    """
    _check_size(pixels, camera, name)
    return pixels if lens is None else lens.undistort(pixels)


def _check_size(pixels: Image, camera: Camera, name: str) -> None:
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise ImageError(
            f"{name}: expected {camera.width} x {camera.height} px as the calibration, "
            f"found {width} x {height}"
        )


def metres(steps: Image, unit: float, camera: Camera, lens: Lens | None, name: str) -> FloatArray:
    """A depth image in metres, NaN where it is not known.

    Raises:
        ImageError: it has colours, or another size than the calibration.
    """
    if steps.ndim != 2:
        raise ImageError(f"{name}: expected depth, one number a pixel, found a colour image")
    _check_size(steps, camera, name)
    steps = steps if lens is None else lens.undistort(steps, cv2.INTER_NEAREST)
    return np.where(np.nan_to_num(steps) == NO_DEPTH, np.nan, steps * np.float64(unit))


def images_of(folder: Path) -> list[Path]:
    """The images of a folder in the order of their names.

    Raises:
        DriveError: there is no such folder, or none in it.
    """
    if not folder.is_dir():
        raise DriveError(f"{folder}: expected a folder of images, found none")
    try:
        return find_images(folder)
    except ImageError as error:
        raise DriveError(str(error)) from error


def numbered(paths: Sequence[Path], count: int) -> dict[int, Path]:
    """Images by the number of their frame: that in their names, or else their order.

    Args:
        paths: in the order of their names.
        count: how many frames there are.

    Raises:
        DriveError: a number that no frame has.
    """
    if not all(path.stem.isascii() and path.stem.isdecimal() for path in paths):
        frames = dict(enumerate(paths))
    else:
        frames = {int(path.stem): path for path in paths}
    if frames and max(frames) >= count:
        raise DriveError(
            f"{frames[max(frames)]}: expected one of {count} frames as there are times, "
            f"found number {max(frames)}"
        )
    return frames


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of an image.

    Raises:
        DriveError: it cannot be read.
    """
    try:
        height, width = read_stored(path).shape[:2]
    except ImageError as error:
        raise DriveError(str(error)) from error
    return width, height


def in_time(time: FloatArray, name: str) -> tuple[IntArray, tuple[str, ...]]:
    """Which frames to take, in the order of their times; of those at the same time the first.

    Args:
        time: (n,) seconds of the frames as their files have them.
        name: of the file, for the remarks.

    Returns:
        (k,) numbers of frames, and what had to be mended.
    """
    order = np.argsort(time, kind="stable")
    new = np.diff(time[order], prepend=-np.inf) > 0
    back = np.flatnonzero(np.diff(time) < 0)
    remarks = []
    if len(back):
        remarks.append(
            f"{name}: time goes back {len(back)} times, first at frame {back[0] + 1}; "
            "the frames are sorted by it"
        )
    if not new.all():
        remarks.append(
            f"{name}: times that come twice: {int((~new).sum())}, first at frame "
            f"{order[~new].min()}; of each only the first frame is taken"
        )
    return np.asarray(order[new], np.int64), tuple(remarks)
