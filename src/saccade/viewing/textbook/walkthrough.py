"""Runs the textbook on an image or a log, and describes its steps."""

import inspect
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from saccade import textbook
from saccade.io.files import read_text
from saccade.types import Image, LandmarkLog
from saccade.viewing.page import data_uri, escape, html_page, picture_html, web_file
from saccade.viewing.textbook.ekf import filter_figures, filter_results, trace_filter
from saccade.viewing.textbook.equations import Code, equation_code
from saccade.viewing.textbook.images import (
    contrast_figures,
    contrast_results,
    sift_figures,
    sift_results,
)

ENTRY_POINTS: dict[str, Any] = {
    "A": textbook.contrast_saliency,
    "B": textbook.sift,
    "C": textbook.EkfSlam,
}
"""Function or class that implements each appendix."""
TITLES = {
    "A": "A. The contrast-saliency model",
    "B": "B. The Scale-Invariant Feature Transform",
    "C": "C. EKF-SLAM",
}
Figures = dict[str, Figure]
"""Figures by step."""
Results = dict[str, dict[str, str]]
"""Results by step and name."""
WIDE_TEX = 36
"""Maximum number of characters of TeX for a formula that fits a phone."""


@cache
def code_of(appendix: str) -> dict[str, Code]:
    """The code of each equation of an appendix by its number, and of each function by its name."""
    path = Path(inspect.getfile(ENTRY_POINTS[appendix]))
    return equation_code(read_text(path), path.name)


def walk_through(appendix: str, image: Image | None, log: LandmarkLog) -> tuple[str, Results]:
    """Run an appendix, and describe its steps.

    Args:
        appendix: "A", "B" or "C".
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.

    Returns:
        A section of the page, as HTML, and the results.

    Raises:
        LogError: the log has no landmark identities, or another motion model.
    """
    figures, results = run_appendix(appendix, image, log)
    text = f"Computed by `{inspect.getfile(ENTRY_POINTS[appendix])}`."
    if appendix == "C" and log.motion == "compose":
        text += (
            " The controls of this log translate before they turn: each becomes two, (d, φ) of the "
            "translation and of the remaining turn, without the lateral uncertainty."
        )
    parts = [f"<section>\n<h2>{TITLES[appendix]}</h2>\n<p>{_prose_html(text)}</p>"]
    parts += [
        _step_html(each, code_of(appendix), figures, results) for each in load_steps(appendix)
    ]
    return "\n".join([*parts, "</section>"]), results


def run_appendix(appendix: str, image: Image | None, log: LandmarkLog) -> tuple[Figures, Results]:
    """The figures and the results of the steps of an appendix; arguments as of `walk_through`."""
    if appendix == "C":
        trace = trace_filter(log, textbook.EkfSlam)
        return filter_figures(trace), filter_results(trace)
    assert image is not None
    if appendix == "A":
        saliency = textbook.contrast_saliency(image)
        return contrast_figures(image, saliency), contrast_results(saliency)
    points = textbook.sift(image)
    return sift_figures(image, points), sift_results(points)


def load_steps(appendix: str) -> list[dict[str, Any]]:
    """The steps of an appendix, in order, as `web/appendices.toml` describes them."""
    steps = tomllib.loads(web_file("appendices.toml"))["step"]
    return [step for step in steps if step["appendix"] == appendix]


def walkthrough_page(title: str, lead: str, sections: Sequence[str]) -> str:
    """The page as the text of one HTML file without scripts.

    Args:
        title: of the page.
        lead: its first paragraph.
        sections: HTML, one for each appendix.
    """
    return html_page(title, lead, "\n".join(sections), ["page.css", "steps.css"])


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


def equations_html(equations: Sequence[Sequence[str]], code: Mapping[str, Code]) -> str:
    """Number and formula on the left, the lines of code on the right.

    Args:
        equations: of one step: number, TeX and, where no comment cites the number, the function.
        code: of the textbook.
    """
    rows = (
        _equation_html(number, tex, code[key])
        for number, tex, *function in equations
        for key in (function or [number])
    )
    return f'<div class="equations">\n{"".join(rows)}</div>'


@cache
def mathml() -> dict[str, str]:
    """The formulas of the steps as MathML, by their TeX."""
    formulas: dict[str, str] = json.loads(web_file("formulas.json"))
    return formulas


def _step_html(
    step: Mapping[str, Any], code: Mapping[str, Code], figures: Figures, results: Results
) -> str:
    """Heading, text, equations beside code, figure, results and remark."""
    name = step["name"]
    parts = [
        f"<h3>{escape(step['title'])}</h3>\n<p>{_prose_html(step['text'])}</p>",
        equations_html(step["equations"], code),
    ]
    if name in figures:
        with BytesIO() as file:
            save_webp(figures[name], file)
            source = data_uri("webp", file.getvalue())
        parts.append(picture_html(source, step["alt"], step["caption"]))
    if name in results:
        rows = (f"<dt>{escape(n)}</dt><dd>{escape(each)}</dd>" for n, each in results[name].items())
        parts.append(f"<dl>{''.join(rows)}</dl>")
    if "default" in step:
        parts.append(f'<p class="default">{_prose_html(step["default"])}</p>')
    return "\n".join(parts)


def _equation_html(number: str, tex: str, code: Code) -> str:
    formula, number = mathml()[tex], escape(number)
    name = f"equation {number}" if number else "formula"
    scrollable = f' tabindex="0" role="group" aria-label="{name}"'
    wide = scrollable if "<mtable" in formula or len(tex) > WIDE_TEX else ""
    lines = (
        f"<pre><code>{escape(code.text)}</code></pre>"
        f'<p class="where">{escape(code.file)}, line {code.line}</p>'
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
