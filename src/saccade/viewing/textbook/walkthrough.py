"""Runs the textbook on an image or a log, and describes its steps."""

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from saccade import textbook
from saccade.io.files import read_text
from saccade.textbook.pop_out import pop_out_display, target_rank
from saccade.types import Float32Array, Image, LandmarkLog
from saccade.viewing.page import data_uri, escape, html_page, picture_html, web_file
from saccade.viewing.textbook.ekf import (
    FilterTrace,
    filter_figures,
    filter_results,
    trace_filter,
)
from saccade.viewing.textbook.equations import Code, equation_code
from saccade.viewing.textbook.images import (
    contrast_figures,
    contrast_results,
    sift_figures,
    sift_results,
)
from saccade.viewing.textbook.parameters import changed_source, load_module, parse_changes
from saccade.viewing.textbook.pop_out import pop_out_figure
from saccade.viewing.textbook.values import chooser_html

FILES = {"A": "contrast_saliency.py", "B": "sift.py", "C": "ekf_slam.py"}
"""File that implements each appendix."""
SYSTEMS = {"A": "contrast", "B": "sift"}
"""Systems with parameters, by appendix."""
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
WIDE_CODE = 40
"""Maximum number of characters of a line of code that fits a phone."""
HYPHENATED = re.compile(rf"(?<!\S)(?=\S*-\S)\S{{2,{WIDE_CODE}}}(?!\S)")
"""Token after whose hyphen a browser would break the line."""


@dataclass(frozen=True)
class Walkthrough:
    """The data for the appendices, and the changed parameters.

    Raises:
        ConfigError: unknown parameter, or a value outside its range.
    """

    log: LandmarkLog
    """Log with landmark labels, for appendix C."""
    image: Image | None = None
    """(H, W, 3) in [0, 1], for appendices A and B."""
    default_saliency: Callable[[Image], Float32Array] | None = None
    """Saliency of the default model, for comparison."""
    last_scan: int | None = None
    """Last scan shown, from 1; by default the eighth."""
    changes: Sequence[str] = ()
    """Changed parameters such as "contrast.delta=2,3"."""

    @cached_property
    def sources(self) -> dict[str, str]:
        """The source of each appendix, with the changed parameters."""
        folder, changes = Path(textbook.__file__).parent, parse_changes(self.changes)
        sources = {key: read_text(folder / name) for key, name in FILES.items()}
        for key, system in SYSTEMS.items():
            sources[key] = changed_source(sources[key], system, changes[system])
        return sources

    @cached_property
    def trace(self) -> FilterTrace:
        """The steps of the filter in the log.

        Raises:
            LogError: the log has no landmark labels, or fewer scans.
        """
        return trace_filter(self.log, textbook.EkfSlam, self.last_scan)

    def code(self, appendix: str) -> dict[str, Code]:
        """The code of each equation by its number, and of each function by its name."""
        return equation_code(self.sources[appendix], FILES[appendix])

    def run(self, appendix: str) -> tuple[Figures, Results]:
        """The figures and the results of the steps of an appendix."""
        if appendix == "C":
            return filter_figures(self.trace), filter_results(self.trace)
        assert self.image is not None
        module: Any = load_module(self.sources[appendix], FILES[appendix])
        if appendix == "B":
            points = module.sift(self.image)
            return sift_figures(self.image, points), sift_results(points)
        saliency = module.contrast_saliency(self.image)
        figures, results = contrast_figures(self.image, saliency), contrast_results(saliency)
        if self.default_saliency is not None:
            display, centers, target = pop_out_display(0)
            printed, default = module.contrast_saliency(display), self.default_saliency(display)
            figures["pop-out"] = pop_out_figure(display, printed, default)
            maps = {"as printed": printed.saliency, "by the default": default}
            results["pop-out"] = {
                f"rank of the red bar, {name}": f"{target_rank(each, centers, target)}"
                for name, each in maps.items()
            }
        return figures, results

    def section(self, appendix: str) -> tuple[str, Results]:
        """A section of the page, as HTML, and the results.

        Raises:
            LogError: as `trace`.
        """
        figures, results = self.run(appendix)
        text = f"Computed by `saccade/textbook/{FILES[appendix]}`"
        system = SYSTEMS.get(appendix)
        changes = [each for each in self.changes if each.partition(".")[0] == system]
        text += f", with `{'`, `'.join(changes)}`." if changes else "."
        if appendix == "C" and self.log.motion != "turn_then_translate":
            text += (
                " The controls of this log translate before they turn: each becomes two, (d, φ) of "
                "the translation and of the remaining turn, without the lateral uncertainty."
            )
        code = self.code(appendix)
        heading = f'<h2 id="{appendix}">{TITLES[appendix]}</h2>'
        parts = [f"<section>\n{heading}\n<p>{_prose_html(text)}</p>"]
        values = dict[str, str]()
        if appendix == "C":
            steps, drawn = self.trace.steps, self.trace.drawn
            values = {name: chooser_html(name, steps[name], drawn[name]) for name in drawn}
        parts += [_step_html(each, code, figures, results, values) for each in load_steps(appendix)]
        return "\n".join([*parts, "</section>"]), results


