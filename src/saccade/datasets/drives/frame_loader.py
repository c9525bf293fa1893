"""Loads the frames of a drive: images are read and undistorted on demand."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from saccade.datasets.drives.undistortion import Lens
from saccade.errors import ImageError
from saccade.frames import Camera, Frame
from saccade.types import FloatArray, Image

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
        """Frame i.

        Raises:
            ImageError: a file is missing or broken, or does not have the size of the calibration.
        """
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
