"""Tables of keypoints: CSV and NumPy's .npz of one image, Parquet of many.

CSV has all fields but the descriptors; .npz has the fields of `Keypoints` by their names; Parquet
has a row for every point.
"""

import csv
import json
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.exchange.fields import (
    COLUMNS,
    FIELDS,
    check_name,
    checked,
    columns_of,
    keypoints_from,
    keypoints_from_columns,
)
from saccade.extras import import_optional
from saccade.io.files import FORMATS, atomic_write, check_file, check_format, read_text, reading
from saccade.io.npz import check_unpacked, read_arrays, save_arrays
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
    with reading(path, KeypointsError, "CSV text", csv.Error):
        reader = csv.DictReader(StringIO(read_text(path), newline=""))
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


def write_npz(path: str | Path, keypoints: Keypoints) -> None:
    """Write the points of an image, compressed and without pickle.

    Args:
        path: written whole or not at all; an old file is replaced.
        keypoints: without descriptors there is no array of that name.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        OutputError: the file cannot be written.
    """
    fields = vars(checked(str(path), keypoints))
    arrays = {name: values for name, values in fields.items() if values is not None}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        save_arrays(file, {"format": FORMATS["points"], **arrays})


def read_npz(path: str | Path) -> Keypoints:
    """Read what `write_npz` writes; other arrays in the file are left alone.

    Raises:
        KeypointsError: the file is missing, is something else, or holds no points.
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


DESCRIPTOR_SIZE = 128
ROW_SIZE = DESCRIPTOR_SIZE + 64
"""Bytes of a row, about."""
METADATA = b"saccade"
"""Key of the metadata, a JSON text with the images: one may have no points."""


def to_arrow(keypoints: Mapping[str, Keypoints]) -> Any:
    """Points as a `pyarrow.Table`, image by image.

    Args:
        keypoints: by the name of their image; descriptors have 128 entries or are None.

    Returns:
        Columns image (string), x, y, size, angle, response (float32), octave (int32) and
        descriptor (128 uint8, or null). Units are those of `Keypoints`.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        ConfigError: pyarrow is not installed.
    """
    pa = import_optional("pyarrow", "parquet")
    batches = [_record_batch(pa, name, points) for name, points in keypoints.items()]
    schema = _schema(pa).with_metadata(
        {METADATA: json.dumps({"images": list(keypoints), "format": FORMATS["points"]})}
    )
    return pa.Table.from_batches(batches, schema)


def write_parquet(path: str | Path, keypoints: Mapping[str, Keypoints]) -> None:
    """Write the points of many images to one file; see `to_arrow` for its columns.

    Args:
        path: written whole or not at all; an old file is replaced.
        keypoints: by the name of their image. If some have no descriptors, those of the others
            are lists without a fixed size in the file.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        ConfigError: pyarrow is not installed.
        OutputError: the file cannot be written.
    """
    table = to_arrow(keypoints)
    pa = import_optional("pyarrow", "parquet")
    pq = import_optional("pyarrow.parquet", "parquet")
    index = table.schema.get_field_index("descriptor")
    if table["descriptor"].null_count:  # among fixed-size lists pyarrow reads them from 26 on
        loose = table.schema.field(index).with_type(pa.list_(pa.uint8()))
        table = table.cast(table.schema.set(index, loose))
    with atomic_write(path) as temporary, temporary.open("wb") as file:  # Arrow's paths are text
        pq.write_table(table, file, compression="zstd")


def read_parquet(path: str | Path) -> dict[str, Keypoints]:
    """Read a file as `write_parquet` or `saccade extract` writes it, or a folder of such files.

    The rows of an image need not be adjacent; they keep their order.

    Raises:
        KeypointsError: the file is missing, is something else, or lacks a column.
        ConfigError: pyarrow is not installed.
    """
    pa = import_optional("pyarrow", "parquet")
    pq = import_optional("pyarrow.parquet", "parquet")
    path = Path(path)
    with reading(
        path, KeypointsError, "a Parquet file", pa.ArrowException, ValueError, AttributeError
    ):
        check_unpacked(*_sizes(pq, path))
        table = pq.read_table(path)
        for name in ("image", *COLUMNS, "descriptor"):
            if name not in table.column_names:
                raise KeypointsError(f"{path}: expected a column {name}, found none")
        columns = {name: table[name].to_numpy() for name in COLUMNS}
        described, descriptors = _descriptors(pa, table["descriptor"])
        metadata = json.loads((table.schema.metadata or {}).get(METADATA, b"{}"))
        check_format("points", metadata.get("format"), path, KeypointsError)
        rows_of: dict[str, list[int]] = {str(name): [] for name in metadata.get("images", ())}
        for row, name in enumerate(table["image"].to_pylist()):
            rows_of.setdefault(name, []).append(row)
    found = {}
    for name, numbers in rows_of.items():
        rows = np.array(numbers, np.int64)
        source, some = f"{path}: {name}", described[rows]
        if some.any() and not some.all():
            raise KeypointsError(f"{source}: expected descriptors for all points, found some empty")
        fields = {column: values[rows] for column, values in columns.items()}
        found[name] = keypoints_from_columns(
            source, fields, descriptors[rows] if some.all() else None
        )
    return found


def _sizes(pq: Any, path: Path) -> tuple[int, int]:
    """Bytes of a file, or of a folder of files, and of their rows."""
    files = sorted(path.glob("**/*.parquet")) if path.is_dir() else [path]
    for file in files:
        check_file(file)
    rows = sum(pq.read_metadata(file).num_rows for file in files)
    return sum(file.stat().st_size for file in files), rows * ROW_SIZE


def _schema(pa: Any) -> Any:
    numbers = [("x", pa.float32()), ("y", pa.float32())]
    numbers += [(name, pa.from_numpy_dtype(field.dtype)) for name, field in FIELDS.items()]
    descriptor = ("descriptor", pa.list_(pa.uint8(), DESCRIPTOR_SIZE))
    return pa.schema([("image", pa.string()), *numbers, descriptor])


def _record_batch(pa: Any, name: str, points: Keypoints) -> Any:
    """The rows of one image."""
    points = checked(check_name(name), points)
    schema = _schema(pa)
    descriptors = pa.nulls(len(points), schema.field("descriptor").type)
    if points.descriptors is not None:
        size = points.descriptors.shape[1]
        if size != DESCRIPTOR_SIZE:
            expected = f"expected descriptors of {DESCRIPTOR_SIZE} entries"
            raise KeypointsError(f"{name}: {expected}, found {size}")
        descriptors = pa.FixedSizeListArray.from_arrays(points.descriptors.ravel(), size)
    arrays = [pa.array(np.ascontiguousarray(values)) for values in columns_of(points).values()]
    image = pa.repeat(name, len(points))
    return pa.RecordBatch.from_arrays([image, *arrays, descriptors], schema=schema)


def _descriptors(pa: Any, column: Any) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
    """(n,) whether a row has a descriptor, and (n, 128) with zeros where it has none."""
    described = column.is_valid().to_numpy()
    if pa.types.is_fixed_size_binary(column.type):  # as `saccade extract` packs them
        packed = np.frombuffer(b"".join(column.drop_null().to_pylist()), np.uint8)
    else:
        lists = column.drop_null().cast(pa.list_(pa.uint8(), DESCRIPTOR_SIZE))
        packed = lists.combine_chunks().flatten().to_numpy()
    descriptors = np.zeros((len(column), DESCRIPTOR_SIZE), np.uint8)
    descriptors[described] = packed.reshape(-1, DESCRIPTOR_SIZE)
    return described, descriptors
