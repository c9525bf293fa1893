"""Maps of landmarks: surveys, and `landmarks.csv` of a run.

csv         columns x and y in meters, optionally a label and a covariance; see `read_csv_map`
wpilib      field layout of WPILib (.json): tags with ID and pose.translation
freiburg    text of Freiburg's course on robot mapping: label x y
"""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from saccade.datasets.formats import AUTO, Format, find_reader, first_lines
from saccade.datasets.tables import (
    Row,
    TextTable,
    from_upper_triangle,
    is_number,
    read_csv,
    read_rows,
)
from saccade.errors import LogError, LogWarning
from saccade.io.files import read_text, reading
from saccade.landmark_names import number_names, parse_name
from saccade.types import FloatArray, LandmarkMap

SURVEY_SIGMA = 0.01
"""Standard deviation of a position without a covariance, in meters."""
_LABELS = ("label", "id", "name", "landmark")
_COVARIANCES = (("cov_xx", "cov_xy", "cov_yy"), ("c00", "c01", "c11"))
"""Names of the columns of covariances."""


def read_csv_map(path: Path) -> LandmarkMap:
    """A map of a CSV; see `load_map`."""
    table = read_csv(path, _check_header)
    labels = [_label(row, table) for row in table.rows]
    covariance, given = _covariances(table)
    return _make_map(path, labels, table.numbers("x", "y"), covariance, given, table.rows)


def read_wpilib_map(path: Path) -> LandmarkMap:
    """The tags of a field layout; their heights and rotations are left out."""
    expected = "a field layout with tags: ID, pose.translation"
    with reading(path, LogError, expected, ValueError, KeyError, TypeError):
        tags = json.loads(read_text(path))["tags"]
        labels: list[int | str] = [int(tag["ID"]) for tag in tags]
        places = [tag["pose"]["translation"] for tag in tags]
        xy = np.array([(float(each["x"]), float(each["y"])) for each in places]).reshape(-1, 2)
    if not np.isfinite(xy).all():
        raise LogError(f"{path}: expected finite positions, found {xy[~np.isfinite(xy)][0]}")
    return _make_map(path, labels, xy)


def read_freiburg_map(path: Path) -> LandmarkMap:
    """The landmarks of a text file with lines `label x y`."""
    rows = [row.require_cells(3, "words (label, x, y)") for row in read_rows(path)]
    labels = []
    for row in rows:
        label = parse_name(row.cells[0])
        if label is None:
            raise row.error("a label (text, or an integer from 0 on)", repr(row.cells[0][:40]))
        labels.append(label)
    xy = np.array([row.numbers(slice(1, 3)) for row in rows]).reshape(-1, 2)
    return _make_map(path, labels, xy, rows=rows)


def _is_freiburg_map(path: Path) -> bool:
    lines = [line.split() for line in first_lines(path) if line.strip()]
    return bool(lines) and all(len(w) == 3 and is_number(w[1]) and is_number(w[2]) for w in lines)


MAP_FORMATS = {
    "csv": Format(
        read_csv_map,
        suffixes=(".csv",),
        recognizes=lambda path: "," in "".join(first_lines(path, 1)),
    ),
    "wpilib": Format(
        read_wpilib_map,
        suffixes=(".json",),
        recognizes=lambda path: "".join(first_lines(path, 1)).startswith("{"),
    ),
    "freiburg": Format(read_freiburg_map, recognizes=_is_freiburg_map),
}
"""Formats of maps of landmarks by name."""
MapKind: TypeAlias = str | Callable[..., LandmarkMap]
"""A format: a name in `MAP_FORMATS`, "auto", module:function, or a function of the path."""


