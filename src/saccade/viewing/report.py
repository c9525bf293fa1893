"""The report: one self-contained, interactive HTML page, built part by part."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from saccade.io.files import atomic_write
from saccade.types import BoolArray, Float32Array, IntArray, Keypoints, Scanpath, ScanpathSamples
from saccade.viewing.page import Section, heat, html_page, json_element, photograph

SCRIPTS: dict[str, tuple[str, ...]] = {
    "map": ("charts.js", "ground.js", "map.js"),
    "image": ("photo.js", "samples.js", "image.js"),
    "match": ("photo.js", "match.js"),
}
"""Additional scripts for each kind of part."""
MAX_LENGTH = 4_700_000
"""Maximum characters of all parts, for a page under 5 MB."""
MAX_DESCRIBED_POINTS = 400
"""Maximum number of interest points, shown with their descriptors."""
MAX_MATCHES = 5000
"""Maximum number of matches of two photographs."""


@dataclass(frozen=True)
class Part:
    """An interactive section of a report."""

    section: Section
    """Its heading, text and facts."""
    kind: Literal["map", "image", "match"]
    """Script that shows it."""
    data: Mapping[str, Any]
    """The input of that script: JSON, and arrays of numbers."""

    @cached_property
    def html(self) -> str:
        """The part as HTML."""
        data = json_element(self.data)
        return self.section.html(f'\n<div class="part" data-kind="{self.kind}">{data}</div>\n')


class ReportBuilder:
    """Collects the parts of a report up to a size limit; the first part is always kept.

    Args:
        title: title of the page.
        lead: first paragraph of the page.
    """

    def __init__(self, title: str, lead: str) -> None:
        self.title = title
        self.lead = lead
        self._parts: list[Part] = []
        self._omitted = 0

    def add(self, make: Callable[[], Part]) -> None:
        """Adds a part if it fits; after the first that does not fit, further parts are skipped."""
        if not self._omitted:
            part = make()
            length = sum(len(each.html) for each in (*self._parts, part))
            if not self._parts or length <= MAX_LENGTH:
                self._parts.append(part)
                return
        self._omitted += 1

    def __len__(self) -> int:
        return len(self._parts)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts that are kept, in order."""
        return tuple(self._parts)

    def write(self, path: Path) -> Path:
        """Write the page; returns its path."""
        more = f" {self._omitted} more did not fit on this page." if self._omitted else ""
        with atomic_write(path) as temporary:
            page = report_page(self.title, self.lead + more, self._parts)
            temporary.write_text(page, encoding="utf-8", errors="backslashreplace")
        return path


def report_page(title: str, lead: str, parts: Sequence[Part]) -> str:
    """The report as the text of one HTML file.

    Args:
        title: of the page.
        lead: its first paragraph.
        parts: in their order.
    """
    of_parts = dict.fromkeys(name for part in parts for name in SCRIPTS[part.kind])
    body = "\n".join(part.html for part in parts) + "\n"
    body += "<noscript><p>The interactive parts of this page need JavaScript.</p></noscript>"
    scripts = ("report.js", *of_parts, "start.js")
    return html_page(title, lead, body, ("page.css", "report.css"), scripts)


def image_part(
    section: Section,
    image: Float32Array,
    maps: Mapping[str, Float32Array],
    path: Scanpath,
    keypoints: Keypoints,
    samples: ScanpathSamples | None = None,
) -> Part:
    """A photograph with saliency maps, scanpaths and interest points as layers.

    Args:
        section: heading, text and facts.
        image: (H, W, 3) in [0, 1].
        maps: by title; each (h, w), not negative.
        path: fixations.
        keypoints: the first `MAX_DESCRIBED_POINTS` are shown.
        samples: more scanpaths, with the distributions of their saccades.
    """
    data: dict[str, Any] = {
        "image": photograph(image),
        "maps": maps_data(maps),
        "scanpath": scanpath_data(path),
        "points": points_data(keypoints[:MAX_DESCRIBED_POINTS]),
    }
    if samples is not None and samples.xy.size:
        data["samples"] = {"xy": samples.xy.ravel(), "length": samples.xy.shape[1]}
    return Part(section, "image", data)


def match_part(
    section: Section,
    images: tuple[Float32Array, Float32Array],
    keypoints: tuple[Keypoints, Keypoints],
    pairs: IntArray,
    inliers: BoolArray | None = None,
) -> Part:
    """Two photographs with their matches.

    Args:
        section: heading, text and facts.
        images: two (H, W, 3) in [0, 1].
        keypoints: of each.
        pairs: (m, 2) indices into the two.
        inliers: (m,) which matches agree with one geometry; None without verification.
    """
    step = stride(len(pairs), MAX_MATCHES)
    first, second = (keypoints[i][pairs[::step, i]] for i in (0, 1))
    data: dict[str, Any] = {
        "images": [photograph(image) for image in images],
        "xy": np.hstack([first.xy, second.xy]).ravel(),
        "size": np.stack([first.size, second.size], 1).ravel(),
    }
    if first.descriptors is not None and second.descriptors is not None:
        difference = first.descriptors.astype(np.float64) - second.descriptors
        data["distance"] = np.sqrt(np.square(difference).sum(1))
    if inliers is not None:
        data["inlier"] = inliers[::step].astype(np.uint8)
    return Part(with_notes(section, {"matches": (len(pairs), step)}), "match", data)


def maps_data(maps: Mapping[str, Float32Array]) -> list[dict[str, str]]:
    """Saliency maps for the script of an image part."""
    return [{"name": name, "address": heat(values)} for name, values in maps.items()]


def scanpath_data(path: Scanpath) -> dict[str, Any]:
    """Fixations for the script of an image part."""
    return {"xy": path.xy.ravel(), "time": path.time, "saliency": path.saliency}


def points_data(points: Keypoints) -> dict[str, Any]:
    """Interest points for the script of an image part."""
    names = ("size", "angle", "response", "octave")
    data = {"xy": points.xy.ravel(), **{name: getattr(points, name) for name in names}}
    if points.descriptors is not None:
        data["descriptor"] = points.descriptors.ravel()
    return data


def stride(count: int, limit: int) -> int:
    """The smallest stride that takes at most `limit` of `count` items."""
    return max(1, -(-count // limit))


def with_notes(section: Section, thinned: Mapping[str, tuple[int, int]]) -> Section:
    """Adds notes about omitted data to the text of a section.

    Args:
        section: heading, text and facts.
        thinned: number of items and stride of the selection, by name.
    """
    notes = [
        f"This page shows one in {step} of {count:,} {name}."
        for name, (count, step) in thinned.items()
        if step > 1
    ]
    return replace(section, text=" ".join([section.text, *notes]))
