"""Frames of a drive: times, and images that are read and undistorted on demand."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.datasets.drives.calibration import Calibration
from saccade.errors import DriveError, ImageError
from saccade.frames import Frame
from saccade.io.files import IMAGE_SUFFIXES, read_bytes, reading
from saccade.io.image import LARGEST_SEARCH, find_images, read_header, read_stored
from saccade.types import FloatArray, Image, IntArray


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The n frames of a drive, selected from m recorded frames."""

    recorded: FloatArray
    """(m,) times of all frames in seconds, in the order of the files."""
    index: IntArray
    """(n,) indices of the drive's frames in `recorded`, in order of time."""
    remarks: tuple[str, ...] = ()
    """Repairs of the times, one line each."""

    @property
    def time(self) -> FloatArray:
        """(n,) seconds, strictly ascending."""
        return self.recorded[self.index]

    @classmethod
    def sort(
        cls, recorded: FloatArray, name: str, available: IntArray | None = None
    ) -> "FrameTimes":
        """Sorts frames by time; of frames with equal times the first is kept.

        Args:
            recorded: (m,) times of all frames in seconds.
            name: name of the file with the times, for remarks.
            available: ascending indices of the frames that have images; None for all.
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
        return cls(recorded, available[order[is_new]].astype(np.int64), tuple(remarks))


def associate(time: FloatArray, others: FloatArray, tolerance: float) -> IntArray:
    """Mutual nearest neighbors of times (n,) among other times (m,), in seconds.

    Returns:
        (n,) indices into `others`; -1 without a neighbor within the tolerance in seconds.
    """
    from scipy.spatial import KDTree  # slow to import

    if len(others) == 0:
        return np.full(len(time), -1)
    distance, forward = KDTree(others[:, None]).query(time[:, None])
    _, backward = KDTree(time[:, None]).query(others[:, None])
    mutual = time[np.asarray(backward)[forward]] == time
    return np.asarray(np.where(mutual & (distance <= tolerance), forward, -1), np.int64)


class SourceImage(NamedTuple):
    """A recorded image, before undistortion."""

    pixels: Image
    name: str
    """Name of the file, for error messages."""


ImageSource: TypeAlias = Callable[[int], SourceImage | None]
"""Function that reads the image of a recorded frame; None if it has no image. Raises
`ImageError`."""


def image_files(path_of: Callable[[int], Path | None]) -> ImageSource:
    """Image source for files, indexed by the number of the recorded frame."""

    def read(number: int) -> SourceImage | None:
        path = path_of(number)
        return None if path is None else SourceImage(read_stored(path), str(path))

    return read


Maps: TypeAlias = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
"""Maps of `cv2.remap`, see `Camera.maps_to`."""


def frame_reader(
    calibration: Calibration,
    recorded: FloatArray,
    left: ImageSource,
    right: ImageSource | None = None,
    depth: ImageSource | None = None,
    maps: tuple[Maps, Maps] | None = None,
) -> Callable[[int], Frame]:
    """A function that reads and undistorts the images of a recorded frame.

    Args:
        calibration: camera of the images as recorded.
        recorded: (m,) times of all frames in seconds.
        left: images of the (left) camera.
        right: images of the right camera.
        depth: depth of the left camera, 0 where unknown: integers in steps of
            `calibration.depth_unit`, or floats in meters.
        maps: maps of the left and right images, which rectify them; by default both are
            undistorted by the calibration.
    """
    import cv2  # slow to import

    camera = calibration.camera
    once = Lock()  # frames are read by several threads

    @cache
    def maps_of_sides() -> tuple[Maps | None, Maps | None]:
        """Maps of the left and right images, made when the first image is read."""
        own = camera.maps_to(camera.undistorted) if camera.is_distorted else None
        return own, own

    def undistort(
        image: SourceImage, maps: Maps | None, interpolation: int = cv2.INTER_LINEAR
    ) -> Image:
        height, width = image.pixels.shape[:2]
        if (width, height) != (camera.width, camera.height):
            raise ImageError(
                f"{image.name}: expected {camera.width} x {camera.height} px as in "
                f"the calibration, found {width} x {height}"
            )
        return image.pixels if maps is None else cv2.remap(image.pixels, *maps, interpolation)

    def meters(image: SourceImage, maps: Maps | None) -> FloatArray:
        if image.pixels.ndim != 2:
            raise ImageError(
                f"{image.name}: expected depth, one number per pixel, found a color image"
            )
        steps = undistort(image, maps, cv2.INTER_NEAREST)
        unit = 1.0 if steps.dtype.kind == "f" else calibration.depth_unit
        return np.where(np.nan_to_num(steps) == 0, np.nan, steps * np.float64(unit))

    def read(number: int) -> Frame:
        one, other, steps = (source and source(number) for source in (left, right, depth))
        with once:
            of_left, of_right = maps or maps_of_sides()
        return Frame(
            time=float(recorded[number]),
            image=one and undistort(one, of_left),
            right=other and undistort(other, of_right),
            depth=steps and meters(steps, of_left),
        )

    return read


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image."""
    with reading(path, ImageError):
        return read_header(read_bytes(path), str(path))[:2]


def list_images(folder: Path) -> list[Path]:
    """The images of a folder, sorted by the numbers in their names."""
    if not folder.is_dir():
        raise DriveError(f"{folder}: expected a folder of images, found none")
    with reading(folder, DriveError):
        names = [each.name for each in folder.iterdir() if each.suffix.lower() in IMAGE_SUFFIXES]
        if not names:
            below = islice(folder.rglob("*"), LARGEST_SEARCH)
            found = sorted({f.parent for f in below if f.suffix.lower() in IMAGE_SUFFIXES})
            hint = f"none; there are some in {', '.join(map(str, found[:3]))}" if found else "none"
            raise DriveError(f"{folder}: expected images, found {hint}")
    return find_images(folder)
