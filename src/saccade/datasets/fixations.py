"""Recorded fixations: a CSV table, or the `.mat` file of the OSIE data set."""

import csv
from io import StringIO
from pathlib import Path

import numpy as np

from saccade.datasets.matlab import read_matlab
from saccade.errors import LogError
from saccade.files import read_text
from saccade.types import FixationTable

COLUMNS = ("image", "viewer", "index", "x", "y")


def read_fixations(path: str | Path) -> FixationTable:
    """The fixations in a file.

    Args:
        path: a CSV with the columns image, viewer, index, x and y (pixels; others are ignored), or
            `fixations.mat` of OSIE (Xu et al., Journal of Vision 2014).

    Raises:
        LogError: the file is missing or broken; the message names the line.
    """
    path = Path(path)
    rows = _mat_rows(path) if path.suffix.lower() == ".mat" else _csv_rows(path)
    if not rows:
        raise LogError(f"{path}: expected at least one fixation, found none")
    image, viewer, index, x, y = zip(*rows, strict=True)
    return FixationTable(
        np.array(image), np.array(viewer), np.array(index), np.array([x, y], np.float64).T
    )


_Row = tuple[str, int, int, float, float]


def _csv_rows(path: Path) -> list[_Row]:
    rows = []
    try:
        with StringIO(read_text(path), newline="") as file:
            reader = csv.DictReader(file)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise LogError(
                    f"{path}: expected the columns {', '.join(COLUMNS)}; {missing[0]} is missing"
                )
            for row in reader:
                rows += [_row(row, f"{path}, line {reader.line_num}")]
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise LogError(f"{path}: expected a CSV table: {error}") from error
    return rows


def _row(row: dict[str, str], line: str) -> _Row:
    try:
        x, y = float(row["x"]), float(row["y"])
        fixation = row["image"], int(row["viewer"]), int(row["index"]), x, y
    except (TypeError, ValueError):
        raise LogError(f"{line}: expected numbers, found {row}") from None
    if not (np.isfinite(x) and np.isfinite(y)):
        raise LogError(f"{line}: expected finite places, found {row}")
    return fixation


def _mat_rows(path: Path) -> list[_Row]:
    held = read_matlab(path, ("fixations",))["fixations"]
    try:
        return [
            (image["img"], viewer, index, float(x), float(y))
            for image in held
            for viewer, eye in enumerate(image["subjects"])
            for index, (x, y) in enumerate(
                zip(eye["fix_x"].ravel(), eye["fix_y"].ravel(), strict=True)
            )
        ]
    except (TypeError, KeyError, IndexError, AttributeError, ValueError) as error:
        raise LogError(f"{path}: expected the fixations of OSIE, found another file") from error
