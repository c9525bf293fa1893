"""The report: one self-contained, interactive HTML page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

from saccade.viewing.embedding import json_element
from saccade.viewing.page import Section, section_html, standalone_page, web_file

SCRIPTS: dict[str, tuple[str, ...]] = {
    "map": ("uPlot.iife.min.js", "charts.js", "ground.js", "map.js"),
    "image": ("photo.js", "image.js"),
    "match": ("photo.js", "match.js"),
    "table": ("table.js",),
}
"""Of each kind of part, beside those of every page."""
STYLES = ("page.css", "uPlot.min.css", "report.css")
MAX_PART_LENGTH = 4_500_000
"""Characters of a part, so that a page with it stays under 5 MB."""


@dataclass(frozen=True)
class Part:
    """An interactive section of a report."""

    section: Section
    """Its heading, text, facts and links."""
    kind: Literal["map", "image", "match", "table"]
    """Which script shows it."""
    data: Mapping[str, Any]
    """The input of that script: JSON, and arrays of numbers."""

    @cached_property
    def html(self) -> str:
        """The part as HTML."""
        data = json_element(self.data)
        content = f'\n<div class="part" data-kind="{self.kind}">{data}</div>\n'
        return section_html(self.section, content)


def report_page(title: str, lead: str, parts: Sequence[Part]) -> str:
    """The report as the text of one HTML file.

    Args:
        title: of the page.
        lead: its first paragraph.
        parts: in their order.
    """
    of_parts = dict.fromkeys(name for part in parts for name in SCRIPTS[part.kind])
    scripts = [web_file(name) for name in ("report.js", *of_parts, "start.js")]
    body = "\n".join(part.html for part in parts) + "\n"
    body += "<noscript><p>The interactive parts of this page need JavaScript.</p></noscript>"
    return standalone_page(title, lead, body, [web_file(name) for name in STYLES], scripts)


def with_notes(section: Section, thinned: Mapping[str, tuple[int, int]]) -> Section:
    """A section whose text says which of its data were left out.

    Args:
        section: heading, text, facts and links.
        thinned: by name, the number of items and the stride at which they were taken.
    """
    notes = [
        f"Of {count:,} {name} one in {stride} is on this page."
        for name, (count, stride) in thinned.items()
        if stride > 1
    ]
    return replace(section, text=" ".join([section.text, *notes]))
