"""Images of a drive: which there are, and each read when it is wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from saccade.errors import DriveError, ImageError
from saccade.frames import Camera, Frame
from saccade.image import find_images, read_stored
from saccade.types import Float32Array, FloatArray, Image, IntArray

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
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3 of OpenCV; taken out of image and depth."""

    def __call__(self, i: int) -> Frame:
        """Frame i.

        Raises:
            ImageError: a file is missing or broken, or has another size than the calibration.
        """
        return Frame(
            time=float(self.time[i]),
            image=self._image(self.left, i),
            right=self._image(self.right, i),
            depth=self._metres(i),
        )

    def _image(self, paths: Sequence[Path | None], i: int) -> Image | None:
        path = paths[i] if paths else None
        if path is None:
            return None
        pixels = read_stored(path)
        check_size(pixels, self.camera, str(path))
        return self.straighten(pixels)

    def _metres(self, i: int) -> FloatArray | None:
        path = self.depth[i] if self.depth else None
        if path is None:
            return None
        steps = read_stored(path)
        check_size(steps, self.camera, str(path))
        if steps.ndim != 2:
            raise ImageError(f"{path}: expected depth, one number a pixel, found a colour image")
        steps = self.straighten(steps, cv2.INTER_NEAREST)
        return np.where(steps == NO_DEPTH, np.nan, steps * self.depth_unit)

    def straighten(self, pixels: Image, how: int = cv2.INTER_LINEAR) -> Image:
        """The image without the distortion."""
        if not self.distortion:
            return pixels
        return cv2.remap(pixels, *self._maps, how)

    @cached_property
    def _maps(self) -> tuple[Float32Array, Float32Array]:
        K = intrinsics(self.camera)
        size = (self.camera.width, self.camera.height)
        bent = np.array(self.distortion)
        x, y = cv2.initUndistortRectifyMap(K, bent, np.eye(3), K, size, cv2.CV_32FC1)
        return np.asarray(x, np.float32), np.asarray(y, np.float32)


def intrinsics(camera: Camera) -> FloatArray:
    """(3, 3) matrix of a camera."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def check_size(pixels: npt.NDArray[np.generic], camera: Camera, name: str) -> None:
    """Raise `ImageError` unless an image has the size of the calibration."""
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise ImageError(
            f"{name}: expected {camera.width} x {camera.height} px as the calibration, "
            f"found {width} x {height}"
        )


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


def in_time(time: FloatArray) -> IntArray:
    """Which frames to take, in the order of their times; of those at the same time the first."""
    order = np.argsort(time, kind="stable")
    new = np.concatenate([[True], np.diff(time[order]) > 0]) if len(time) else np.zeros(0, bool)
    return np.asarray(order[new], np.int64)
