"""Lines of numbers, with the line's number in every complaint."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from saccade.errors import LogError
from saccade.files import read_text
from saccade.types import FloatArray


def read_lines(path: Path) -> list[str]:
    """The lines of a text file.

    Raises:
        LogError: there is no such file, it cannot be read, or it is not text.
    """
    try:
        text = read_text(path)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise LogError(
            f"{path}: expected a text log, found a byte that is no text at {error.start}"
        ) from error
    return text.splitlines()


def fields(lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that is not empty and not a `#` comment."""
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            yield number, words


LARGEST = 1e100
"""Nothing that was measured is larger, and its square is still a number."""


def numbers(path: Path, line: int, words: list[str]) -> list[float]:
    """Words as numbers within `LARGEST`.

    Raises:
        LogError: one of them is no such number; names the file and the line.
    """
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != len(words) or not all(abs(value) < LARGEST for value in values):
        wrong = next(word for word in words if not _is_number(word))
        raise LogError(
            f"{path}, line {line}: expected a finite number under {LARGEST:g}, found {wrong!r}"
        )
    return values


def read_columns(path: Path, names: tuple[str, ...], stale: float = 0.0) -> FloatArray:
    """A table of numbers, one row a line, `#` lines left out.

    Args:
        path: the file.
        names: what the columns hold, for the messages; a first column called "time"
            must not go backwards.
        stale: see `in_order`.

    Returns:
        (n, len(names)) values.

    Raises:
        LogError: a line has another number of fields, holds what is not a finite
            number, or goes back in time; names the file and the line.
    """
    rows, number = [], []
    for line, words in fields(read_lines(path)):
        if len(words) != len(names):
            raise LogError(
                f"{path}, line {line}: expected {len(names)} numbers ({', '.join(names)}), "
                f"found {len(words)}: {' '.join(words)[:80]!r}"
            )
        rows.append(numbers(path, line, words))
        number.append(line)
    table = np.array(rows, np.float64).reshape(-1, len(names))
    if names[0] != "time":
        return table
    return in_order(table, stale, lambda row: f"{path}, line {number[row]}")


def in_order(table: FloatArray, stale: float, place: Callable[[int], str]) -> FloatArray:
    """A table whose first column is a time that must not go backwards.

    Args:
        table: (n, c).
        stale: seconds by which the first row may be later than the second; it is then left out.
        place: what to call a row in a message.

    Returns:
        The table, without a stale first row.

    Raises:
        LogError: the time goes back; names the row.
    """
    time = table[:, 0]
    skip = int(len(time) > 1 and 0 < time[0] - time[1] < stale)
    back = np.flatnonzero(np.diff(time[skip:]) < 0) + skip
    if len(back):
        here = int(back[0])
        raise LogError(
            f"{place(here + 1)}: time goes back from {time[here]:.3f} to {time[here + 1]:.3f} s; "
            "sort the log by time"
        )
    return table[skip:]


def _is_number(word: str) -> bool:
    try:
        return abs(float(word)) < LARGEST
    except ValueError:
        return False
