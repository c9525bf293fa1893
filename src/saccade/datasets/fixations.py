"""Recorded fixations: a CSV table, or the `.mat` file of the OSIE data set."""

from pathlib import Path

import numpy as np

from saccade.datasets.matlab import read_matlab
from saccade.datasets.tables import Row, read_rows
from saccade.errors import LogError
from saccade.types import FixationTable

COLUMNS = ("image", "viewer", "index", "x", "y")
DURATION = "duration_ms"
"""A column that a table may have besides."""
_Row = tuple[str, int, int, float, float, float]


def read_fixations(path: str | Path) -> FixationTable:
    """The fixations in a file.

    Args:
        path: a CSV with the columns image, viewer, index, x and y (pixels), and duration_ms where
            known (others are ignored), or `fixations.mat` of OSIE (Xu et al., Journal of Vision
            2014), whose durations are not read.

    Raises:
        LogError: the file is missing or broken; the message names the line.
    """
    path = Path(path)
    rows = _mat_rows(path) if path.suffix.lower() == ".mat" else _csv_rows(path)
    if not rows:
        raise LogError(f"{path}: expected at least one fixation, found none")
    image, viewer, index, x, y, duration = zip(*rows, strict=True)
    seconds = np.array(duration, np.float64) / 1000
    return FixationTable(
        np.array(image),
        np.array(viewer),
        np.array(index),
        np.array([x, y], np.float64).T,
        None if np.isnan(seconds).all() else seconds,
    )


def _csv_rows(path: Path) -> list[_Row]:
    rows = read_rows(path, delimiter=",", comment=None)
    names = next(rows, Row(path, 1, [])).cells
    for name in COLUMNS:
        if name not in names:
            raise LogError(f"{path}: expected the columns {', '.join(COLUMNS)}; {name} is missing")
    image, viewer, index, x, y = (names.index(name) for name in COLUMNS)
    fixations = []
    for row in rows:
        row.require_cells(len(names))
        (left,), (top,) = (row.numbers(slice(i, i + 1)) for i in (x, y))
        person, number = (row.integer(i, names[i]) for i in (viewer, index))
        duration = np.nan
        if DURATION in names:
            column = names.index(DURATION)
            duration = float(row.numbers(slice(column, column + 1))[0])
        fixations.append((row.cells[image], person, number, left, top, duration))
    return fixations


def _mat_rows(path: Path) -> list[_Row]:
    images = read_matlab(path, ("fixations",))["fixations"]
    try:
        return [
            (image["img"], viewer, index, float(x), float(y), np.nan)
            for image in images
            for viewer, eye in enumerate(image["subjects"])
            for index, (x, y) in enumerate(
                zip(eye["fix_x"].ravel(), eye["fix_y"].ravel(), strict=True)
            )
        ]
    except (TypeError, KeyError, IndexError, AttributeError, ValueError) as error:
        raise LogError(f"{path}: expected the fixations of OSIE, found another file") from error
