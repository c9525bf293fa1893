"""Runs an implementation of an appendix, the textbook's or the user's, and describes its steps."""

import difflib
import inspect
import json
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import module_from_spec, spec_from_file_location
from io import BytesIO
from pathlib import Path
from traceback import walk_tb
from typing import Any

from matplotlib.figure import Figure

from saccade import textbook
from saccade.errors import ConfigError, SaccadeError
from saccade.io.files import read_text, reading
from saccade.types import Image, LandmarkLog
from saccade.viewing.page import Picture, data_uri, escape, html_page, web_file
from saccade.viewing.textbook.ekf import filter_figures, filter_results, trace_filter
from saccade.viewing.textbook.equations import Code, equation_code
from saccade.viewing.textbook.images import (
    contrast_figures,
    contrast_results,
    sift_figures,
    sift_results,
)

ENTRY_POINTS = {"A": "contrast_saliency", "B": "sift", "C": "EkfSlam"}
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


@dataclass(frozen=True)
class Implementation:
    """A Python file that implements an appendix."""

    appendix: str
    """ "A", "B" or "C"."""
    path: Path
    source: str
    entry_point: Any
    """`contrast_saliency`, `sift` or `EkfSlam` as the file defines it."""

    @classmethod
    @cache
    def of_textbook(cls, appendix: str) -> "Implementation":
        """The file of `saccade.textbook` that implements an appendix."""
        entry_point = getattr(textbook, ENTRY_POINTS[appendix])
        path = Path(inspect.getfile(entry_point))
        return cls(appendix, path, read_text(path), entry_point)

    @property
    def name(self) -> str:
        """Name of the entry point."""
        return ENTRY_POINTS[self.appendix]

    @cached_property
    def code(self) -> dict[str, Code]:
        """The code of each equation by its number, and of each function by its name."""
        return equation_code(self.source, self.path.name)


def load_implementations(path: Path) -> list[Implementation]:
    """The entry points of the textbook that a Python file defines.

    Raises:
        ConfigError: it cannot be read or run, or defines no entry point.
    """
    with reading(path, ConfigError):
        source = read_text(path)
    spec = spec_from_file_location(f"textbook_{path.stem}", path.resolve())
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path}: expected a Python file, whose name ends with .py")
    module = module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses look for their module there
    with _errors_located_in(path):
        spec.loader.exec_module(module)
    implementations = [
        Implementation(appendix, path, source, vars(module)[name])
        for appendix, name in ENTRY_POINTS.items()
        if getattr(vars(module).get(name), "__module__", None) == module.__name__
    ]
    if not implementations:
        names = " or ".join(ENTRY_POINTS.values())
        raise ConfigError(f"{path}: expected a definition of {names}, found none")
    return implementations


def walk_through(
    implementation: Implementation, image: Image | None, log: LandmarkLog
) -> tuple[str, Results]:
    """Run an implementation, and compare its results with the textbook's.

    Args:
        implementation: of one appendix.
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.

    Returns:
        A section of the page, as HTML, and the results.

    Raises:
        ConfigError: a file of the user failed.
        LogError: the log has no landmark identities, or another motion model.
    """
    appendix, path, name = implementation.appendix, implementation.path, implementation.name
    textbook, diff = Implementation.of_textbook(appendix), ""
    if path == textbook.path:
        figures, results = run_appendix(implementation, image, log)
        text = (
            f"Computed by `{path}`. To try an equation of your own, copy this file, change it, "
            f"and pass the copy as `--module`: its `{name}` then replaces this one."
        )
    else:
        with _errors_located_in(path):
            figures, results = run_appendix(implementation, image, log)
        _, expected = run_appendix(textbook, image, log, draw=False)
        for step, values in results.items():
            for key, value in values.items():
                if value != (usual := expected.get(step, {}).get(key)):
                    values[key] = f"{value} (textbook: {usual})"
        text = f"Computed by `{path}` in place of the textbook. Its lines that differ:"
        sources = (textbook.source.splitlines(), implementation.source.splitlines())
        names = (textbook.path.name, path.name)
        diff = "\n".join(difflib.unified_diff(*sources, *names, lineterm="", n=1)) or "none"
    if appendix == "C" and log.motion == "compose":
        text += (
            " The controls of this log translate before they turn: each becomes two, (d, φ) of the "
            "translation and of the remaining turn, without the lateral uncertainty."
        )
    parts = [f"<section>\n<h2>{TITLES[appendix]}</h2>\n<p>{_prose_html(text)}</p>"]
    if diff:
        parts.append(f'<pre class="changed"><code>{escape(diff)}</code></pre>')
    parts += [_step_html(each, implementation, figures, results) for each in load_steps(appendix)]
    return "\n".join([*parts, "</section>"]), results


