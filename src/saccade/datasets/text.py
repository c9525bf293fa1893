"""Tables in text files, parsed with the file and the line in every error."""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from saccade.errors import LogError
from saccade.files import read_text
from saccade.types import FloatArray

LARGEST = 1e100
"""Bound on every number read: no measurement is larger, and its square is still finite."""


@dataclass(frozen=True)
class Row:
    """One row of a table in a text file."""

    path: Path
    """The file."""
    line: int
    """Line number in the file, from 1."""
    cells: list[str]
    """Contents of the cells, without surrounding blanks."""

    def error(self, expected: str, found: str) -> LogError:
        """The error to raise for this row."""
        return LogError(f"{self.path}, line {self.line}: expected {expected}, found {found}")

    def numbers(self, columns: slice = slice(None), blank: float | None = None) -> list[float]:
        """Cells as finite numbers within `LARGEST`.

        Args:
            columns: the cells.
            blank: value of an empty cell; None where a cell must not be empty.

        Raises:
            LogError: a cell is no such number.
        """
        values = []
        for cell in self.cells[columns]:
            if not cell and blank is not None:
                values.append(blank)
                continue
            try:
                value = float(cell)
            except ValueError:
                value = np.inf
            if not abs(value) < LARGEST:
                raise self.error(f"a finite number under {LARGEST:g}", repr(cell))
            values.append(value)
        return values

    def integer(self, column: int, name: str, below: int = 10**18) -> int:
        """A cell as a non-negative integer.

        Args:
            column: index of the cell.
            name: what the integer is, for the message.
            below: exclusive upper bound; the default leaves room in 64 bits.

        Raises:
            LogError: the cell is no such integer.
        """
        cell = self.cells[column]
        digits = cell.isascii() and cell.isdecimal() and len(cell) < 20
        if not digits or int(cell) >= below:
            raise self.error(f"{name} (an integer under {below:.3g})", repr(cell[:40]))
        return int(cell)

    def require_cells(self, count: int, names: str = "cells") -> "Row":
        """The row itself, if it has `count` cells.

        Raises:
            LogError: it has more or fewer; `names` is in the message.
        """
        if len(self.cells) != count:
            raise self.error(
                f"{count} {names}", f"{len(self.cells)}: {' '.join(self.cells)[:80]!r}"
            )
        return self


def read_rows(path: Path, delimiter: str | None = None, comment: str | None = "#") -> Iterator[Row]:
    """The rows of a text file that are neither empty nor a comment.

    Args:
        path: the file.
        delimiter: between cells, with CSV's quotes; None for any white space.
        comment: how a line that is skipped begins; None where every line counts.

    Raises:
        LogError: the file is missing, cannot be read, is not text, or has broken quotes.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise LogError(
            f"{path}: expected text, found a byte at {error.start} that is not UTF-8"
        ) from error
    for line, cells in _split(path, text, delimiter):
        if any(cells) and not (comment and cells[0].startswith(comment)):
            yield Row(path, line, cells)


def _split(path: Path, text: str, delimiter: str | None) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line."""
    if delimiter is None:
        yield from ((number, line.split()) for number, line in enumerate(text.splitlines(), 1))
        return
    reader = csv.reader(StringIO(text, newline=""), delimiter=delimiter)
    try:
        for cells in reader:
            yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise LogError(f"{path}, line {reader.line_num}: expected CSV cells: {error}") from error


def read_table(path: Path, columns: tuple[str, ...], stale_limit: float = 0.0) -> FloatArray:
    """A table of numbers, separated by white space.

    Args:
        path: the file.
        columns: names for the messages; a first column "time" must not go backwards.
        stale_limit: see `require_ascending`.

    Returns:
        (n, len(columns)) values.

    Raises:
        LogError: a line has another number of fields, a field is no finite number, or the time
            goes backwards; names the file and the line.
    """
    names = f"numbers ({', '.join(columns)})"
    rows = [row.require_cells(len(columns), names) for row in read_rows(path)]
    table = np.array([row.numbers() for row in rows], np.float64).reshape(-1, len(columns))
    if columns[0] != "time":
        return table
    return require_ascending(table, lambda i: f"{path}, line {rows[i].line}", stale_limit)


def require_ascending(
    table: FloatArray, name_of: Callable[[int], str], stale_limit: float = 0.0
) -> FloatArray:
    """Check that the time in the first column does not go backwards.

    Args:
        table: (n, c).
        name_of: name of a row, for the message.
        stale_limit: seconds by which the first row may be later than the second; such a row is
            stale and dropped.

    Returns:
        The table, without a stale first row.

    Raises:
        LogError: the time goes backwards; names the row.
    """
    time = table[:, 0]
    skip = int(len(time) > 1 and 0 < time[0] - time[1] < stale_limit)
    backwards = np.flatnonzero(np.diff(time[skip:]) < 0) + skip
    if len(backwards):
        i = int(backwards[0])
        raise LogError(
            f"{name_of(i + 1)}: time goes back from {time[i]:.3f} to {time[i + 1]:.3f} s; "
            "sort the log by time"
        )
    return table[skip:]
