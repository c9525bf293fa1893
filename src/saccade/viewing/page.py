"""HTML pages that open from disk and need no network, with images and arrays embedded in them."""

import base64
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
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


@dataclass(frozen=True)
class Picture:
    """An image on a page."""

    source: str
    """Path relative to the page, or a data URI."""
    alternative: str
    """Alternative text."""
    caption: str
    wide: bool = False
    """Whether it scrolls sideways on a narrow screen rather than shrinks."""


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph, pictures, facts and links to files, in that order."""

    heading: str
    text: str
    pictures: Sequence[Picture] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    links: Sequence[str] = ()
    """Paths relative to the page."""


def html_page(title: str, lead: str, sections: Sequence[Section], links: Mapping[str, str]) -> str:
    """A page of sections side by side, picture first, with images beside it on disk.

    Args:
        title: of the page.
        lead: its first paragraph.
        sections: in their order.
        links: by path relative to the page, their text; above the sections.
    """
    above = "".join(
        f'<p><a href="{escape(path)}">{escape(text)}</a></p>\n' for path, text in links.items()
    )
    cards = "\n".join(section_html(section) for section in sections)
    body = f'{above}<div class="cards">\n{cards}\n</div>'
    return html_document(title, lead, body, [web_file("page.css")])


def standalone_page(
    title: str, lead: str, body: str, styles: Sequence[str], scripts: Sequence[str] = ()
) -> str:
    """A self-contained page, whose Content-Security-Policy lets it load nothing.

    Args:
        title: of the page.
        lead: its first paragraph.
        body: HTML.
        styles: CSS.
        scripts: JavaScript, run at the end of the page.
    """
    policy = security_policy(styles, scripts, "img-src data:")
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    return html_document(title, lead, body, styles, scripts, head)


def html_document(
    title: str,
    lead: str,
    body: str,
    styles: Sequence[str],
    scripts: Sequence[str] = (),
    head: str = "",
) -> str:
    """A whole HTML file; as for `standalone_page`, `head` is more HTML for its head."""
    head += '<meta name="color-scheme" content="light dark">\n'
    head += "\n".join(f"<style>{style}</style>" for style in styles)
    body += "".join(f"\n<script>{script}</script>" for script in scripts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{head}\n<title>{escape(title)}</title>\n</head>\n<body>\n<main>\n"
        f'<h1>{escape(title)}</h1>\n<p class="lead">{escape(lead)}</p>\n{body}\n'
        "</main>\n</body>\n</html>\n"
    )


def security_policy(styles: Sequence[str], scripts: Sequence[str], *directives: str) -> str:
    """The Content-Security-Policy that allows these styles and scripts, and `directives`."""
    rules = ["default-src 'none'", "base-uri 'none'", "form-action 'none'", *directives]
    for name, texts in (("style-src", styles), ("script-src", scripts)):
        digests = (hashlib.sha256(text.encode()).digest() for text in texts)
        sources = " ".join(f"'sha256-{base64.b64encode(each).decode()}'" for each in digests)
        rules += [f"{name} {sources}"] if sources else []
    return "; ".join(rules)


def escape(text: str) -> str:
    """Text as HTML; bytes of a file name that are not text become question marks."""
    return html.escape(text.encode(errors="replace").decode())


def web_file(name: str, package: str = "saccade.viewing") -> str:
    """The text of a style or a script that ships with a package, in its folder `web`."""
    return (files(package) / "web" / name).read_text(encoding="utf-8")


def section_html(section: Section, content: str = "") -> str:
    """A section as HTML, with more HTML after its text."""
    parts = [
        f"<section>\n<h2>{escape(section.heading)}</h2>\n<p>{escape(section.text)}</p>{content}",
        *map(picture_html, section.pictures),
    ]
    if section.facts:
        rows = "".join(
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>\n'
            for name, value in section.facts.items()
        )
        parts.append(f"<table>\n{rows}</table>")
    if section.links:
        links = ", ".join(f'<a href="{escape(link)}">{escape(link)}</a>' for link in section.links)
        parts.append(f"<p>Files: {links}</p>")
    return "\n".join([*parts, "</section>"])


def picture_html(picture: Picture) -> str:
    """A picture with its caption."""
    image = f'<img src="{escape(picture.source)}" alt="{escape(picture.alternative)}">'
    if picture.wide:
        image = (
            f'<div class="wide" tabindex="0" role="group" aria-label="{escape(picture.caption)}">'
            f"{image}</div>"
        )
    return f"<figure>\n{image}\n<figcaption>{escape(picture.caption)}</figcaption>\n</figure>"
