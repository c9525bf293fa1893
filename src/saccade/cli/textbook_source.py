"""The files of the textbook, those that stand in for them, and the code of each equation."""

import ast
import difflib
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING, Any

from saccade.errors import ConfigError, SaccadeError
from saccade.files import read_text, reason_of

if TYPE_CHECKING:
    from saccade.viewing.steps import Code

OFFERS = {
    "A": ("contrast_saliency", "contrast_saliency"),
    "B": ("sift", "sift"),
    "C": ("ekf_slam", "EkfSlam"),
}
"""Of each appendix: the module of the textbook, and what a file must define in its place."""
LONGEST = 24
"""Lines of a function that are shown."""
_CITED = re.compile(r"\b([ABC])\.(\d+)(?:\s*-\s*(?:\1\.)?(\d+))?")


@dataclass(frozen=True)
class Chapter:
    """A file of the textbook, or one that stands in for it."""

    appendix: str
    path: Path
    source: str
    offer: Any
    """`contrast_saliency`, `sift` or `EkfSlam` as the file defines it."""

    @classmethod
    def of_textbook(cls, appendix: str) -> "Chapter":
        """The file that stands beside an appendix: "A", "B" or "C"."""
        module, name = OFFERS[appendix]
        loaded = import_module(f"saccade.textbook.{module}")
        path = Path(str(loaded.__file__))
        return cls(appendix, path, read_text(path), getattr(loaded, name))

    @cached_property
    def code(self) -> "dict[str, Code]":
        """The lines that compute each equation by its number, and functions by their names."""
        return code_of(self.source, self.path.name)

    def changes(self, other: "Chapter") -> str:
        """How the file differs from another one, as a unified diff; empty where it does not."""
        names = (other.path.name, self.path.name)
        sources = (other.source.splitlines(), self.source.splitlines())
        return "\n".join(difflib.unified_diff(*sources, *names, lineterm="", n=1))


def chapters_of(path: Path) -> list[Chapter]:
    """What a Python file defines in place of the textbook.

    Raises:
        ConfigError: it cannot be read or run, or defines none of the names of the textbook.
    """
    try:
        source = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}") from error
    spec = spec_from_file_location(f"textbook_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path}: expected a Python file, whose name ends with .py")
    module = module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses look for their module there
    with blamed_on(path):
        spec.loader.exec_module(module)
    found = [
        Chapter(appendix, path, source, vars(module)[name])
        for appendix, (_, name) in OFFERS.items()
        if getattr(vars(module).get(name), "__module__", None) == module.__name__
    ]
    if not found:
        names = " or ".join(name for _, name in OFFERS.values())
        raise ConfigError(f"{path}: expected a definition of {names}, found none")
    return found


@contextmanager
def blamed_on(path: Path) -> Iterator[None]:
    """Say in one line what is wrong with a file of the user, and where, if anything is.

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
            if Path(trace.tb_frame.f_code.co_filename) == path:
                line = trace.tb_lineno
            trace = trace.tb_next
        where = f"{path}, line {line}" if line else f"{path}: what it returns cannot be shown"
        said = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
        raise ConfigError(f"{where}: {type(error).__name__}: {said}") from error


def code_of(source: str, name: str) -> "dict[str, Code]":
    """The lines of a source file that compute each equation, and its functions without their heads.

    A number is cited by a comment at the end of a statement, or by the docstring of a function.
    Where several places cite one, those that cite the fewest others are shown.

    Args:
        source: Python.
        name: of the file.
    """
    from saccade.viewing.steps import Code

    tree, lines = ast.parse(source), source.splitlines()
    code: dict[str, Code] = {}
    cited: dict[str, tuple[int, list[tuple[int, int]]]] = {}  # fewest others, and where
    places = list(_comments(tree, source))
    for function in (each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef)):
        numbers = _numbers(ast.get_docstring(function) or "")
        body = function.body[1:] if ast.get_docstring(function) else function.body
        if body:
            where = (body[0].lineno, body[-1].end_lineno or body[-1].lineno)
            places.append((numbers, where))
            code[function.name] = Code(name, where[0], _text(lines, where))
    for numbers, where in places:
        for number in numbers:
            fewest, found = cited.get(number, (len(numbers), []))
            if len(numbers) < fewest:
                fewest, found = len(numbers), []
            if len(numbers) == fewest and where not in found:
                cited[number] = fewest, [*found, where]
    for number, (_, found) in cited.items():
        text = "\n".join(_text(lines, where) for where in sorted(found))
        code[number] = Code(name, min(found)[0], text)
    return code


def _comments(tree: ast.Module, source: str) -> Iterator[tuple[list[str], tuple[int, int]]]:
    """The numbers that each comment cites, and first and last line of its statement."""
    statements = [each for each in ast.walk(tree) if isinstance(each, ast.stmt)]
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        numbers = _numbers(token.string) if token.type == tokenize.COMMENT else []
        line = token.start[0]
        around = [each for each in statements if each.lineno <= line <= (each.end_lineno or 0)]
        if numbers and around:
            inner = max(around, key=lambda each: each.lineno)
            compound = hasattr(inner, "body")
            where = (line, line) if compound else (inner.lineno, inner.end_lineno or line)
            yield numbers, where


def _numbers(text: str) -> list[str]:
    """The numbers of equations that a comment or docstring names; "A.7-A.10" are four."""
    found = []
    for appendix, first, last in _CITED.findall(text):
        found += [f"{appendix}.{number}" for number in range(int(first), int(last or first) + 1)]
    return found


def _text(lines: list[str], where: tuple[int, int]) -> str:
    """Lines of a source, moved to the left, without the comments that cite."""
    shown = [re.sub(r"\s+# [ABC]\.\d.*$", "", line) for line in lines[where[0] - 1 : where[1]]]
    if len(shown) > LONGEST:
        shown = [*shown[:LONGEST], "..."]
    return dedent("\n".join(shown)).strip()
