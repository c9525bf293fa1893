"""MkDocs hooks: figures drawn by the code, and formulas as MathML."""

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
    """Draw the figures if the code has changed."""
    import sys

    sys.path.insert(0, str(Path(__file__).parent))
    from pictures import make_all

    make_all(ROOT / "docs" / "pictures")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Insert the steps of the appendices, and the changelog with links relative to docs."""
    if page.file.src_uri == "appendices.md":
        from appendices import steps_markdown

        return STEPS.sub(lambda found: steps_markdown(found[1]), markdown)
    if page.file.src_uri != "changelog.md":
        return markdown
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")


def on_page_content(html: str, **_: Any) -> str:
    """Replace formulas by MathML, which browsers and screen readers support without a script.

    Empty table headings become plain cells, which screen readers skip.
    """
    return UNNAMED.sub(r"<td\1></td>", FORMULA.sub(_formula, html))


def on_post_page(output: str, **_: Any) -> str:
    """Label the search box for screen readers."""
    return output.replace('class="md-search"', 'class="md-search" aria-label="Search"')


def on_post_build(config: Any) -> None:
    """Copy the font of the formulas, which is part of ziamath, under the SIL license."""
    (package,) = find_spec("ziamath").submodule_search_locations
    font = Path(package) / "fonts" / "STIXTwoMath-Regular.ttf"
    copyfile(font, Path(config.site_dir) / "assets" / "STIXTwoMath.ttf")


def _formula(found: re.Match[str]) -> str:
    tag, kind, tex = found.groups()
    display = "block" if kind == "[" else "inline"
    mathml = convert(unescape(tex).strip(), display=display)
    return f'<{tag} class="formula">{mathml}</{tag}>'
