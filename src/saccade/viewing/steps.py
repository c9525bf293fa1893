"""A walk through equations: each beside the line of code that computes it, and the picture."""

import base64
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from saccade.viewing.page import Picture, escape, picture_html, web_file, whole_page
from saccade.viewing.report import hashes

WIDE = 36
"""Letters of TeX from which a formula may be wider than a phone."""
_CODE_OR_LINK = re.compile(r"`([^`]+)`|\[([^\]]+)\]\([^)]+\)")


@dataclass(frozen=True)
class Code:
    """The lines of a source file that compute an equation."""

    file: str
    line: int
    """Of the first of them, from 1."""
    text: str
    changed: bool = False
    """Whether they differ from those of the textbook."""


@dataclass(frozen=True)
class Equation:
    """One equation and its code."""

    number: str
    """As in print; empty where it has none."""
    tex: str
    code: Code | None
    """None where no line cites it."""


@dataclass(frozen=True)
class Step:
    """What is done, by which equations, and what it looks like."""

    title: str
    text: str
    equations: Sequence[Equation]
    picture: Picture | None = None
    default: str = ""
    """How the default differs from the print, and why."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """What came of it, by name."""


@dataclass(frozen=True)
class Group:
    """The steps of one appendix."""

    heading: str
    text: str
    changes: str
    """How its code differs from the textbook's, as a unified diff; empty for the textbook's own."""
    steps: Sequence[Step]


def step_table() -> list[dict[str, Any]]:
    """The steps through the appendices, as `web/appendices.toml` has them."""
    steps: list[dict[str, Any]] = tomllib.loads(web_file("appendices.toml"))["step"]
    return steps


def steps_page(title: str, lead: str, groups: Sequence[Group]) -> str:
    """The page as the text of one HTML file without scripts; every word of it is escaped.

    Args:
        title: of the page.
        lead: its first paragraph.
        groups: one for each appendix.
    """
    styles = [web_file("page.css"), web_file("steps.css")]
    policy = f"default-src 'none'; img-src data:; style-src {hashes(styles)}; base-uri 'none'"
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    head += '<meta name="color-scheme" content="light dark">\n'
    head += "\n".join(f"<style>{style}</style>" for style in styles)
    return whole_page(title, lead, "\n".join(map(_group_html, groups)), head)


def figure_source(figure: Figure) -> str:
    """The address of a picture that holds a figure."""
    with BytesIO() as file:
        save_step(figure, file)
        return "data:image/webp;base64," + base64.b64encode(file.getvalue()).decode()


def save_step(figure: Figure, file: BytesIO | Path) -> None:
    """Write a figure of a step as WebP, without the room that its panels leave around them."""
    figure.savefig(
        file,
        format="webp",
        facecolor="white",
        bbox_inches="tight",
        pad_inches=0.06,
        pil_kwargs={"quality": 86, "method": 4},
    )


def _group_html(group: Group) -> str:
    parts = [f"<section>\n<h2>{escape(group.heading)}</h2>\n<p>{prose_html(group.text)}</p>"]
    if group.changes:
        parts.append(f'<pre class="changed"><code>{escape(group.changes)}</code></pre>')
    parts += [f"<h3>{escape(step.title)}</h3>\n{step_html(step)}" for step in group.steps]
    return "\n".join([*parts, "</section>"])


def step_html(step: Step) -> str:
    """A step without its heading: text, equations beside code, picture, facts, remark."""
    parts = [f"<p>{prose_html(step.text)}</p>", equations_html(step.equations)]
    if step.picture is not None:
        parts.append(picture_html(step.picture))
    if step.facts:
        rows = (
            f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in step.facts.items()
        )
        parts.append(f"<dl>{''.join(rows)}</dl>")
    if step.default:
        parts.append(f'<p class="default">{prose_html(step.default)}</p>')
    return "\n".join(parts)


def equations_html(equations: Sequence[Equation]) -> str:
    """Number and formula on the left, the lines of code on the right."""
    return f'<div class="equations">\n{"".join(map(_equation_html, equations))}</div>'


def _equation_html(equation: Equation) -> str:
    formula, number = mathml(equation.tex), escape(equation.number)
    name = f"equation {number}" if number else "formula"
    scrolls = f' tabindex="0" role="group" aria-label="{name}"'  # where there is no room
    wide = scrolls if "<mtable" in formula or len(equation.tex) > WIDE else ""
    shown = f'<div class="formula"{wide}>{formula}</div>'
    code = equation.code
    if code is None:
        lines = "<p>No line cites it.</p>"
    else:
        changed = ' class="changed"' if code.changed else ""
        note = ", changed" if code.changed else ""
        lines = (
            f"<pre{changed}><code>{escape(code.text)}</code></pre>"
            f'<p class="where">{escape(code.file)}, line {code.line}{note}</p>'
        )
    return (
        f'<div class="equation"><div class="print"><p class="number">{number}</p>{shown}</div>'
        f'<div class="code">{lines}</div></div>\n'
    )


def mathml(tex: str) -> str:
    """A formula of the steps as MathML."""
    return _formulas()[tex]


@cache
def _formulas() -> dict[str, str]:
    formulas: dict[str, str] = json.loads(web_file("formulas.json"))
    return formulas


def prose_html(text: str) -> str:
    """Words with `code`; of links to the documentation only the words."""
    parts = []
    at = 0
    for found in _CODE_OR_LINK.finditer(text):
        code, words = found.groups()
        shown = f"<code>{escape(code)}</code>" if code else escape(words)
        parts += [escape(text[at : found.start()]), shown]
        at = found.end()
    return "".join([*parts, escape(text[at:])])
