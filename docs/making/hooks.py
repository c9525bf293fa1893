"""What the site needs beside MkDocs: pictures made by the code, and formulas as MathML."""

import re
from html import unescape
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from typing import Any

from latex2mathml.converter import convert

UNNAMED = re.compile(r"<th( [^>]*)?></th>")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
STEPS = re.compile(r"<!-- steps of appendix ([ABC]) -->")
ROOT = Path(__file__).parents[2]


def on_pre_build(config: Any) -> None:
    """Make the pictures, as far as they are older than what they are made of."""
    import sys

    sys.path.insert(0, str(Path(__file__).parent))
    from pictures import make_all

    make_all(ROOT / "docs" / "pictures")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The steps through the appendices; the changelog, its links as seen from here."""
    if page.file.src_uri == "appendices.md":
        from appendices import steps_markdown

        return STEPS.sub(lambda found: steps_markdown(found[1]), markdown)
    if page.file.src_uri != "changelog.md":
        return markdown
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")


def on_page_content(html: str, **_: Any) -> str:
    """Every formula as MathML: browsers set it without a script, and readers read it aloud.

    The corner of a table is no heading: nothing is read where nothing is written.
    """
    return UNNAMED.sub(r"<td\1></td>", FORMULA.sub(_formula, html))


def on_post_page(output: str, **_: Any) -> str:
    """Name the theme's search for those who hear the page."""
    return output.replace('class="md-search"', 'class="md-search" aria-label="Search"')


def on_post_build(config: Any) -> None:
    """Ship the font that formulas are set in; it comes with ziamath, under the SIL licence."""
    (package,) = find_spec("ziamath").submodule_search_locations
    font = Path(package) / "fonts" / "STIXTwoMath-Regular.ttf"
    copyfile(font, Path(config.site_dir) / "assets" / "STIXTwoMath.ttf")


def _formula(found: re.Match[str]) -> str:
    tag, kind, tex = found.groups()
    display = "block" if kind == "[" else "inline"
    mathml = convert(unescape(tex).strip(), display=display)
    return f'<{tag} class="formula">{mathml}</{tag}>'
