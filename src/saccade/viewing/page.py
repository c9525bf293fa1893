"""One plain page that shows pictures and figures; opens from disk, needs no network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

_STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #fff; --soft: #5b6570; --line: #d8dde3; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8ebef; --paper: #14181d; --soft: #a3adb8; --line: #343b44; }
}
body { margin: 0 auto; max-width: 64rem; padding: 2rem 1.25rem 4rem; color: var(--ink);
  background: var(--paper); font: 1rem/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .25rem; }
h2 { font-size: 1.3rem; margin: 3rem 0 .25rem; border-top: 1px solid var(--line);
  padding-top: 1.5rem; }
p { max-width: 46rem; margin: .4rem 0 1rem; }
.lead, figcaption { color: var(--soft); }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; border-radius: 6px; background: #fff; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { text-align: left; padding: .3rem 1.5rem .3rem 0; border-bottom: 1px solid var(--line); }
th { font-weight: 500; color: var(--soft); }
td { font-variant-numeric: tabular-nums; }
a { color: inherit; }
"""


@dataclass(frozen=True)
class Picture:
    """An image file beside the page."""

    source: str
    """Path relative to the page."""
    alternative: str
    """What a reader who cannot see it should know."""
    caption: str


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph, pictures, facts and links to files, in that order."""

    heading: str
    text: str
    pictures: Sequence[Picture] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    links: Sequence[str] = ()
    """Paths relative to the page."""


def html_page(title: str, lead: str, sections: Sequence[Section]) -> str:
    """The page as text; every word of it is escaped."""
    body = "\n".join(_section(section) for section in sections)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
        f'<h1>{escape(title)}</h1>\n<p class="lead">{escape(lead)}</p>\n{body}\n'
        "</main>\n</body>\n</html>\n"
    )


def _section(section: Section) -> str:
    parts = [
        f"<section>\n<h2>{escape(section.heading)}</h2>\n<p>{escape(section.text)}</p>",
        *map(_picture, section.pictures),
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


def _picture(picture: Picture) -> str:
    return (
        f'<figure>\n<img src="{escape(picture.source)}" alt="{escape(picture.alternative)}">\n'
        f"<figcaption>{escape(picture.caption)}</figcaption>\n</figure>"
    )
