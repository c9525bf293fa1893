"""Tables of the keypoints of an image: CSV and NumPy's .npz.

CSV has all fields except descriptors; .npz has the fields of `Keypoints` by name.
"""

import csv
from pathlib import Path

from saccade.errors import KeypointsError
from saccade.io.files import FORMATS, atomic_write, check_format, reading
from saccade.io.keypoint_fields import (
    FIELDS,
    checked,
    columns_of,
    keypoints_from,
)
from saccade.io.npz import read_arrays, save_arrays
from saccade.types import Keypoints


def write_csv(path: str | Path, keypoints: Keypoints) -> None:
    """Write the points of an image: x, y, size, angle, response, octave.

    Numbers are the shortest that restore the same float32.

    Args:
        path: the file, written atomically; an existing file is replaced.
        keypoints: the points; descriptors are not written.

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


def write_npz(path: str | Path, keypoints: Keypoints) -> None:
    """Write the points of an image, compressed and without pickle.

    Args:
        path: the file, written atomically; an existing file is replaced.
        keypoints: the points; the array of descriptors is omitted if they have none.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        OutputError: the file cannot be written.
    """
    fields = vars(checked(str(path), keypoints))
    arrays = {name: values for name, values in fields.items() if values is not None}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        save_arrays(file, {"format": FORMATS["points"], **arrays})


def read_npz(path: str | Path) -> Keypoints:
    """Reads a file of `write_npz`; additional arrays are ignored.

    Raises:
        KeypointsError: the file is missing, has another format, or has no points.
    """
    path = Path(path)
    with reading(path, KeypointsError, "a NumPy .npz file", ValueError):
        arrays = read_arrays(path)
    if "format" in arrays:
        check_format("points", arrays["format"].tolist(), path, KeypointsError)
    if "xy" not in arrays:
        found = ", ".join(arrays) or "nothing"
        raise KeypointsError(f"{path}: expected an array xy, found {found}")
    fields = {name: arrays.get(name) for name in FIELDS}
    return keypoints_from(str(path), arrays["xy"], arrays.get("descriptors"), **fields)
