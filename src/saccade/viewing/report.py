"""The report: one page that holds all it shows, to be looked at, scrubbed and clicked.

It opens from disk, needs no network, and may load none: its policy allows the styles and the
scripts that it holds, and pictures that are part of it.
"""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

from saccade.viewing.page import Section, section_html, web_file, whole_page

SCRIPTS: dict[str, tuple[str, ...]] = {
    "map": ("uPlot.iife.min.js", "charts.js", "ground.js", "map.js"),
    "image": ("photo.js", "image.js"),
    "match": ("photo.js", "match.js"),
    "table": ("table.js",),
}
"""Of each kind of part, beside those of every page."""
MAX_LENGTH = 4_500_000
"""Letters of a part, so that a page with it stays under 5 MB."""
PICTURE = 1_300_000
"""Letters of one picture, likewise."""
_PACKED = ("float32", "int32", "int16", "uint16", "uint8")
"""Kinds of numbers that a browser takes as they are in memory."""


@dataclass(frozen=True)
class Part:
    """A section with something in it that can be handled."""

    section: Section
    """Its heading, text, facts and links."""
    kind: Literal["map", "image", "match", "table"]
    """Which script shows it."""
    data: Mapping[str, Any]
    """What that script is given: JSON, and arrays of numbers."""

    @property
    def letters(self) -> int:
        """How long it is on the page."""
        return len(self.html)

    @cached_property
    def html(self) -> str:
        """As it stands on the page."""
        inside = f'\n<div class="part" data-kind="{self.kind}">'
        data = script_data(self.data)
        inside += f'<script type="application/json">{data}</script></div>\n'
        return section_html(self.section, inside)


def report_page(title: str, lead: str, parts: Sequence[Part]) -> str:
    """The report as the text of one HTML file; every word of it is escaped.

    Args:
        title: of the page.
        lead: its first paragraph.
        parts: what it shows.
    """
    kinds = list(dict.fromkeys(part.kind for part in parts))
    names = ["report.js", *dict.fromkeys(name for kind in kinds for name in SCRIPTS[kind])]
    scripts = [web_file(name) for name in [*names, "start.js"]]
    styles = [web_file(name) for name in ("page.css", "uPlot.min.css", "report.css")]
    policy = (
        "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
        f"style-src {hashes(styles)}; script-src {hashes(scripts)}"
    )
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    head += '<meta name="color-scheme" content="light dark">\n'
    head += "\n".join(f"<style>{style}</style>" for style in styles)
    body = "\n".join(part.html for part in parts) + "\n"
    body += "<noscript><p>What moves on this page needs JavaScript.</p></noscript>\n"
    body += "\n".join(f"<script>{script}</script>" for script in scripts)
    return whole_page(title, lead, body, head)


def with_notes(section: Section, thinned: Mapping[str, tuple[int, int]]) -> Section:
    """A section that says what of it was left out.

    Args:
        section: heading, text, facts and links.
        thinned: by what they are called, how many there were, and of how many one is kept.
    """
    notes = [
        f"Of {count:,} {name} one in {stride} is on this page."
        for name, (count, stride) in thinned.items()
        if stride > 1
    ]
    return replace(section, text=" ".join([section.text, *notes]))


def jpeg(picture: npt.NDArray[np.uint8], quality: int = 80) -> str:
    """A picture (h, w) or (h, w, 3) in RGB as the address of a JPEG that holds it.

    One of noise gets a lower quality, so that it has at most `PICTURE` letters.
    """
    with BytesIO() as file:
        Pillow.fromarray(picture).save(file, format="JPEG", quality=quality, optimize=True)
        address = "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode()
    return address if len(address) <= PICTURE or quality < 10 else jpeg(picture, quality // 2)


def png_file(path: Path) -> str:
    """The address of a PNG that holds what is in a file."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()


def as_json(data: Mapping[str, Any]) -> str:
    """What a script of ours is given: JSON, and arrays of numbers packed in it."""
    return json.dumps(_plain(data), separators=(",", ":"), allow_nan=False)


def script_data(data: Mapping[str, Any]) -> str:
    """The same inside of a script element: no word in it ends the element."""
    return as_json(data).replace("<", "\\u003c")


def hashes(texts: Sequence[str]) -> str:
    """The sources of a Content-Security-Policy that allow scripts or styles of these texts."""
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    return " ".join(f"'sha256-{base64.b64encode(each).decode()}'" for each in digests)


def _plain(value: Any) -> Any:
    """A value as JSON knows it; arrays are packed, what is not finite is null."""
    if isinstance(value, np.ndarray):
        if value.dtype.name not in _PACKED:
            whole = value.dtype.kind in "biu"
            value = value.astype(np.int32 if whole else np.float32)
        packed = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        return {"type": value.dtype.name, "base64": base64.b64encode(packed.tobytes()).decode()}
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
