"""Fixations: a CSV table, or a `.mat` file in the layout of the OSIE data set."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.datasets.matlab import read_matlab
from saccade.datasets.tables import Row, read_rows, write_table
from saccade.errors import LogError, require
from saccade.files import atomic_write
from saccade.types import FixationTable

COLUMNS = ("image", "viewer", "index", "x", "y")
DURATION = "duration_ms"
"""A column that a table may have besides."""
_Row = tuple[str, int, int, float, float, float]
_Cells = npt.NDArray[np.object_]


def read_fixations(path: str | Path) -> FixationTable:
    """The fixations in a file.

    Args:
        path: a CSV with the columns image, viewer, index, x and y (pixels), and duration_ms, with
            empty cells where unknown (others are ignored); or a .mat in the layout of OSIE's
            `fixations.mat` (Xu et al., Journal of Vision 2014).

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
            if row.cells[column].strip():
                duration = float(row.numbers(slice(column, column + 1))[0])
        fixations.append((row.cells[image], person, number, left, top, duration))
    return fixations


def _mat_rows(path: Path) -> list[_Row]:
    images = read_matlab(path, ("fixations",))["fixations"]
    try:
        return [
            (image["img"], viewer, index, float(x), float(y), float(milliseconds))
            for image in images
            for place, eye in enumerate(image["subjects"])
            for viewer in [int(eye.get("viewer", np.array(place)).item())]
            for index, (x, y, milliseconds) in enumerate(
                zip(eye["fix_x"].ravel(), eye["fix_y"].ravel(), _durations(eye), strict=True)
            )
        ]
    except (TypeError, KeyError, IndexError, AttributeError, ValueError) as error:
        raise LogError(f"{path}: expected the fixations of OSIE, found another file") from error


def _durations(eye: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """The durations of a viewer's fixations in milliseconds, NaN where the file has none."""
    if "fix_duration" not in eye:
        return np.full(eye["fix_x"].size, np.nan)
    return eye["fix_duration"].ravel()


def write_fixations(path: str | Path, table: FixationTable, **columns: npt.NDArray[Any]) -> None:
    """Write fixations as `read_fixations` reads them.

    Args:
        path: .csv, a row for each fixation: image, viewer, index, x, y, duration_ms (empty where
            unknown) and further columns; or .mat, in OSIE's layout: a cell array `fixations` with
            `img` and a cell array `subjects` for each image, and `viewer`, `fix_x`, `fix_y`,
            `fix_duration` (ms) and further fields `fix_NAME` for each viewer. Written whole or
            not at all; an old file is replaced.
        table: fixations, of each viewer in their order.
        columns: (n,) further numbers, by name.

    Raises:
        ConfigError: another suffix.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    require(path.suffix in (".csv", ".mat"), "path", "a .csv or .mat", str(path))
    x, y = table.xy.T
    unknown = np.full(len(table), np.nan)
    milliseconds = unknown if table.duration is None else 1000 * table.duration
    if path.suffix == ".csv":
        keys = {"image": table.image, "viewer": table.viewer, "index": table.index}
        write_table(path, keys | {"x": x, "y": y, DURATION: milliseconds} | columns)
        return
    from scipy.io import savemat  # slow to import

    cells = _osie_cells(table, {"x": x, "y": y, "duration": milliseconds} | columns)
    with atomic_write(path) as temporary:
        savemat(temporary, {"fixations": cells}, do_compression=True, oned_as="column")


def _osie_cells(table: FixationTable, fields: Mapping[str, npt.NDArray[Any]]) -> _Cells:
    """The images with their viewers, in the layout of OSIE."""
    images = []
    for name in np.unique(table.image):
        own = np.flatnonzero(table.image == name)
        viewers = []
        for viewer in np.unique(table.viewer[own]):
            rows = own[table.viewer[own] == viewer]
            numbers = {f"fix_{key}": values[rows] for key, values in fields.items()}
            viewers.append({"viewer": viewer, **numbers})
        images.append({"img": str(name), "subjects": _cells(viewers)})
    return _cells(images)


def _cells(structs: Sequence[Mapping[str, Any]]) -> _Cells:
    """A cell array of structs."""
    cells = np.empty(len(structs), object)
    cells[:] = structs
    return cells
