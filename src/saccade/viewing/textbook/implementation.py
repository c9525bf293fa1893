"""Implementations of the appendices: the files of the textbook, or files of the user."""

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

from saccade import textbook
from saccade.errors import ConfigError, SaccadeError
from saccade.files import read_text, reason_of
from saccade.viewing.textbook.equation_code import Code, equation_code

ENTRY_POINTS = {"A": "contrast_saliency", "B": "sift", "C": "EkfSlam"}
"""By appendix: the function or class that implements it."""


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
    with errors_located_in(path):
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


@contextmanager
def errors_located_in(path: Path) -> Iterator[None]:
    """Turns any error of a user's file into one line that names the file and its line.

    Raises:
        ConfigError: anything but a `SaccadeError` was raised.
    """
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
