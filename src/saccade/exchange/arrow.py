"""Tables of features as Arrow has them, in Parquet files with a list of the images.

The list is JSON text in the metadata of a file: an image may have no points.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from saccade.errors import KeypointsError
from saccade.exchange.fields import FIELDS, keypoints_from
from saccade.io.files import FORMATS, check_format
from saccade.io.npz import check_unpacked
from saccade.types import Keypoints

DESCRIPTOR_SIZE = 128
"""Entries of a descriptor."""
METADATA = b"saccade"
"""Key of the metadata."""
ROW_GROUP = 1 << 16
"""Rows that are written together; points take 10 MB."""
ZSTD_LEVEL = 1
"""Level 3 takes three times as long and saves nothing on data that is nearly random."""

POINT_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("x", pa.float32()),
        ("y", pa.float32()),
        *((name, pa.from_numpy_dtype(field.dtype)) for name, field in FIELDS.items()),
        ("descriptor", pa.binary(DESCRIPTOR_SIZE)),
    ]
)
"""A row for every point, in the units of `Keypoints`; the entries of a descriptor are its bytes."""


def rows_of_image(
    name: str, columns: Sequence[npt.NDArray[Any] | None], schema: pa.Schema
) -> pa.RecordBatch:
    """Rows of numbers or bytes, each with the name of the image in the first column.

    Args:
        name: of the image.
        columns: (n,) or (n, bytes) each, for the other columns; None for nulls.
        schema: of all columns.
    """
    n = len(columns[0]) if columns[0] is not None else 0
    arrays = [pa.repeat(column([name], pa.string())[0], n)]
    for field, values in zip(list(schema)[1:], columns, strict=True):
        if values is None:
            arrays.append(pa.nulls(n, field.type))
            continue
        is_bytes = pa.types.is_fixed_size_binary(field.type)
        dtype = np.uint8 if is_bytes else field.type.to_pandas_dtype()
        packed = pa.py_buffer(np.ascontiguousarray(values, dtype))
        arrays.append(pa.Array.from_buffers(field.type, n, [None, packed]))
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def column(cells: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Texts, bytes or numbers; None is a null.

    Built from buffers: `pa.array` would import pandas, which takes a second.
    """
    valid = np.array([cell is not None for cell in cells], bool)
    buffers: list[Any] = [np.packbits(valid, bitorder="little")]
    if pa.types.is_string(kind) or pa.types.is_binary(kind):
        packed = [cell.encode() if isinstance(cell, str) else cell or b"" for cell in cells]
        buffers += [np.cumsum([0, *map(len, packed)], dtype=np.int32), b"".join(packed)]
    else:
        buffers += [np.array([cell or 0 for cell in cells], kind.to_pandas_dtype())]
    return pa.Array.from_buffers(kind, len(cells), [pa.py_buffer(each) for each in buffers])