def load_steps(appendix: str) -> list[dict[str, Any]]:
    """The steps of an appendix, in order, as `web/appendices.toml` describes them."""
    steps = tomllib.loads(web_file("appendices.toml"))["step"]
    return [step for step in steps if step["appendix"] == appendix]


def walkthrough_page(title: str, lead: str, sections: Mapping[str, str]) -> str:
    """The page as the text of one HTML file, with a list of its contents.

    Args:
        title: of the page.
        lead: its first paragraph.
        sections: HTML by appendix.
    """
    body = "\n".join([_contents_html(sections), *sections.values()])
    return html_page(title, lead, body, ["page.css", "steps.css"], ["steps.js"])


def _contents_html(appendices: Iterable[str]) -> str:
    """Links to the appendices and their steps."""
    lists = (
        f'<li><a href="#{each}">{TITLES[each]}</a><ol>'
        + "".join(
            f'<li><a href="#{each}-{step["name"]}">{escape(step["title"])}</a></li>'
            for step in load_steps(each)
        )
        + "</ol></li>"
        for each in appendices
    )
    return f'<nav class="contents" aria-label="Contents"><ul>{"".join(lists)}</ul></nav>'


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


def code_html(text: str) -> str:
    """Code whose lines break between tokens only.

    Args:
        text: escaped as HTML.
    """
    unbroken = HYPHENATED.sub('<span class="unbroken">\\g<0></span>', text)
    return f"<code>{unbroken}</code>"


@cache
def mathml() -> dict[str, str]:
    """The formulas of the steps as MathML, by their TeX."""
    formulas: dict[str, str] = json.loads(web_file("formulas.json"))
    return formulas


def _step_html(
    step: Mapping[str, Any],
    code: Mapping[str, Code],
    figures: Figures,
    results: Results,
    values: Mapping[str, str],
) -> str:
    """Heading, text, equations beside code, figure, matrices, results and remark."""
    name = step["name"]
    heading = f'<h3 id="{step["appendix"]}-{name}">{escape(step["title"])}</h3>'
    parts = [f"{heading}\n<p>{_prose_html(step['text'])}</p>"]
    if step["equations"]:
        parts.append(equations_html(step["equations"], code))
    if name in figures:
        with BytesIO() as file:
            save_webp(figures[name], file)
            source = data_uri("webp", file.getvalue())
        parts.append(picture_html(source, step["alt"], step["caption"]))
    parts += [values[name]] if name in values else []
    if name in results:
        rows = (f"<dt>{escape(n)}</dt><dd>{escape(each)}</dd>" for n, each in results[name].items())
        parts.append(f"<dl>{''.join(rows)}</dl>")
    if "default" in step:
        parts.append(f'<p class="default">{_prose_html(step["default"])}</p>')
    return "\n".join(parts)


def _equation_html(number: str, tex: str, code: Code) -> str:
    formula, number = mathml()[tex], escape(number)
    name = f"equation {number}" if number else "formula"
    scrollable = ' tabindex="0" role="group" aria-label="{}"'.format
    wide = scrollable(name) if "<mtable" in formula or len(tex) > WIDE_TEX else ""
    is_long = max(map(len, code.text.splitlines())) > WIDE_CODE
    long = scrollable(f"code of {name}") if is_long else ""
    lines = (
        f"<pre{long}>{code_html(escape(code.text))}</pre>"
        f'<p class="where">{escape(code.file)}, line {code.line}</p>'
    )
    return (
        f'<div class="equation"><div class="print"><p class="number">{number}</p>'
        f'<div class="formula"{wide}>{formula}</div></div><div class="code">{lines}</div></div>\n'
    )


def _prose_html(text: str) -> str:
    """Text with `code`; links become plain text, and links in parentheses are left out."""
    text = re.sub(r" \(\[[^\]]+\]\([^)]+\)\)", "", text)
    link = re.compile(r"\[([^\]]+)\]\([^)]+\)")
    return "".join(
        code_html(escape(part)) if i % 2 else escape(link.sub(r"\1", part))
        for i, part in enumerate(text.split("`"))
    )
