"""HTML pages that open from disk and need no network; all text on them is escaped."""

import base64
import hashlib
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files


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
