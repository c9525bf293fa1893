"""The code of each equation of a Python file, found by the comments that cite equations."""

import ast
import re
from collections.abc import Iterable, Iterator, Sequence
from textwrap import dedent
from typing import NamedTuple

MAX_LINES = 24
"""Maximum number of lines shown of a function."""
_EQUATION_NUMBER = re.compile(r"\b([ABC])\.(\d+)(?:\s*-\s*(?:\1\.)?(\d+))?")
_CITATION = re.compile(r"\s*#[ ]([ABC]\.\d[ABC.\d, -]*).*$")


class Code(NamedTuple):
    """The lines of a source file that compute an equation."""

    file: str
    line: int
    """Number of the first line that cites it, from 1."""
    text: str


def equation_code(source: str, file: str) -> dict[str, Code]:
    """The code of each equation by number, and the body of each function by name.

    Equations are cited in comments at the ends of lines. The code of an equation consists of the
    statements that cite it with the fewest other equations, and of the uncited assignments of their
    variables.

    Args:
        source: Python.
        file: its name.
    """
    tree, lines = ast.parse(source), source.splitlines()
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    code = {each.name: Code(file, _body(each)[0], _text(lines, _body(each))) for each in functions}
    citing: dict[str, list[tuple[int, ast.stmt]]] = {}  # by equation: citations, statement
    for numbers, statement in _citations(tree, lines):
        for number in numbers:
            citing.setdefault(number, []).append((len(numbers), statement))
    cited = [statement for pairs in citing.values() for _, statement in pairs]
    for number, pairs in citing.items():
        fewest = min(count for count, _ in pairs)
        statements = [statement for count, statement in pairs if count == fewest]
        shown = {
            line
            for statement in statements
            for each in (statement, *_assignments(statement, functions, cited))
            for line in _head(each)
        }
        code[number] = Code(file, statements[0].lineno, _text(lines, sorted(shown)))
    return code


def _citations(tree: ast.Module, lines: Sequence[str]) -> Iterator[tuple[list[str], ast.stmt]]:
    """The equations cited at the end of each line, and the innermost statement on that line."""
    statements = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    for line, text in enumerate(lines, start=1):
        citation = _CITATION.search(text)
        around = [each for each in statements if citation and line in _lines(each)]
        if citation and around:
            numbers = [
                f"{appendix}.{number}"
                for appendix, first, last in _EQUATION_NUMBER.findall(citation[1])
                for number in range(int(first), int(last or first) + 1)  # "A.7-A.10" are four
            ]
            yield numbers, max(around, key=lambda each: each.lineno)


def _assignments(
    statement: ast.stmt, functions: Iterable[ast.FunctionDef], cited: Sequence[ast.stmt]
) -> list[ast.stmt]:
    """Earlier assignments of the same function whose variables the statement all uses."""
    around = [each for each in functions if statement.lineno in _lines(each)]
    if not around:
        return []
    head = statement.test if isinstance(statement, ast.If) else statement
    used = {node.id for node in ast.walk(head) if isinstance(node, ast.Name)}
    return [
        node
        for node in ast.walk(max(around, key=lambda each: each.lineno))
        if isinstance(node, ast.Assign) and node.lineno < statement.lineno and node not in cited
        if (names := _assigned(node.targets)) and names <= used
    ]


def _assigned(targets: Sequence[ast.expr]) -> set[str]:
    """The variables that an assignment sets, wholly or in part."""
    parts = [part for each in targets for part in getattr(each, "elts", [each])]
    owners = [part.value if isinstance(part, ast.Subscript) else part for part in parts]
    return {each.id for each in owners if isinstance(each, ast.Name)}


def _lines(node: ast.stmt) -> range:
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


def _head(statement: ast.stmt) -> range:
    """The lines of a statement without the statements inside it."""
    body = getattr(statement, "body", None)
    return range(statement.lineno, body[0].lineno) if body else _lines(statement)


def _body(function: ast.FunctionDef) -> range:
    """The lines of a function after its docstring."""
    documented = ast.get_docstring(function) is not None and len(function.body) > 1
    return range(function.body[documented].lineno, _lines(function).stop)


def _text(lines: Sequence[str], numbers: Sequence[int]) -> str:
    """Lines of a source without indentation and without the comments that cite."""
    shown = [_CITATION.sub("", lines[number - 1]) for number in numbers]
    if len(shown) > MAX_LINES:
        shown = [*shown[:MAX_LINES], "..."]
    return dedent("\n".join(shown)).strip()
