"""Runs an implementation of an appendix, the textbook's or the user's, on data."""

import difflib
import inspect
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from saccade import textbook
from saccade.errors import ConfigError, SaccadeError
from saccade.io.files import read_text, reason_of
from saccade.types import Image, LandmarkLog
from saccade.viewing.textbook.contrast import contrast_figures, contrast_results
from saccade.viewing.textbook.ekf import filter_figures, filter_results, trace_filter
from saccade.viewing.textbook.equation_code import Code, equation_code
from saccade.viewing.textbook.sift import sift_figures, sift_results

ENTRY_POINTS = {"A": "contrast_saliency", "B": "sift", "C": "EkfSlam"}
"""By appendix: the function or class that implements it."""
Figures = dict[str, Figure]
"""By step."""
Results = dict[str, dict[str, str]]
"""By step and name."""


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

    def diff(self, other: "Implementation") -> str:
        """Unified diff from another file to this one; empty where they are equal."""
        names = (other.path.name, self.path.name)
        sources = (other.source.splitlines(), self.source.splitlines())
        return "\n".join(difflib.unified_diff(*sources, *names, lineterm="", n=1))


@dataclass(frozen=True)
class Walkthrough:
    """The result of one appendix, run on data."""

    implementation: Implementation
    text: str
    """Which file computed it."""
    diff: str
    """How that file differs from the textbook's; empty for the textbook's own."""
    figures: Figures
    results: Results


def load_implementations(path: Path) -> list[Implementation]:
    """The entry points of the textbook that a Python file defines.

    Raises:
        ConfigError: it cannot be read or run, or defines no entry point.
    """
    try:
        source = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}") from error
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
) -> Walkthrough:
    """Run an implementation, and compare its results with the textbook's.

    Args:
        implementation: of one appendix.
        image: (H, W, 3) in [0, 1]; not needed for appendix C.
        log: for appendix C.

    Raises:
        ConfigError: a file of the user failed.
        LogError: the log has no landmark identities, or another motion model.
    """
    textbook, path = Implementation.of_textbook(implementation.appendix), implementation.path
    if path == textbook.path:
        figures, results = run_appendix(implementation, image, log)
        text = (
            f"Computed by `{path}`. To try an equation of your own, copy this file, change it, "
            f"and pass the copy as `--module`: its `{implementation.name}` then replaces this one."
        )
        diff = ""
    else:
        with _errors_located_in(path):
            figures, results = run_appendix(implementation, image, log)
        _, expected = run_appendix(textbook, image, log, draw=False)
        for step, values in results.items():
            for name, value in values.items():
                if value != (usual := expected.get(step, {}).get(name)):
                    values[name] = f"{value} (textbook: {usual})"
        text = f"Computed by `{path}` in place of the textbook. Its lines that differ:"
        diff = implementation.diff(textbook) or "none"
    if implementation.appendix == "C" and log.motion == "compose":
        text += (
            " The controls of this log translate before they turn: each becomes two, (d, φ) of the "
            "translation and of the remaining turn, without the lateral uncertainty."
        )
    return Walkthrough(implementation, text, diff, figures, results)


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
        line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else None
        trace = error.__traceback__
        while trace is not None:
            if Path(trace.tb_frame.f_code.co_filename) == path.resolve():
                line = trace.tb_lineno
            trace = trace.tb_next
        location = f"{path}, line {line}" if line else f"{path}: its result cannot be shown"
        message = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
        raise ConfigError(f"{location}: {type(error).__name__}: {message}") from error