def load_map(path: str | Path, kind: MapKind = AUTO) -> LandmarkMap:
    """Reads a map of landmarks, for `slam.Slam(map=...)`.

    Args:
        path: a CSV with the columns x and y in meters; optionally label (or id, name, landmark),
            with empty cells for landmarks without a label; and optionally cov_xx, cov_xy, cov_yy
            (or c00, c01, c11) in square meters (default: a standard deviation of 1 cm, with a
            `LogWarning`). Other columns are ignored, so that `landmarks.csv` of `saccade slam` can
            be read. Or a file in another format of `MAP_FORMATS`.
        kind: the format; see `MapKind`.

    Returns:
        The map; `id` is -1 for landmarks without a label.

    Raises:
        LogError: the file is missing or broken, or two landmarks have the same label.
        ConfigError: unknown kind.
    """
    path = Path(path)
    _, reader = find_reader(kind, path, MAP_FORMATS, "a map of landmarks", LogError)
    found: LandmarkMap = reader(path)
    return found


def _make_map(
    path: Path,
    labels: list[int | str],
    xy: FloatArray,
    covariance: FloatArray | None = None,
    given: Any = None,
    rows: list[Row] | None = None,
) -> LandmarkMap:
    """A map with unique labels, and `SURVEY_SIGMA` where no covariance is given."""
    if not labels:
        raise LogError(f"{path}: expected landmarks, found none")
    known = [label for label in labels if label not in ("", -1)]
    for i, label in enumerate(labels):
        if label in known and label in labels[:i]:
            expected, found = "a unique label for each landmark", f"{label!r} again"
            if rows is not None:
                raise rows[i].error(expected, found)
            raise LogError(f"{path}: expected {expected}, found {found}")
    numbers, texts = number_names(np.array(labels, object), name=f"{path}: label")
    if covariance is None:
        covariance, given = _survey_covariance(len(labels)), np.zeros(len(labels), bool)
    if not given.all():
        warnings.warn(
            f"{path}: {int((~given).sum())} landmarks without covariance: assumed a standard "
            f"deviation of {SURVEY_SIGMA:g} m; a CSV with the columns "
            f"{', '.join(_COVARIANCES[0])} has the true ones",
            LogWarning,
            stacklevel=5,
        )
    return LandmarkMap(id=numbers, xy=xy, covariance=covariance, text_names=texts)


def _survey_covariance(count: int) -> FloatArray:
    return np.tile(SURVEY_SIGMA**2 * np.eye(2), (count, 1, 1))


def _check_header(header: Row) -> None:
    for name in ("x", "y"):
        if header.cells.count(name) != 1:
            columns = ", ".join(("label", "x", "y", *_COVARIANCES[0]))
            raise header.error(f"the columns {columns}, at least x and y", f"no {name}")


def _label(row: Row, table: TextTable) -> int | str:
    """The label of a landmark, -1 for none."""
    columns = [table.names.index(name) for name in _LABELS if name in table.names]
    if not columns:
        return -1
    cell = row.cells[columns[0]]
    label = parse_name(cell)
    if label is None:
        raise row.error("a label (text, or an integer from 0 on)", repr(cell[:40]))
    return label


def _covariances(table: TextTable) -> tuple[FloatArray, Any]:
    """Covariances (n, 2, 2), and True (n,) for landmarks that have one in the table."""
    covariance = _survey_covariance(len(table.rows))
    given = np.zeros(len(table.rows), bool)
    columns = next((c for c in _COVARIANCES if {c[0], c[2]} <= set(table.names)), None)
    if columns is None:
        return covariance, given
    given = table.is_filled((columns[0], columns[2]))
    names = [name for name in columns if name in table.names]
    entries = np.zeros((int(given.sum()), 3))
    entries[:, [columns.index(name) for name in names]] = table.select(
        np.flatnonzero(given)
    ).numbers(*names, blank=0.0)
    covariance[given] = from_upper_triangle(entries)
    invalid = given & ~(np.linalg.eigvalsh(covariance)[:, 0] > 0)
    for i in np.flatnonzero(invalid)[:1].tolist():
        raise table.rows[i].error("a positive definite covariance", str(covariance[i].tolist()))
    return covariance, given
