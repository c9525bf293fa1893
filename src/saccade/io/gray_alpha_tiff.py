"""16-bit gray TIFF images with alpha, which OpenCV and Pillow do not read completely.

They are decoded as an image of twice the width, with alternating gray and alpha samples.
Source of tags: Adobe, "TIFF Revision 6.0".
"""

import struct
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError

WIDTH = 256
HEIGHT = 257
BITS = 258
PHOTOMETRIC = 262
ORIENTATION = 274
SAMPLES = 277
PLANAR = 284
PREDICTOR = 317
TILE_WIDTH = 322
EXTRA_SAMPLES = 338
SAMPLE_FORMAT = 339
SHORT = 3
"""Tag type of 16-bit values."""
LONG = 4
"""Tag type of 32-bit values."""
ASSOCIATED = 1
"""Value of ExtraSamples for premultiplied alpha."""


class GrayAlpha(NamedTuple):
    """A gray image with alpha."""

    width: int
    height: int
    orientation: int
    """EXIF orientation, 1 to 8."""
    multiplied: bool
    """Whether gray is premultiplied by alpha."""
    differs: bool
    """Whether rows are stored as horizontal differences."""
    data: bytes
    """The file of the image of twice the width."""


def find_gray_alpha(data: bytes, name: str) -> GrayAlpha | None:
    """Finds a gray TIFF with alpha in the bytes of a file; None for all other files.

    Raises:
        ImageError: unsupported storage (tiles of differences, planes, inverted gray).
    """
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    try:
        (start,) = struct.unpack_from(f"{order}I", data, 4) if order else (len(data),)
        (count,) = struct.unpack_from(f"{order}H", data, start)
        rows = [struct.unpack_from(f"{order}HHI4s", data, start + 2 + 12 * k) for k in range(count)]
    except struct.error:
        return None
    entries = {tag: rest for tag, *rest in rows}

    def number(tag: int, default: int) -> int:
        kind, _, value = entries.get(tag, (LONG, 1, struct.pack(f"{order}I", default)))
        return int(struct.unpack_from(f"{order}{'H' if kind == SHORT else 'I'}", value)[0])

    if number(SAMPLES, 1) != 2 or number(BITS, 1) != 16:
        return None
    differs = number(PREDICTOR, 1) == 2
    if number(PLANAR, 1) != 1 or number(PHOTOMETRIC, 1) != 1 or (differs and TILE_WIDTH in entries):
        raise ImageError(f"{name}: unsupported kind of gray TIFF with alpha; save it as PNG")
    changed = {WIDTH: 2 * number(WIDTH, 0), BITS: 16, SAMPLES: 1}
    changed |= {TILE_WIDTH: 2 * number(TILE_WIDTH, 0)} if TILE_WIDTH in entries else {}
    for tag, value in changed.items():
        entries[tag] = [LONG, 1, struct.pack(f"{order}I", value)]
    kept = sorted(entries.keys() - {EXTRA_SAMPLES, ORIENTATION, SAMPLE_FORMAT})
    table = struct.pack(f"{order}H", len(kept))
    table += b"".join(struct.pack(f"{order}HHI4s", tag, *entries[tag]) for tag in kept)
    body = data + bytes(len(data) % 2)
    wide = body[:4] + struct.pack(f"{order}I", len(body)) + body[8:] + table + bytes(4)
    turned = number(ORIENTATION, 1)
    return GrayAlpha(
        number(WIDTH, 0) // 2,
        number(HEIGHT, 0),
        turned if turned in range(1, 9) else 1,
        number(EXTRA_SAMPLES, 0) == ASSOCIATED,
        differs,
        wide,
    )


def split_opacity(pixels: npt.NDArray[np.uint16], differs: bool) -> npt.NDArray[np.uint16]:
    """(H, W, 4) RGBA from the pixels (H, 2W) of the image of twice the width."""
    pairs = pixels.reshape(len(pixels), -1, 2)
    if differs:  # differences between gray and alpha samples, to be undone
        steps = np.diff(pixels, axis=1, prepend=np.uint16(0)).reshape(pairs.shape)
        pairs = np.cumsum(steps, axis=1, dtype=np.uint16)
    gray, opacity = pairs[:, :, 0], pairs[:, :, 1]
    return np.dstack([gray, gray, gray, opacity])
