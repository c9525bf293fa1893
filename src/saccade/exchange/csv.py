"""CSV, one image to a file: all fields but the descriptors."""

import csv
from io import StringIO
from pathlib import Path

import numpy as np

from saccade.errors import KeypointsError
from saccade.exchange.fields import COLUMNS, checked, columns_of, keypoints_from_columns, reading
from saccade.io.files import atomic_write, read_text
from saccade.types import Keypoints


def write_csv(path: str | Path, keypoints: Keypoints) -> None:
    """Write the points of an image: x, y, size, angle, response, octave.

    Numbers are as short as they can be and still be read back as the same float32.

    Args:
        path: written whole or not at all; an old file is replaced.
        keypoints: their descriptors are left out.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        OutputError: the file cannot be written.
    """
    columns = columns_of(checked(str(path), keypoints))
    with (
        atomic_write(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.astype(str) for values in columns.values()), strict=True))


def read_csv(path: str | Path) -> Keypoints:
    """Read what `write_csv` writes; columns may be in any order, and others are left alone.

    Raises:
        KeypointsError: the file is missing, lacks a column, or a cell is no number.
    """
    path = Path(path)
    with (
        reading(path, "CSV text", UnicodeDecodeError, csv.Error),
        StringIO(read_text(path), newline="") as file,
    ):
        reader = csv.DictReader(file)
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise KeypointsError(f"{path}: expected a column {missing[0]}, found none")
        lines = [(reader.line_num, row) for row in reader]
    columns = {name: np.empty(len(lines)) for name in COLUMNS}
    for number, (line, row) in enumerate(lines):
        for name, values in columns.items():
            try:
                values[number] = float(row[name])
            except (TypeError, ValueError) as error:
                message = f"{path}, line {line}: {name}: expected a number, found {row[name]!r}"
                raise KeypointsError(message) from error
    return keypoints_from_columns(str(path), columns)
