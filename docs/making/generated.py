"""Markdown extension: generated parts of pages, and formulas as MathML."""

import re
from html import unescape

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.postprocessors import Postprocessor
from markdown.preprocessors import Preprocessor

from appendices import steps_markdown
from saccade.viewing.textbook.walkthrough import code_html

UNNAMED = re.compile(r"<th( [^>]*)?></th>")
CODE = re.compile(r"<code>([^<]*)</code>")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
STEPS = re.compile(r"<!-- steps of appendix ([ABC]) -->")
AFTER_SNIPPETS = 31.5


class Generated(Preprocessor):
    """Inserts the steps of the appendices; links of the changelog become relative to docs."""

    def run(self, lines: list[str]) -> list[str]:
        """The lines of a page."""
        text = "\n".join(lines).replace("](docs/", "](")
        return STEPS.sub(lambda found: steps_markdown(found[1]), text).split("\n")


class Accessible(Postprocessor):
    """Replaces formulas by MathML, which browsers and screen readers support without a script.

    Empty table headings become plain cells, which screen readers skip. Code breaks between tokens.
    """

    def run(self, text: str) -> str:
        """The HTML of a page."""
        text = UNNAMED.sub(r"<td\1></td>", FORMULA.sub(_formula, text))
        return CODE.sub(lambda found: code_html(found[1]), text)


class GeneratedExtension(Extension):
    """Both, for Python-Markdown, which names the methods."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        """Register them."""
        md.preprocessors.register(Generated(md), "generated", AFTER_SNIPPETS)
        md.postprocessors.register(Accessible(md), "accessible", 0)


def makeExtension() -> GeneratedExtension:  # noqa: N802
    """The extension."""
    return GeneratedExtension()


def _formula(found: re.Match[str]) -> str:
    tag, kind, tex = found.groups()
    display = "block" if kind == "[" else "inline"
    mathml = convert(unescape(tex).strip(), display=display)
    return f'<{tag} class="formula">{mathml}</{tag}>'
