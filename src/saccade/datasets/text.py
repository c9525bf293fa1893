"""Lines of numbers, with the line's number in every complaint."""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path

import numpy as np

from saccade.errors import LogError
from saccade.types import FloatArray


def read_lines(path: Path) -> list[str]:
    """The lines of a text file.

    Raises:
        LogError: there is no such file, it cannot be read, or it is not text.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise LogError(
            f"{path}: expected a text log, found a byte that is no text at {error.start}"
        ) from error
    return text.splitlines()


def fields(path: Path, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that is not empty and not a `#` comment."""
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            yield number, words


def numbers(path: Path, line: int, words: list[str]) -> list[float]:
    """Words as finite numbers.

    Raises:
        LogError: one of them is not a finite number; names the file and the line.
    """
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != len(words) or not all(isfinite(value) for value in values):
        wrong = next(word for word in words if not _is_finite_number(word))
        raise LogError(f"{path}, line {line}: expected a finite number, found {wrong!r}")
    return values


def read_columns(path: Path, names: tuple[str, ...]) -> FloatArray:
    """A table of numbers, one row a line, `#` lines left out.

    Args:
        path: the file.
        names: what the columns hold, for the messages; a first column called "time"
            must not go backwards.

    Returns:
        (n, len(names)) values.

    Raises:
        LogError: a line has another number of fields, holds what is not a finite
            number, or goes back in time; names the file and the line.
    """
    rows, number = [], []
    for line, words in fields(path, read_lines(path)):
        if len(words) != len(names):
            raise LogError(
                f"{path}, line {line}: expected {len(names)} numbers ({', '.join(names)}), "
                f"found {len(words)}: {' '.join(words)[:80]!r}"
            )
        rows.append(numbers(path, line, words))
        number.append(line)
    table = np.array(rows, np.float64).reshape(-1, len(names))
    if names[0] == "time":
        back = np.flatnonzero(np.diff(table[:, 0]) < 0)
        if len(back):
            here = int(back[0])
            raise LogError(
                f"{path}, line {number[here + 1]}: time goes back from {table[here, 0]:.3f} "
                f"to {table[here + 1, 0]:.3f} s; sort the file by time"
            )
    return table


def _is_finite_number(word: str) -> bool:
    try:
        return isfinite(float(word))
    except ValueError:
        return False