def rows_of(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.RecordBatch:
    """Rows of texts, bytes and numbers; an absent cell is a null."""
    columns = [column([row.get(field.name) for row in rows], field.type) for field in schema]
    return pa.RecordBatch.from_arrays(columns, schema=schema)


def read_metadata(file: pq.ParquetFile, path: object) -> dict[str, Any]:
    """The metadata of a file; the list of images is empty in a file of another program.

    Raises:
        KeypointsError: a file of a later version.
        TypeError: it is something else.
        ValueError: it is broken.
    """
    found = json.loads((file.metadata.metadata or {}).get(METADATA, b"{}"))
    if not isinstance(found, dict) or not isinstance(found.setdefault("images", []), list):
        raise TypeError("expected a list of images in the metadata")
    check_format("points", found.get("format"), path, KeypointsError)
    return found


def write_rows(
    path: Path,
    batches: Iterable[pa.RecordBatch],
    schema: pa.Schema,
    images: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Writes a Parquet file.

    Args:
        path: the file.
        batches: of rows; they are written group by group.
        schema: of the rows.
        images: each with a name, "image"; used after the last batch.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("wb") as file, pq.ParquetWriter(file, schema, **_options(schema)) as writer:
        for group in _grouped(batches):
            writer.write_table(pa.Table.from_batches(group))
        text = json.dumps({"format": FORMATS["points"], "images": images})
        writer.add_key_value_metadata({METADATA: text})


def read_rows(file: pq.ParquetFile, size: int, schema: pa.Schema) -> pa.Table:
    """The rows of a Parquet file, checked; other columns are left alone.

    Args:
        file: the file.
        size: its bytes, to refuse one that would fill the memory.
        schema: types that the columns must fit.

    Raises:
        ValueError: a column is missing, does not fit, or has a null; descriptors may have some.
        pyarrow.ArrowException: the file is broken.
    """
    for name in schema.names:
        if name not in file.schema_arrow.names:
            raise ValueError(f"expected a column {name}, found none")
    check_unpacked(size, file.metadata.num_rows * sum(_width(field.type) for field in schema))
    table = file.read(schema.names)
    table.validate(full=True)
    table = table.select(schema.names).cast(schema)
    for name in schema.names:
        if table[name].null_count and name != "descriptor":
            raise ValueError(f"{name}: expected no empty cell, found one")
    return table


def points_of(source: object, table: pa.Table, counts: Sequence[int]) -> list[Keypoints]:
    """The points of successive images.

    Args:
        source: of the table, for error messages.
        table: as `POINT_SCHEMA`.
        counts: rows of each image.

    Raises:
        KeypointsError: another number of rows, numbers that are no points, or descriptors of some
            points only.
    """
    if sum(counts) != len(table):
        raise KeypointsError(f"{source}: expected {sum(counts)} rows, found {len(table)}")
    xy = np.stack([table["x"].to_numpy(), table["y"].to_numpy()], 1)
    columns = {name: table[name].to_numpy() for name in FIELDS}
    described = table["descriptor"].is_valid().to_numpy()
    cells = table["descriptor"].combine_chunks()
    packed = np.frombuffer(cells.buffers()[1] or b"", np.uint8).reshape(-1, DESCRIPTOR_SIZE)
    descriptors, found, start = packed[cells.offset :], [], 0
    for count in counts:
        rows = slice(start, start + count)
        start += count
        if described[rows].any() and not described[rows].all():
            raise KeypointsError(
                f"{source}: expected descriptors for all points of an image, found some empty"
            )
        fields = {column: values[rows] for column, values in columns.items()}
        chosen = descriptors[rows] if described[rows].all() else None
        found.append(keypoints_from(str(source), xy[rows], chosen, **fields))
    return found


def _grouped(batches: Iterable[pa.RecordBatch]) -> Iterator[list[pa.RecordBatch]]:
    """Batches that have `ROW_GROUP` rows or more together."""
    group: list[pa.RecordBatch] = []
    for batch in batches:
        group.append(batch)
        if sum(map(len, group)) >= ROW_GROUP:
            yield group
            group = []
    if group:
        yield group


def _options(schema: pa.Schema) -> dict[str, Any]:
    """Encodings for Parquet: byte streams for floats, dictionaries for texts and integers."""
    floats = [field.name for field in schema if pa.types.is_float32(field.type)]
    names = [
        field.name
        for field in schema
        if pa.types.is_string(field.type) or pa.types.is_integer(field.type)
    ]
    return {
        "compression": "zstd",
        "compression_level": ZSTD_LEVEL,
        "use_dictionary": names,
        "column_encoding": dict.fromkeys(floats, "BYTE_STREAM_SPLIT"),
        "write_statistics": [name for name in names if name == "image"],
    }


def _width(kind: pa.DataType) -> int:
    """Bytes of a cell; texts and bytes of any length are taken for none."""
    return 0 if pa.types.is_string(kind) or pa.types.is_binary(kind) else kind.bit_width // 8
