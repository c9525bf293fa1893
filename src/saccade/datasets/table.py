"""Columns of numbers as CSV or Parquet."""

import csv
from collections.abc import Mapping
from math import isnan
from pathlib import Path
from typing import Any

import numpy.typing as npt

from saccade.errors import require
from saccade.extras import import_optional
from saccade.files import atomic_write


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
