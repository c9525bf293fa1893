"""Tables of numbers: reads text and .npz with checks; writes CSV and TUM."""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import StringIO
from itertools import combinations_with_replacement
from math import isnan, isqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError, require
from saccade.extras import import_optional
from saccade.io.files import atomic_write, read_text, reading
from saccade.io.npz import read_arrays
from saccade.types import BoolArray, FloatArray, LandmarkMap, Trajectory

LARGEST = 1e100
"""Maximum magnitude of numbers read; the square is still finite."""
MAX_DURATION = 1e6
"""Maximum duration of a log in seconds; longer logs have a corrupt time stamp."""
MAX_SHOWN = 40
"""Maximum number of characters of a cell in a message."""
DETECTED = "detected"
"""Delimiter detected from the first line: tab, semicolon or comma."""


@dataclass(frozen=True)
class Row:
    """One row of a table in a text file."""

    path: Path
    line: int
    """Line number in the file, from 1."""
    cells: list[str]
    """Contents of the cells, stripped of white space."""

    @property
    def name(self) -> str:
        """File and line, for messages."""
        return f"{self.path}, line {self.line}"

    def error(self, expected: str, found: str) -> LogError:
        """The error to raise for this row."""
        return LogError(f"{self.name}: expected {expected}, found {found}")

    def numbers(self, columns: slice = slice(None), blank: float | None = None) -> list[float]:
        """Cells as numbers below `LARGEST`; `blank`, if given, replaces empty cells."""
        values = []
        for cell in self.cells[columns]:
            if not cell and blank is not None:
                values.append(blank)
                continue
            value = plain_number(cell)
            if not abs(value) < LARGEST:
                comma = ", with a decimal comma" * (cell.count(",") == 1)
                raise self.error(
                    f"a finite number under {LARGEST:g}", f"{cell[:MAX_SHOWN]!r}{comma}"
                )
            values.append(value)
        return values

    def integer(self, column: int, name: str, below: int = 10**18) -> int:
        """A cell as a nonnegative integer less than `below`, called `name` in messages."""
        cell = self.cells[column]
        digits = cell.isascii() and cell.isdecimal() and len(cell) < 20
        if not digits or int(cell) >= below:
            raise self.error(f"{name} (an integer under {below:.3g})", repr(cell[:40]))
        return int(cell)

    def require_cells(self, count: int, names: str = "cells") -> "Row":
        """Returns the row if it has `count` cells, or else raises."""
        if len(self.cells) != count:
            raise self.error(
                f"{count} {names}", f"{len(self.cells)}: {' '.join(self.cells)[:80]!r}"
            )
        return self


def one_of(*headers: tuple[str, ...]) -> Callable[[Row], None]:
    """Header check for `read_csv` that raises `LogError` for other headers."""

    def check(header: Row) -> None:
        if tuple(header.cells) not in headers:
            known = " or ".join(",".join(each[:3]) for each in headers)
            raise header.error(f"the header {known},...", repr(",".join(header.cells)[:80]))

    return check


def plain_number(text: str) -> float:
    """A number in ASCII digits without separators; infinite for other text.

    Python's own conversion also accepts 4_8 and digits of other scripts.
    """
    if not text.isascii() or "_" in text:
        return np.inf
    try:
        return float(text)
    except ValueError:
        return np.inf


def is_number(text: str) -> bool:
    """Whether a text represents a finite number."""
    return bool(np.isfinite(plain_number(text)))


def read_rows(path: Path, delimiter: str | None = None, comment: str | None = "#") -> Iterator[Row]:
    """The rows of a text file that are neither empty nor a comment.

    Args:
        path: the file.
        delimiter: delimiter of cells, with CSV quoting; `DETECTED`; or None for white space.
        comment: prefix of comment lines; None if there are no comments.
    """
    with reading(path, LogError):
        text = read_text(path)
    for line, cells in _split(path, text, delimiter):
        if any(cells) and not (comment and cells[0].startswith(comment)):
            yield Row(path, line, cells)