def run_appendix(
    implementation: Implementation, image: Image | None, log: LandmarkLog, *, draw: bool = True
) -> tuple[Figures, Results]:
    """The figures and the results of the steps of an appendix.

    Args:
        implementation: of one appendix.
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.
        draw: whether to make the figures.
    """
    if implementation.appendix == "C":
        trace = trace_filter(log, implementation.entry_point)
        return filter_figures(trace) if draw else {}, filter_results(trace)
    assert image is not None
    result = implementation.entry_point(image)
    if implementation.appendix == "A":
        return contrast_figures(image, result) if draw else {}, contrast_results(result)
    return sift_figures(image, result) if draw else {}, sift_results(result)


@contextmanager
def _errors_located_in(path: Path) -> Iterator[None]:
    """Turns any error of a user's file into a `ConfigError` that names the file and its line."""
    try:
        yield
    except SaccadeError:
        raise
    except (Exception, SystemExit) as error:
        line, message = None, str(error)
        if isinstance(error, SyntaxError):
            line, message = error.lineno, error.msg
        for frame, number in walk_tb(error.__traceback__):
            if Path(frame.f_code.co_filename) == path.resolve():
                line = number
        location = f"{path}, line {line}" if line else f"{path}: its result cannot be shown"
        message = " ".join(message.split())
        raise ConfigError(f"{location}: {type(error).__name__}: {message}") from error


WIDE_TEX = 36
"""Maximum number of characters of TeX for a formula that fits a phone."""


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


def equations_html(
    equations: Sequence[Sequence[str]], code: Mapping[str, Code], textbook: Mapping[str, Code]
) -> str:
    """Number and formula on the left, the lines of code on the right.

    Args:
        equations: of one step: number, TeX and, where no comment cites the number, the function.
        code: of the implementation.
        textbook: code of the textbook; lines that differ from it are marked.
    """
    rows = (
        _equation_html(number, tex, code.get(key), textbook.get(key))
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
    step: Mapping[str, Any], implementation: Implementation, figures: Figures, results: Results
) -> str:
    """Heading, text, equations beside code, figure, results and remark."""
    code, name = Implementation.of_textbook(implementation.appendix).code, step["name"]
    parts = [
        f"<h3>{escape(step['title'])}</h3>\n<p>{_prose_html(step['text'])}</p>",
        equations_html(step["equations"], implementation.code, code),
    ]
    if name in figures:
        with BytesIO() as file:
            save_webp(figures[name], file)
            source = data_uri("webp", file.getvalue())
        parts.append(Picture(source, step["alt"], step["caption"]).html)
    if name in results:
        rows = (f"<dt>{escape(n)}</dt><dd>{escape(each)}</dd>" for n, each in results[name].items())
        parts.append(f"<dl>{''.join(rows)}</dl>")
    if "default" in step:
        parts.append(f'<p class="default">{_prose_html(step["default"])}</p>')
    return "\n".join(parts)


def _equation_html(number: str, tex: str, code: Code | None, textbook: Code | None) -> str:
    formula, number = mathml()[tex], escape(number)
    name = f"equation {number}" if number else "formula"
    scrollable = f' tabindex="0" role="group" aria-label="{name}"'
    wide = scrollable if "<mtable" in formula or len(tex) > WIDE_TEX else ""
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
