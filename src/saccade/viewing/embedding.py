"""Images and arrays embedded in a page: data URIs and JSON."""

import base64
import json
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image as Pillow

from saccade.types import Float32Array, Image
from saccade.viewing.style import HEAT, png_bytes

MAX_IMAGE_LENGTH = 1_300_000
"""Characters of one image, so that a page with it stays under 5 MB."""
MAX_SIDE, MAX_MAP_SIDE = 1200, 400
"""Pixels of the longer side of a photograph and of a saliency map in a report."""
_PACKED = ("float32", "int32", "int16", "uint16", "uint8")
"""Data types of JavaScript's typed arrays."""


def data_uri(kind: str, data: bytes) -> str:
    """The data URI of an image file; `kind` is "png", "jpeg" or "webp"."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def figure_uri(figure: Figure) -> str:
    """The data URI of a figure as a PNG."""
    return data_uri("png", png_bytes(figure))


def jpeg(image: npt.NDArray[np.uint8], quality: int = 80) -> str:
    """An image (h, w) or (h, w, 3) in RGB as the data URI of a JPEG.

    The quality is halved until it has at most `MAX_IMAGE_LENGTH` characters.
    """
    with BytesIO() as file:
        Pillow.fromarray(image).save(file, format="JPEG", quality=quality, optimize=True)
        uri = data_uri("jpeg", file.getvalue())
    return uri if len(uri) <= MAX_IMAGE_LENGTH or quality < 10 else jpeg(image, quality // 2)


def shrunk(image: npt.NDArray[Any], scale: float) -> npt.NDArray[Any]:
    """An image scaled by a factor, by 1 at most."""
    height, width = image.shape[:2]
    scale = min(1.0, scale)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def photograph(image: Float32Array) -> dict[str, Any]:
    """A photograph (H, W, 3) in [0, 1] as a JPEG of at most `MAX_SIDE` pixels, and its size."""
    height, width = image.shape[:2]
    small = shrunk(image, MAX_SIDE / max(height, width))
    levels = np.asarray((small * 255).round().clip(0, 255), np.uint8)
    return {"address": jpeg(levels, 82), "width": width, "height": height}


def camera_image(image: Image, max_width: int) -> dict[str, Any]:
    """An image of any data type as a JPEG of at most `max_width` pixels, and its size."""
    height, width = image.shape[:2]
    if image.dtype != np.uint8:
        largest = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1
        image = np.asarray((image * (255 / largest)).clip(0, 255), np.uint8)
    rgb = image if image.ndim == 2 else np.ascontiguousarray(image[:, :, :3])
    address = jpeg(shrunk(rgb, max_width / width), 65)
    return {"address": address, "width": width, "height": height}


def heat(values: Float32Array) -> str:
    """A map as the data URI of a PNG, from 0 to its maximum."""
    small = shrunk(np.asarray(values, np.float32), MAX_MAP_SIDE / max(values.shape))
    levels = np.asarray((small * (255 / max(float(small.max()), 1e-12))).round(), np.uint8)
    image = Pillow.fromarray(levels, "L")
    colors = mpl.colormaps[HEAT](np.arange(256))[:, :3]
    image.putpalette(np.asarray((colors * 255).round(), np.uint8).tobytes())
    with BytesIO() as file:
        image.save(file, format="PNG")
        return data_uri("png", file.getvalue())


def as_json(data: Mapping[str, Any]) -> str:
    """JSON with arrays packed as base64; values that are not finite become null."""
    return json.dumps(_packed(data), separators=(",", ":"), allow_nan=False)


def json_element(data: Mapping[str, Any]) -> str:
    """JSON inside a script element; no text in it ends the element."""
    text = as_json(data).replace("<", "\\u003c")
    return f'<script type="application/json">{text}</script>'


def _packed(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype.name not in _PACKED:
            value = value.astype(np.int32 if value.dtype.kind in "biu" else np.float32)
        packed = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        return {"type": value.dtype.name, "base64": base64.b64encode(packed.tobytes()).decode()}
    if isinstance(value, Mapping):
        return {str(name): _packed(each) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_packed(each) for each in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