def _split(path: Path, text: str, delimiter: str | None) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line."""
    if delimiter is None:
        yield from enumerate(map(str.split, text.splitlines()), 1)
        return
    if delimiter == DETECTED:
        first = next((line for line in text.splitlines() if line.strip()), "")
        delimiter = max("\t;,", key=first.count)
    reader = csv.reader(StringIO(text, newline=""), delimiter=delimiter)
    try:
        for cells in reader:
            yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise LogError(f"{path}, line {reader.line_num}: expected CSV cells: {error}") from error


class TextTable(NamedTuple):
    """A table with a header in a text file."""

    header: Row
    rows: list[Row]

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return self.header.cells

    def is_filled(self, names: Iterable[str]) -> BoolArray:
        """(n,) True for rows with a nonempty cell in the given columns."""
        columns = [self.names.index(name) for name in names]
        return np.array([any(row.cells[c] for c in columns) for row in self.rows], bool)

    def select(self, rows: Iterable[int]) -> "TextTable":
        """The table restricted to the given row indices."""
        return self._replace(rows=[self.rows[i] for i in rows])

    def numbers(self, *names: str, blank: float | None = None) -> FloatArray:
        """Columns as numbers (n, len(names)); `blank`, if given, replaces empty cells."""
        columns = [self.names.index(name) for name in names]
        cells = [row.numbers(slice(c, c + 1), blank)[0] for row in self.rows for c in columns]
        return np.array(cells, np.float64).reshape(len(self.rows), len(names))


def read_csv(
    path: Path,
    check_header: Callable[[Row], None] | None = None,
    delimiter: str = ",",
    comment: str | None = "#",
) -> TextTable:
    """A table with a header; see `read_rows`."""
    rows = read_rows(path, delimiter, comment)
    header = next(rows, Row(path, 1, []))
    if check_header is not None:
        check_header(header)
    return TextTable(header, [row.require_cells(len(header.cells)) for row in rows])


def read_table(path: Path, columns: tuple[str, ...], stale_limit: float = 0.0) -> FloatArray:
    """A table of numbers, separated by white space.

    Args:
        path: the file.
        columns: names for the messages; a first column "time" must be ascending.
        stale_limit: see `require_ascending`.

    Returns:
        (n, len(columns)) values.
    """
    names = f"numbers ({', '.join(columns)})"
    rows = [row.require_cells(len(columns), names) for row in read_rows(path)]
    table = np.array([row.numbers() for row in rows], np.float64).reshape(-1, len(columns))
    if columns[0] == "time":
        table = require_ascending(table, lambda i: rows[i].name, stale_limit)
    return table


def require_ascending(
    table: FloatArray, name_of: Callable[[int], str], stale_limit: float = 0.0
) -> FloatArray:
    """Checks that the first column of a table (n, c), the time in seconds, is ascending.

    A first row that is later than the second by less than `stale_limit` seconds is dropped.
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


class Archive:
    """The arrays of an .npz, each checked when it is requested."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with reading(path, LogError, "an .npz of tables", ValueError):
            self.arrays = read_arrays(path)

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def array(
        self, name: str, shape: tuple[int | None, ...] | None = None, kinds: str = "iuf"
    ) -> npt.NDArray[Any]:
        """Reads and checks an array.

        Args:
            name: name of the array.
            shape: expected lengths, each None for any; None for any shape.
            kinds: codes of the accepted types: i, u, f.
        """
        lengths = ", ".join("n" if n is None else str(n) for n in shape or ())
        expected = f"{self.path}, {name}: expected numbers" + f" of shape ({lengths})" * bool(shape)
        if name not in self.arrays:
            found = ", ".join(sorted(self.arrays)) or "nothing"
            raise LogError(f"{expected}, found only {found[:80]}")
        values = self.arrays[name]
        fits = shape is None or (
            values.ndim == len(shape)
            and all(n in (None, m) for n, m in zip(shape, values.shape, strict=True))
        )
        if values.dtype.kind not in kinds or not fits:
            raise LogError(f"{expected}, found {values.dtype} of shape {values.shape}")
        finite = np.atleast_1d(np.abs(values.astype(np.float64)) < LARGEST)
        if not finite.all():
            row = int(np.argwhere(~finite)[0, 0])
            found = np.atleast_1d(values)[row].tolist()
            raise LogError(
                f"{self.path}, {name}, row {row}: expected finite numbers, found {found}"
            )
        return values

    def table(self, name: str, columns: tuple[str, ...], stale_limit: float = 0.0) -> FloatArray:
        """The array as a table (n, len(columns)); see `read_table`."""
        table = np.asarray(self.array(name, (None, len(columns))), np.float64)
        if columns[0] == "time":
            table = require_ascending(table, lambda i: f"{self.path}, {name}, row {i}", stale_limit)
        return table


def write_table(
    path: str | Path, columns: Mapping[str, npt.NDArray[Any]], comment: str = ""
) -> None:
    """Write named columns; the suffix of the file selects the format.

    Args:
        path: .csv, with every digit and NaN as an empty cell; or .parquet, with NaN as null.
        columns: numeric columns (n,) by name.
        comment: text for a comment line "# ..." at the end of a .csv: its first line is the header.

    Raises:
        ConfigError: unknown suffix, or Parquet without pyarrow.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    known = path.suffix in (".csv", ".parquet")
    require(known, "path", "a file that ends in .csv or .parquet", str(path))
    if path.suffix == ".parquet":
        arrow = import_optional("pyarrow", "parquet")
        parquet = import_optional("pyarrow.parquet", "parquet")
        table = arrow.table({name: arrow.array(c, from_pandas=True) for name, c in columns.items()})
        with atomic_write(path) as temporary, temporary.open("wb") as file:  # for non-text paths
            parquet.write_table(table, file)
        return
    cells = [
        ["" if isinstance(value, float) and isnan(value) else value for value in column.tolist()]
        for column in columns.values()
    ]
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))
        file.write(f"# {comment}\n" * bool(comment))


