"""One plain page that shows pictures and figures; opens from disk, needs no network."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files


@dataclass(frozen=True)
class Picture:
    """An image file beside the page."""

    source: str
    """Path relative to the page."""
    alternative: str
    """What a reader who cannot see it should know."""
    caption: str
    wide: bool = False
    """Whether it is no use when small: where there is no room for it, it scrolls sideways."""


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
    body = "\n".join(section_html(section) for section in sections)
    return whole_page(title, lead, body, f"<style>{web_file('page.css')}</style>")


def whole_page(title: str, lead: str, body: str, head: str) -> str:
    """A page around HTML.

    Args:
        title: to be escaped.
        lead: the first paragraph, to be escaped.
        body: what follows it.
        head: what stands in the head beside the title.
    """
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{head}\n<title>{escape(title)}</title>\n</head>\n<body>\n<main>\n"
        f'<h1>{escape(title)}</h1>\n<p class="lead">{escape(lead)}</p>\n{body}\n'
        "</main>\n</body>\n</html>\n"
    )


def escape(text: str) -> str:
    """Words as HTML; what of a file's name is no text is shown as a question mark."""
    return html.escape(text.encode(errors="replace").decode())


def web_file(name: str) -> str:
    """The text of a style or a script that ships with the package."""
    return (files("saccade.viewing") / "web" / name).read_text(encoding="utf-8")


def section_html(section: Section, inside: str = "") -> str:
    """A section as HTML, with more HTML behind its text."""
    parts = [
        f"<section>\n<h2>{escape(section.heading)}</h2>\n<p>{escape(section.text)}</p>{inside}",
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
    """A picture with its caption; a wide one scrolls where there is no room for it."""
    image = f'<img src="{escape(picture.source)}" alt="{escape(picture.alternative)}">'
    if picture.wide:
        image = (
            f'<div class="wide" tabindex="0" role="group" aria-label="{escape(picture.caption)}">'
            f"{image}</div>"
        )
    return f"<figure>\n{image}\n<figcaption>{escape(picture.caption)}</figcaption>\n</figure>"
