"""HTML pages that need no network, with images and arrays embedded in them."""

import base64
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from io import BytesIO
from string import Template
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from saccade.types import Float32Array, Image
from saccade.viewing.style import HEAT

MAX_SIDE = 1200
"""Longer side of a photograph on a page, in pixels."""
MAX_MAP_SIDE = 400
"""Longer side of a saliency map on a page, in pixels."""
PACKED_TYPES = ("float32", "int32", "int16", "uint16", "uint8")
"""Data types of JavaScript's typed arrays."""


def data_uri(kind: str, data: bytes) -> str:
    """The data URI of an image file; `kind` is "png", "jpeg" or "webp"."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def shrunk(image: npt.NDArray[Any], scale: float) -> npt.NDArray[Any]:
    """An image scaled by a factor, by 1 at most."""
    height, width = image.shape[:2]
    scale = min(1.0, scale)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def photograph(image: Image, max_side: int = MAX_SIDE, quality: int = 82) -> dict[str, Any]:
    """A photograph as a JPEG, and its size.

    Args:
        image: (H, W) or (H, W, 3), unsigned integers or floats in [0, 1].
        max_side: pixels of the longer side of the JPEG.
        quality: of the JPEG, at most 95.
    """
    height, width = image.shape[:2]
    small = shrunk(image[:, :, :3] if image.ndim == 3 else image, max_side / max(height, width))
    largest = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1
    levels = np.asarray((small * (255 / largest)).round().clip(0, 255), np.uint8)
    with BytesIO() as file:
        Pillow.fromarray(levels).save(file, format="JPEG", quality=quality, optimize=True)
        address = data_uri("jpeg", file.getvalue())
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


def as_json(data: Any) -> str:
    """JSON with arrays packed as base64."""
    return json.dumps(data, default=_packed, separators=(",", ":"), allow_nan=False)


def _packed(array: npt.NDArray[Any]) -> dict[str, str]:
    if array.dtype.name not in PACKED_TYPES:
        array = array.astype(np.int32 if array.dtype.kind in "biu" else np.float32)
    data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()
    return {"type": array.dtype.name, "base64": base64.b64encode(data).decode()}


def json_element(data: Any) -> str:
    """JSON inside a script element; no text in it ends the element."""
    text = as_json(data).replace("<", "\\u003c")
    return f'<script type="application/json">{text}</script>'


def picture_html(source: str, alternative: str, caption: str) -> str:
    """A picture, whose source is a data URI; it scrolls sideways on a narrow screen."""
    name = escape(caption)
    image = f'<img src="{escape(source)}" alt="{escape(alternative)}">'
    scrollable = f'class="wide" tabindex="0" role="group" aria-label="{name}"'
    return f"<figure>\n<div {scrollable}>{image}</div>\n<figcaption>{name}</figcaption>\n</figure>"


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph and facts, in that order."""

    heading: str
    text: str
    facts: Mapping[str, str] = field(default_factory=dict)

    def html(self, content: str = "") -> str:
        """The section, with more HTML after its text."""
        parts = [f"<h2>{escape(self.heading)}</h2>\n<p>{escape(self.text)}</p>{content}"]
        rows = (
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>\n'
            for name, value in self.facts.items()
        )
        parts += [f"<table>\n{''.join(rows)}</table>"] if self.facts else []
        return "\n".join(["<section>", *parts, "</section>"])


def html_page(
    title: str,
    lead: str,
    body: str,
    styles: Sequence[str],
    scripts: Sequence[str] = (),
    *,
    sources: Sequence[str] = ("img-src data:",),
) -> str:
    """An HTML file whose Content-Security-Policy allows its own styles and scripts.

    Args:
        title: of the page.
        lead: its first paragraph.
        body: HTML.
        styles: paths of CSS files, see `web_file`.
        scripts: paths of JavaScript files, run in their order at the end of the page.
        sources: directives of the policy that allow more; by default embedded images.
    """
    rules = ["default-src 'none'", "base-uri 'none'", "form-action 'none'", *sources]
    elements = {}
    for tag, paths in (("style", styles), ("script", scripts)):
        texts = [web_file(path) for path in paths]
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in texts)
        rules.append(" ".join([f"{tag}-src", *(f"'sha256-{each.decode()}'" for each in digests)]))
        elements[f"{tag}s"] = "\n".join(f"<{tag}>{text}</{tag}>" for text in texts)
    return Template(web_file("page.html")).substitute(
        elements, policy="; ".join(rules), title=escape(title), lead=escape(lead), body=body
    )


def escape(text: str) -> str:
    """Text as HTML; bytes of a file name that are not text become question marks."""
    return html.escape(text.encode(errors="replace").decode())


def web_file(path: str) -> str:
    """The text of a file for pages: NAME in the folder `web` of `viewing`, or PACKAGE/NAME."""
    package, _, name = path.rpartition("/")
    return (files(f"saccade.{package or 'viewing'}") / "web" / name).read_text(encoding="utf-8")
