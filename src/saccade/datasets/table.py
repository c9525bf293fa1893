"""Columns of numbers as CSV or Parquet, covariances by the entries of their upper triangle."""

import csv
from collections.abc import Mapping
from itertools import combinations_with_replacement
from math import isnan, isqrt
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.extras import import_optional
from saccade.files import atomic_write
from saccade.types import FloatArray


def write_table(path: str | Path, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write named columns; the suffix of the file selects the format.

    Args:
        path: .csv, with every digit and NaN as an empty cell; or .parquet, with NaN as null.
        columns: by name, each (n,) of numbers.

    Raises:
        ConfigError: another suffix, or Parquet without pyarrow.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    suffixes = (".csv", ".parquet")
    require(
        path.suffix in suffixes, "path", f"a file that ends in {' or '.join(suffixes)}", str(path)
    )
    if path.suffix == ".csv":
        _write_csv(path, columns)
        return
    arrow = import_optional("pyarrow", "parquet")
    parquet = import_optional("pyarrow.parquet", "parquet")
    table = arrow.table({name: arrow.array(c, from_pandas=True) for name, c in columns.items()})
    with atomic_write(path) as temporary, temporary.open("wb") as file:  # Arrow's paths are text
        parquet.write_table(table, file)


def _write_csv(path: Path, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    cells = [
        ["" if isinstance(value, float) and isnan(value) else value for value in column.tolist()]
        for column in columns.values()
    ]
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))


def covariance_names(names: tuple[str, ...]) -> list[str]:
    """Column names of a covariance: "cov_x_x", "cov_x_y", ..."""
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]


def symmetric_columns(names: tuple[str, ...], matrices: FloatArray) -> dict[str, FloatArray]:
    """The upper triangles of covariances (n, d, d) as columns: "cov_x_x", "cov_x_y", ..."""
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
