"""Landmark maps as CSV: surveyed maps, and `landmarks.csv` of a run."""

import warnings
from pathlib import Path

import numpy as np

from saccade.datasets.tables import Row, TextTable, from_upper_triangle, read_csv
from saccade.errors import LogError, LogWarning
from saccade.landmark_names import number_names, parse_name
from saccade.types import FloatArray, LandmarkMap

SURVEY_SIGMA = 0.01
"""Standard deviation of a position without a covariance, in meters."""
_LABELS = ("label", "id", "name", "landmark")
_COVARIANCE = ("cov_xx", "cov_xy", "cov_yy")


def load_map(path: str | Path) -> LandmarkMap:
    """Reads a map of landmarks, for `slam.Slam(map=...)`.

    Args:
        path: a CSV with the columns x and y in meters; optionally label (or id, name, landmark),
            with empty cells for landmarks without a label; and optionally cov_xx, cov_xy, cov_yy in
            square meters (default: a standard deviation of 1 cm, with a `LogWarning`). Other
            columns are ignored, so that `landmarks.csv` of `saccade slam` can be read.

    Returns:
        The map; `id` is -1 for landmarks without a label.

    Raises:
        LogError: the file is missing or broken, or two landmarks have the same label.
    """
    path = Path(path)
    table = read_csv(path, _check_header)
    if not table.rows:
        raise LogError(f"{path}: expected landmarks, found none")
    labels = [_label(row, table) for row in table.rows]
    known = [label for label in labels if label not in ("", -1)]
    for i, label in enumerate(labels):
        if label in known and label in labels[:i]:
            raise table.rows[i].error("a unique label for each landmark", f"{label!r} again")
    numbers, texts = number_names(np.array(labels, object), name=f"{path}: label")
    xy = table.numbers("x", "y")
    return LandmarkMap(id=numbers, xy=xy, covariance=_covariances(table), text_names=texts)


def _check_header(header: Row) -> None:
    for name in ("x", "y"):
        if header.cells.count(name) != 1:
            columns = ", ".join(("label", "x", "y", *_COVARIANCE))
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


def _covariances(table: TextTable) -> FloatArray:
    """Covariances (n, 2, 2), from `SURVEY_SIGMA` for landmarks without a covariance."""
    covariance = np.tile(SURVEY_SIGMA**2 * np.eye(2), (len(table.rows), 1, 1))
    given = np.zeros(len(table.rows), bool)
    if {"cov_xx", "cov_yy"} <= set(table.names):
        given = table.is_filled(("cov_xx", "cov_yy"))
        names = [name for name in _COVARIANCE if name in table.names]
        entries = np.zeros((int(given.sum()), 3))
        entries[:, [_COVARIANCE.index(name) for name in names]] = table.select(
            np.flatnonzero(given)
        ).numbers(*names, blank=0.0)
        covariance[given] = from_upper_triangle(entries)
        invalid = given & ~(np.linalg.eigvalsh(covariance)[:, 0] > 0)
        for i in np.flatnonzero(invalid)[:1].tolist():
            raise table.rows[i].error("a positive definite covariance", str(covariance[i].tolist()))
    if not given.all():
        warnings.warn(
            f"{table.header.path}: {int((~given).sum())} landmarks without covariance: assumed a "
            f"standard deviation of {SURVEY_SIGMA:g} m; add columns {', '.join(_COVARIANCE)} for "
            "the true ones",
            LogWarning,
            stacklevel=3,
        )
    return covariance
