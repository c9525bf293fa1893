"""Text for spreadsheets, one image to a file: everything but the descriptors."""

import csv
from io import StringIO
from pathlib import Path

import numpy as np

from saccade.errors import KeypointsError
from saccade.exchange.fields import checked, keypoints_from, reading
from saccade.files import atomic_write, read_text
from saccade.types import Keypoints

COLUMNS = ("x", "y", "size", "angle", "response", "octave")


def write_csv(path: str | Path, keypoints: Keypoints) -> None:
    """Write the points of an image: x, y, size, angle, response, octave.

    Numbers are as short as they can be and still be read back as the same float32.

    Args:
        path: whole or not at all; an old file is replaced.
        keypoints: their descriptors are left out.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        OutputError: the file cannot be written.
    """
    points = checked(str(path), keypoints)
    columns = (*points.xy.T, points.size, points.angle, points.response, points.octave)
    with (
        atomic_write(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(zip(*(column.astype(str) for column in columns), strict=True))


def read_csv(path: str | Path) -> Keypoints:
    """Read what `write_csv` writes; the order of the columns is free, and others may be there.

    Raises:
        KeypointsError: the file is missing, lacks a column, or holds what is no number.
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
    table = np.empty((len(lines), len(COLUMNS)))
    for number, (line, row) in enumerate(lines):
        for k, name in enumerate(COLUMNS):
            try:
                table[number, k] = float(row[name])
            except (TypeError, ValueError) as error:
                message = f"{path}, line {line}: {name}: expected a number, found {row[name]!r}"
                raise KeypointsError(message) from error
    x, y, size, angle, response, octave = table.T
    return keypoints_from(str(path), np.stack([x, y], axis=1), size, angle, response, octave)
