"""Transparent images: their orientation in a file, and their colors over a background."""

import warnings
from io import BytesIO
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

Color: TypeAlias = tuple[float, float, float]
"""Red, green and blue in [0, 1]."""

WHITE: Color = (1.0, 1.0, 1.0)
"""The background of transparent images, unless another is given."""

ORIENTATION = 0x0112
"""The EXIF tag."""

TURNS = {2: (True, 0), 3: (False, 2), 4: (True, 2), 5: (True, 1), 6: (False, 3)} | {
    7: (True, 3),
    8: (False, 1),
}
"""By EXIF orientation: whether to mirror left and right, and how often to turn by 90 degrees
counterclockwise afterwards."""


class Transparency(NamedTuple):
    """How OpenCV decodes a file with transparency."""

    orientation: int
    """The EXIF orientation that is still to be applied."""
    tiff: bool
    """Whether 8-bit colors are already multiplied by their opacity."""


def composite(
    pixels: npt.NDArray[Any], background: Color, white: float | None, *, multiplied: bool = False
) -> npt.NDArray[Any]:
    """RGBA over a background.

    Args:
        pixels: (H, W, 4).
        background: RGB in [0, 1].
        white: the value of full intensity and opacity; None for the highest of the data type.
        multiplied: whether the colors are already multiplied by their opacity.

    Returns:
        (H, W, 3) in the same dtype; RGB itself where everything is opaque.
    """
    integer = pixels.dtype.kind != "f"
    full = (white or np.iinfo(pixels.dtype).max) if integer else 1.0
    colors, alpha = pixels[:, :, :3], pixels[:, :, 3:]
    if (alpha == full).all():
        return np.ascontiguousarray(colors)
    opacity = alpha.astype(np.float64) / full
    own = colors if multiplied else colors * opacity
    blended = own + np.array(background) * full * (1 - opacity)
    return (np.rint(blended) if integer else blended).astype(pixels.dtype)


def transparency_of(data: bytes) -> Transparency | None:
    """How OpenCV decodes the bytes of a file; None of one without transparency."""
    if data.startswith(b"\xff\xd8"):  # JPEG has none
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its size and its metadata
            with Pillow.open(BytesIO(data)) as image:
                if "A" not in image.getbands() and "transparency" not in image.info:
                    return None
                tiff = image.format == "TIFF"  # which OpenCV turns in every mode
                orientation = 1 if tiff else int(image.getexif().get(ORIENTATION, 1))
                return Transparency(orientation, tiff)
    except (Pillow.DecompressionBombError, OSError, ValueError, SyntaxError, TypeError):
        return None  # OpenCV says what is wrong with it


def upright(pixels: npt.NDArray[Any], orientation: int) -> npt.NDArray[Any]:
    """The pixels of a file, turned as its EXIF orientation says."""
    mirrored, turns = TURNS.get(orientation, (False, 0))
    return np.rot90(pixels[:, ::-1] if mirrored else pixels, turns)
