"""The files of the textbook, those that stand in for them, and the code of each equation."""

import ast
import difflib
import io
import re
import sys
import tokenize
from collections.abc import Iterator, Sequence
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
_CITING = re.compile(r"#[ ]([ABC]\.\d[ABC.\d, -]*).*$")


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
    spec = spec_from_file_location(f"textbook_{path.stem}", path.resolve())
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
            if Path(trace.tb_frame.f_code.co_filename) == path.resolve():
                line = trace.tb_lineno
            trace = trace.tb_next
        where = f"{path}, line {line}" if line else f"{path}: what it returns cannot be shown"
        said = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
        raise ConfigError(f"{where}: {type(error).__name__}: {said}") from error


def code_of(source: str, name: str) -> "dict[str, Code]":
    """The lines of a source file that compute each equation, and its functions without their heads.

    A number is cited by the comment at the end of a line. Where several lines cite one, those are
    shown that cite the fewest others; with each comes what it uses, if no number is cited there.

    Args:
        source: Python.
        name: of the file.
    """
    from saccade.viewing.steps import Code

    tree, lines = ast.parse(source), source.splitlines()
    code = {
        each.name: Code(name, _first(each), _text(lines, range(_first(each), _last(each) + 1)))
        for each in ast.walk(tree)
        if isinstance(each, ast.FunctionDef)
    }
    cited: dict[str, list[tuple[int, ast.stmt]]] = {}  # how many numbers, and the statement
    for numbers, statement in _citations(tree, source):
        for number in numbers:
            cited.setdefault(number, []).append((len(numbers), statement))
    taken = [statement for found in cited.values() for _, statement in found]
    for number, found in cited.items():
        fewest = min(count for count, _ in found)
        statements = [statement for count, statement in found if count == fewest]
        shown: set[int] = set()
        for statement in statements:
            for each in (statement, *_used_by(statement, tree, taken)):
                shown |= set(range(each.lineno, _head_end(each) + 1))
        code[number] = Code(name, statements[0].lineno, _text(lines, sorted(shown)))
    return code


def _citations(tree: ast.Module, source: str) -> Iterator[tuple[list[str], ast.stmt]]:
    """The numbers that each comment begins with, and the statement it stands at the end of."""
    statements = [each for each in ast.walk(tree) if isinstance(each, ast.stmt)]
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and (cited := _CITING.match(token.string)):
            line = token.start[0]
            around = [each for each in statements if each.lineno <= line <= _last(each)]
            if around:
                yield _numbers(cited[0]), max(around, key=lambda each: each.lineno)


def _used_by(statement: ast.stmt, tree: ast.Module, cited: list[ast.stmt]) -> list[ast.stmt]:
    """Assignments earlier in the same function to nothing but what the statement uses."""
    functions = [each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef)]
    inside = [each for each in functions if each.lineno <= statement.lineno <= _last(each)]
    if not inside:
        return []
    head = statement.test if isinstance(statement, ast.If) else statement
    used = {each.id for each in ast.walk(head) if isinstance(each, ast.Name)}
    found: list[ast.stmt] = []
    for each in ast.walk(max(inside, key=lambda each: each.lineno)):
        if isinstance(each, ast.Assign) and each.lineno < statement.lineno and each not in cited:
            names = {name for target in each.targets for name in _assigned(target)}
            if names and names <= used:
                found.append(each)
    return found


def _assigned(target: ast.expr) -> Iterator[str]:
    """The names of the variables that an assignment sets, or sets a part of."""
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Subscript):
        yield from _assigned(target.value)
    elif isinstance(target, ast.Tuple):
        for element in target.elts:
            yield from _assigned(element)


def _first(function: ast.FunctionDef) -> int:
    """Line of the first statement behind the docstring."""
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (body or function.body)[0].lineno


def _last(statement: ast.stmt) -> int:
    return statement.end_lineno or statement.lineno


def _head_end(statement: ast.stmt) -> int:
    """Last line of a statement, without the statements in it."""
    body = getattr(statement, "body", None)
    return body[0].lineno - 1 if body else _last(statement)


def _numbers(text: str) -> list[str]:
    """The numbers of equations in a text; "A.7-A.10" are four."""
    return [
        f"{appendix}.{number}"
        for appendix, first, last in _CITED.findall(text)
        for number in range(int(first), int(last or first) + 1)
    ]


def _text(lines: list[str], numbers: Sequence[int]) -> str:
    """Lines of a source, moved to the left, without the comments that cite."""
    shown = [re.sub(rf"\s+{_CITING.pattern}", "", lines[number - 1]) for number in numbers]
    if len(shown) > LONGEST:
        shown = [*shown[:LONGEST], "..."]
    return dedent("\n".join(shown)).strip()
