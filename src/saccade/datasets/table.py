"""Columns of numbers as CSV or Parquet."""

import csv
from collections.abc import Mapping
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import require
from saccade.extras import import_optional
from saccade.files import atomic_write
from saccade.types import FloatArray


def write_table(path: str | Path, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write columns under their names; the suffix of the file says how.

    Args:
        path: .csv, where every digit is kept and NaN is an empty cell; or .parquet, where NaN
            is null.
        columns: by name, each (n,) of numbers.

    Raises:
        ConfigError: another suffix, or Parquet without pyarrow.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    kinds = (".csv", ".parquet")
    require(path.suffix in kinds, "path", f"a file that ends in {' or '.join(kinds)}", str(path))
    if path.suffix == ".csv":
        _write_csv(path, columns)
        return
    arrow, parquet = (
        import_optional("pyarrow", "parquet"),
        import_optional("pyarrow.parquet", "parquet"),
    )
    table = arrow.table({name: arrow.array(c, from_pandas=True) for name, c in columns.items()})
    with atomic_write(path) as temporary, temporary.open("wb") as file:  # Arrow's paths are text
        parquet.write_table(table, file)


def symmetric_columns(names: tuple[str, ...], matrices: FloatArray) -> dict[str, FloatArray]:
    """The upper triangles of covariances (n, d, d) as columns: "cov_x_x", "cov_x_y", ..."""
    rows, others = np.triu_indices(len(names))
    return {
        f"cov_{names[i]}_{names[j]}": matrices[:, i, j]
        for i, j in zip(rows.tolist(), others.tolist(), strict=True)
    }


def _write_csv(path: Path, columns: Mapping[str, npt.NDArray[Any]]) -> None:
    cells = [
        ["" if isinstance(value, float) and isnan(value) else value for value in column.tolist()]
        for column in columns.values()
    ]
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*cells, strict=True))
