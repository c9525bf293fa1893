"""Frames of a drive: their times, and their images, which are read and undistorted on demand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.datasets.drives.calibration import Lens
from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Frame
from saccade.image import find_images, read_stored
from saccade.types import FloatArray, Image, IntArray


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The n frames of a drive among the m frames that were recorded."""

    recorded: FloatArray
    """(m,) seconds of all frames, in the order of the files."""
    index: IntArray
    """(n,) indices of the frames of the drive among them, in the order of their times."""
    remarks: tuple[str, ...] = ()
    """What was wrong with the times, one line each."""

    @property
    def time(self) -> FloatArray:
        """(n,) seconds, strictly ascending."""
        return self.recorded[self.index]

    @classmethod
    def sort(
        cls, recorded: FloatArray, name: str, available: IntArray | None = None
    ) -> "FrameTimes":
        """Frames sorted by time; of several at the same time the first is kept.

        Args:
            recorded: (m,) seconds of all frames.
            name: of the file with the times, for the remarks.
            available: indices of the frames that have images; None for all.
        """
        if available is None:
            available = np.arange(len(recorded))
        time = recorded[available]
        order = np.argsort(time, kind="stable")
        is_new = np.diff(time[order], prepend=-np.inf) > 0
        backwards = np.flatnonzero(np.diff(time) < 0)
        remarks = []
        if len(backwards):
            remarks.append(
                f"{name}: time goes back {len(backwards)} times, first at frame "
                f"{backwards[0] + 1}; the frames are sorted by it"
            )
        if not is_new.all():
            remarks.append(
                f"{name}: duplicate times: {int((~is_new).sum())}, first at frame "
                f"{order[~is_new].min()}; only the first frame of each is kept"
            )
        index = available[order[is_new]]
        return cls(recorded, np.asarray(index, np.int64), tuple(remarks))


def associate(time: FloatArray, others: FloatArray, tolerance: float) -> IntArray:
    """Mutual nearest neighbors in time.

    Args:
        time: (n,) seconds.
        others: (m,) seconds.
        tolerance: largest difference, in seconds.

    Returns:
        (n,) index of the associated time in `others`, or -1.
    """
    if len(others) == 0:
        return np.full(len(time), -1)
    forward, distance = _nearest(time, others)
    backward, _ = _nearest(others, time)
    mutual = time[backward[forward]] == time
    return np.asarray(np.where(mutual & (distance <= tolerance), forward, -1), np.int64)


def _nearest(time: FloatArray, others: FloatArray) -> tuple[IntArray, FloatArray]:
    """For each time (n,) the index of the nearest of the others (m,), and its distance."""
    order = np.argsort(others, kind="stable")
    after = np.searchsorted(others[order], time)
    neighbors = order[np.stack([after - 1, after]).clip(0, len(others) - 1)]  # (2, n)
    distance = np.abs(others[neighbors] - time)
    nearest = distance.argmin(0), np.arange(len(time))
    return np.asarray(neighbors[nearest], np.int64), np.asarray(distance[nearest])


NO_DEPTH = 0
"""Value of a depth image where the depth is not known."""


class SourceImage(NamedTuple):
    """An image as it was recorded."""

    pixels: Image
    name: str
    """For error messages."""
    unit: float = 1.0
    """Metres per step, of a depth image."""


ImageSource: TypeAlias = Callable[[int], SourceImage | None]
"""Reads image i of one camera; None where it has none. Raises `ImageError`."""


@dataclass(frozen=True, eq=False)
class FrameLoader:
    """Loads frame i; the `load` of a `Drive`."""

    camera: Camera
    """The pinhole camera of the undistorted images."""
    time: FloatArray
    """(n,) seconds."""
    left: ImageSource
    """Of the (left) camera."""
    right: ImageSource | None = None
    """Of the right one."""
    depth: ImageSource | None = None
    """Depth of the left one."""
    lens: Lens | None = None
    """Of the left camera and of the depth; None where the images have no distortion."""
    right_lens: Lens | None = None
    """Of the right camera; None where it is `lens`."""

    def __call__(self, i: int) -> Frame:
        """Frame i."""
        return Frame(
            time=float(self.time[i]),
            image=self._image(self.left, self.lens, i),
            right=self._image(self.right, self.right_lens or self.lens, i),
            depth=self._depth(i),
        )

    def _image(self, source: ImageSource | None, lens: Lens | None, i: int) -> Image | None:
        image = None if source is None else source(i)
        return None if image is None else self._undistort(image, lens, cv2.INTER_LINEAR)

    def _depth(self, i: int) -> FloatArray | None:
        """Depth in metres, NaN where it is not known."""
        depth = None if self.depth is None else self.depth(i)
        if depth is None:
            return None
        if depth.pixels.ndim != 2:
            raise ImageError(
                f"{depth.name}: expected depth, one number per pixel, found a color image"
            )
        steps = self._undistort(depth, self.lens, cv2.INTER_NEAREST)
        return np.where(np.nan_to_num(steps) == NO_DEPTH, np.nan, steps * np.float64(depth.unit))

    def _undistort(self, image: SourceImage, lens: Lens | None, interpolation: int) -> Image:
        height, width = image.pixels.shape[:2]
        if (width, height) != (self.camera.width, self.camera.height):
            raise ImageError(
                f"{image.name}: expected {self.camera.width} x {self.camera.height} px as the "
                f"calibration, found {width} x {height}"
            )
        return image.pixels if lens is None else lens.undistort(image.pixels, interpolation)


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """Reads image i from its file; an `ImageSource`."""

    paths: Sequence[Path | None]
    """(n,) None where there is no image."""
    unit: float = 1.0
    """Metres per step, of depth images."""

    def __call__(self, i: int) -> SourceImage | None:
        """Image i."""
        path = self.paths[i]
        return None if path is None else SourceImage(read_stored(path), str(path), self.unit)


def list_images(folder: Path) -> list[Path]:
    """The images of a folder, sorted by name."""
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
    """Width and height of an image."""
    try:
        height, width = read_stored(path).shape[:2]
    except ImageError as error:
        raise DriveError(str(error)) from error
    return width, height
