"""Masks of images in a folder, named as COLMAP names them."""

import warnings
from pathlib import Path

import numpy as np

from saccade.errors import ImageError, ImageWarning, require
from saccade.io.files import read_bytes, reading
from saccade.io.image import TURNS, quiet_opencv
from saccade.types import BoolArray


def check_masks(folder: Path | None) -> None:
    """Validates a folder of masks.

    Raises:
        ConfigError: it does not exist, or holds no mask.
    """
    found = folder is None or any(folder.rglob("*.png"))
    require(found, "masks", "a folder with NAME.png for each image NAME", str(folder))


def mask_file(folder: Path, name: str) -> Path | None:
    """The mask of an image, NAME.png or, for PNG images, NAME itself; None without one.

    Args:
        folder: of the masks.
        name: of the image, a path below its own folder.
    """
    names = (f"{name}.png", name) if name.lower().endswith(".png") else (f"{name}.png",)
    return next((folder / each for each in names if (folder / each).is_file()), None)


def read_mask(folder: Path, name: str, orientation: int = 1) -> BoolArray | None:
    """(H, W) where the mask of an image is not black, upright; None without a mask, with a warning.

    Args:
        folder: of the masks, in stored pixels of the images.
        name: of the image, a path below its own folder.
        orientation: EXIF orientation of the image, 1 to 8.

    Raises:
        ImageError: the file is no image.
    """
    import cv2  # slow to import

    path = mask_file(folder, name)
    if path is None:
        message = f"image: found no mask {folder / name}.png; the whole image is used"
        warnings.warn(message, ImageWarning, stacklevel=2)
        return None
    with reading(path, ImageError):
        data = np.frombuffer(read_bytes(path), np.uint8)
    with quiet_opencv():
        pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if pixels is None:
        raise ImageError(f"{path}: expected a mask as an image, found another format")
    mirrored, turns = TURNS[orientation - 1]
    upright: BoolArray = np.rot90(pixels[:, ::-1] if mirrored else pixels, turns) != 0
    return upright
