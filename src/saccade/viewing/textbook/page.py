"""The page of a walkthrough: each equation beside the code that computes it, and the figures."""

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure

from saccade.viewing.page import Picture, data_uri, escape, picture_html, standalone_page, web_file
from saccade.viewing.textbook.walkthrough import Code, Implementation, Walkthrough

TITLES = {
    "A": "A. The contrast-saliency model",
    "B": "B. The Scale-Invariant Feature Transform",
    "C": "C. EKF-SLAM",
}
WIDE_TEX = 36
"""Characters of TeX from which a formula may be wider than a phone."""


@dataclass(frozen=True)
class Equation:
    """A formula, and how to look up its code."""

    number: str
    """Number in the source; empty where it has none."""
    tex: str
    function: str | None = None
    """The function that computes it, where no comment cites its number."""

    def code_in(self, code: Mapping[str, Code]) -> Code | None:
        """Its lines in the code of an implementation; None where it has none."""
        return code.get(self.function or self.number)


@dataclass(frozen=True)
class Step:
    """A step of an appendix as `web/appendices.toml` describes it."""

    appendix: str
    name: str
    title: str
    text: str
    equations: Sequence[Equation]
    alt: str
    """Its figure in words."""
    caption: str
    default: str = ""
    """Difference of the default of `saccade` from the source, and its reason."""


def load_steps(appendix: str) -> list[Step]:
    """The steps of an appendix, in order."""
    steps = tomllib.loads(web_file("appendices.toml"))["step"]
    return [
        Step(**step | {"equations": [Equation(*each) for each in step["equations"]]})
        for step in steps
        if step["appendix"] == appendix
    ]


def walkthrough_page(title: str, lead: str, walkthroughs: Sequence[Walkthrough]) -> str:
    """The page as the text of one HTML file without scripts.

    Args:
        title: of the page.
        lead: its first paragraph.
        walkthroughs: one for each appendix.
    """
    body = "\n".join(map(_walkthrough_html, walkthroughs))
    return standalone_page(title, lead, body, [web_file("page.css"), web_file("steps.css")])


def save_webp(figure: Figure, file: BytesIO | Path) -> None:
    """Write a figure of a step as WebP, cropped to its panels."""
    figure.savefig(
        file,
        format="webp",
        facecolor="white",
        bbox_inches="tight",
        pad_inches=0.06,
        pil_kwargs={"quality": 86, "method": 4},
    )


def equations_html(
    equations: Sequence[Equation], code: Mapping[str, Code], textbook: Mapping[str, Code]
) -> str:
    """Number and formula on the left, the lines of code on the right.

    Args:
        equations: of one step.
        code: of the implementation.
        textbook: code of the textbook; lines that differ from it are marked.
    """
    rows = (
        _equation_html(equation, equation.code_in(code), equation.code_in(textbook))
        for equation in equations
    )
    return f'<div class="equations">\n{"".join(rows)}</div>'


@cache
def mathml() -> dict[str, str]:
    """The formulas of the steps as MathML, by their TeX."""
    formulas: dict[str, str] = json.loads(web_file("formulas.json"))
    return formulas


def _walkthrough_html(walkthrough: Walkthrough) -> str:
    appendix = walkthrough.implementation.appendix
    heading = f"<section>\n<h2>{TITLES[appendix]}</h2>"
    parts = [f"{heading}\n<p>{_prose_html(walkthrough.text)}</p>"]
    if walkthrough.diff:
        parts.append(f'<pre class="changed"><code>{escape(walkthrough.diff)}</code></pre>')
    parts += [_step_html(step, walkthrough) for step in load_steps(appendix)]
    return "\n".join([*parts, "</section>"])


def _step_html(step: Step, walkthrough: Walkthrough) -> str:
    """Heading, text, equations beside code, figure, results and remark."""
    implementation = walkthrough.implementation
    textbook = Implementation.of_textbook(step.appendix).code
    parts = [
        f"<h3>{escape(step.title)}</h3>\n<p>{_prose_html(step.text)}</p>",
        equations_html(step.equations, implementation.code, textbook),
    ]
    if (figure := walkthrough.figures.get(step.name)) is not None:
        with BytesIO() as file:
            save_webp(figure, file)
            source = data_uri("webp", file.getvalue())
        parts.append(picture_html(Picture(source, step.alt, step.caption, wide=True)))
    if results := walkthrough.results.get(step.name):
        rows = (f"<dt>{escape(name)}</dt><dd>{escape(each)}</dd>" for name, each in results.items())
        parts.append(f"<dl>{''.join(rows)}</dl>")
    if step.default:
        parts.append(f'<p class="default">{_prose_html(step.default)}</p>')
    return "\n".join(parts)


def _equation_html(equation: Equation, code: Code | None, textbook: Code | None) -> str:
    formula, number = mathml()[equation.tex], escape(equation.number)
    name = f"equation {number}" if number else "formula"
    scrollable = f' tabindex="0" role="group" aria-label="{name}"'
    wide = scrollable if "<mtable" in formula or len(equation.tex) > WIDE_TEX else ""
    if code is None:
        lines = "<p>No line cites it.</p>"
    else:
        changed = textbook is None or code.text != textbook.text
        style, note = (' class="changed"', ", changed") if changed else ("", "")
        lines = (
            f"<pre{style}><code>{escape(code.text)}</code></pre>"
            f'<p class="where">{escape(code.file)}, line {code.line}{note}</p>'
        )
    return (
        f'<div class="equation"><div class="print"><p class="number">{number}</p>'
        f'<div class="formula"{wide}>{formula}</div></div><div class="code">{lines}</div></div>\n'
    )


def _prose_html(text: str) -> str:
    """Text with `code`; links to the documentation become plain text."""
    link = re.compile(r"\[([^\]]+)\]\([^)]+\)")
    return "".join(
        f"<code>{escape(part)}</code>" if i % 2 else escape(link.sub(r"\1", part))
        for i, part in enumerate(text.split("`"))
    )