def covariance_names(names: tuple[str, ...]) -> list[str]:
    """Column names of the upper triangle of a covariance: "cov_x_x", "cov_x_y", ..."""
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]


def symmetric_columns(names: tuple[str, ...], matrices: FloatArray) -> dict[str, FloatArray]:
    """The upper triangles of covariances (n, d, d) as columns (n,) by `covariance_names`."""
    return dict(zip(covariance_names(names), upper_triangle(matrices).T, strict=True))


def upper_triangle(matrices: FloatArray) -> FloatArray:
    """(n, d (d + 1) / 2) entries of symmetric matrices (n, d, d)."""
    return np.asarray(matrices[:, *np.triu_indices(matrices.shape[1])])


def from_upper_triangle(entries: FloatArray) -> FloatArray:
    """(n, d, d) symmetric matrices from their entries (n, d (d + 1) / 2)."""
    d = (isqrt(8 * entries.shape[1] + 1) - 1) // 2
    rows, columns = np.triu_indices(d)
    matrices = np.zeros((len(entries), d, d))
    matrices[:, rows, columns] = matrices[:, columns, rows] = entries
    return matrices


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write lines of `time x y z qx qy qz qw`; poses lie in the plane z = 0.

    Args:
        path: the file; replaced if it exists.
        trajectory: poses with headings; covariances are not part of the format.

    Raises:
        OutputError: the file cannot be written.
    """
    x, y, theta = trajectory.pose.T
    zero = np.zeros(len(trajectory))
    rows = np.stack(
        [trajectory.time, x, y, zero, zero, zero, np.sin(theta / 2), np.cos(theta / 2)], 1
    )
    with atomic_write(path) as temporary:
        np.savetxt(temporary, rows, fmt="%.9f")


def write_landmarks(path: str | Path, landmarks: LandmarkMap) -> None:
    """Write one row per landmark: id, x, y, cov_xx, cov_xy, cov_yy, observations.

    Meters and square meters; "observations" is their number. Cells are empty if the covariance
    or the count is unknown.

    Args:
        path: the file; replaced if it exists.
        landmarks: the map.

    Raises:
        OutputError: the file cannot be written.
    """
    covariance, observations = landmarks.covariance, landmarks.observations
    if covariance is None:
        covariance = np.full((len(landmarks), 2, 2), np.nan)
    columns = {"id": landmarks.names, "x": landmarks.xy[:, 0], "y": landmarks.xy[:, 1]}
    columns |= zip(("cov_xx", "cov_xy", "cov_yy"), upper_triangle(covariance).T, strict=True)
    columns["observations"] = (
        np.full(len(landmarks), np.nan) if observations is None else observations
    )
    write_table(path, columns)
