"""Feature tables in Parquet files, with a list of the images.

The list is JSON text in the file's metadata, since an image may have no points.
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
from saccade.io.files import FORMATS, check_format
from saccade.io.keypoint_fields import FIELDS, keypoints_from
from saccade.io.npz import check_unpacked
from saccade.types import Keypoints

DESCRIPTOR = "descriptor"
"""Name of the column of descriptors."""
DESCRIPTOR_SIZE = 128
"""Length of SIFT's descriptor."""
METADATA = b"saccade"
"""Key of the metadata."""
ROW_GROUP = 1 << 16
"""Number of rows per row group; points take 10 MB."""
ZSTD_LEVEL = 1
"""Compression level of Zstandard; level 3 takes three times as long and gains nothing on nearly
random data."""

POINT_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("x", pa.float32()),
        ("y", pa.float32()),
        *((name, pa.from_numpy_dtype(field.dtype)) for name, field in FIELDS.items()),
        (DESCRIPTOR, pa.binary(DESCRIPTOR_SIZE)),
    ]
)
"""Schema with one row per point, in the units of `Keypoints`, and SIFT's descriptors as bytes."""


def point_schema(kind: pa.DataType) -> pa.Schema:
    """`POINT_SCHEMA` with another type of descriptors."""
    return POINT_SCHEMA.set(len(POINT_SCHEMA) - 1, pa.field(DESCRIPTOR, kind))


def descriptor_type(descriptors: npt.NDArray[Any]) -> pa.DataType:
    """Type of a column of descriptors (n, d): bytes, or lists of float32."""
    size = descriptors.shape[1]
    return pa.binary(size) if descriptors.dtype == np.uint8 else pa.list_(pa.float32(), size)


def schema_in(file: pq.ParquetFile) -> pa.Schema:
    """`POINT_SCHEMA` with the type of the descriptors in a file."""
    index = file.schema_arrow.get_field_index(DESCRIPTOR)
    kind = file.schema_arrow.field(index).type if index >= 0 else pa.null()
    floats = pa.types.is_fixed_size_list(kind) and kind.value_type == pa.float32()
    usable = floats or pa.types.is_fixed_size_binary(kind)
    return point_schema(kind) if usable else POINT_SCHEMA


def rows_of_image(
    name: str, columns: Sequence[npt.NDArray[Any] | None], schema: pa.Schema
) -> pa.RecordBatch:
    """Rows of an image, with its name in the first column.

    Args:
        name: name of the image.
        columns: (n,) or (n, bytes) values of the remaining columns; None for nulls.
        schema: schema of all columns.
    """
    n = len(columns[0]) if columns[0] is not None else 0
    arrays = [pa.repeat(column([name], pa.string())[0], n)]
    for field, values in zip(list(schema)[1:], columns, strict=True):
        if values is None:
            arrays.append(pa.nulls(n, field.type))
            continue
        if pa.types.is_fixed_size_list(field.type):
            flat = pa.py_buffer(np.ascontiguousarray(values, np.float32))
            floats = pa.Array.from_buffers(pa.float32(), values.size, [None, flat])
            arrays.append(pa.FixedSizeListArray.from_arrays(floats, type=field.type))
            continue
        is_bytes = pa.types.is_fixed_size_binary(field.type)
        dtype = np.uint8 if is_bytes else field.type.to_pandas_dtype()
        packed = pa.py_buffer(np.ascontiguousarray(values, dtype))
        arrays.append(pa.Array.from_buffers(field.type, n, [None, packed]))
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def column(cells: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Column of texts, bytes or numbers; None becomes null.

    The column is built from buffers, since `pa.array` imports pandas, which takes a second.
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
    """Rows of texts, bytes and numbers; missing cells become null."""
    columns = [column([row.get(field.name) for row in rows], field.type) for field in schema]
    return pa.RecordBatch.from_arrays(columns, schema=schema)


def read_metadata(file: pq.ParquetFile, path: object) -> dict[str, Any]:
    """Metadata of a file; the list of images is empty for files from other programs.

    Raises:
        KeypointsError: the file has a later version.
        TypeError: the metadata is not a list of images.
        ValueError: the metadata is malformed.
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
        batches: batches of rows, written in row groups.
        schema: schema of the rows.
        images: list of images, each with a name "image"; read after the last batch.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("wb") as file, pq.ParquetWriter(file, schema, **_options(schema)) as writer:
        for group in _grouped(batches):
            writer.write_table(pa.Table.from_batches(group))
        text = json.dumps({"format": FORMATS["points"], "images": images})
        writer.add_key_value_metadata({METADATA: text})


def read_rows(file: pq.ParquetFile, size: int, schema: pa.Schema) -> pa.Table:
    """Reads and checks the rows of a Parquet file; other columns are ignored.

    Args:
        file: the file.
        size: its size in bytes, for the limit on memory.
        schema: types that the columns must fit.

    Raises:
        ValueError: a column is missing, has the wrong type, or has nulls (allowed for descriptors).
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
        if table[name].null_count and name != DESCRIPTOR:
            raise ValueError(f"{name}: expected no empty cell, found one")
    return table


def points_of(source: object, table: pa.Table, counts: Sequence[int]) -> list[Keypoints]:
    """The points of successive images.

    Args:
        source: name of the table, for error messages.
        table: table with the columns of `POINT_SCHEMA`.
        counts: number of rows of each image.

    Raises:
        KeypointsError: wrong number of rows, invalid points, or descriptors for some points only.
    """
    if sum(counts) != len(table):
        raise KeypointsError(f"{source}: expected {sum(counts)} rows, found {len(table)}")
    xy = np.stack([table["x"].to_numpy(), table["y"].to_numpy()], 1)
    columns = {name: table[name].to_numpy() for name in FIELDS}
    described = table[DESCRIPTOR].is_valid().to_numpy()
    descriptors, found, start = _descriptors(table), [], 0
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


def _descriptors(table: pa.Table) -> npt.NDArray[Any]:
    """(n, d) descriptors; rows without one are not defined."""
    cells = table[DESCRIPTOR].combine_chunks()
    if isinstance(cells, pa.ChunkedArray):
        cells = pa.concat_arrays(cells.chunks) if cells.num_chunks else pa.array([], cells.type)
    if pa.types.is_fixed_size_list(cells.type):
        size = cells.type.list_size
        values = cells.values.to_numpy(zero_copy_only=False).reshape(-1, size)
    else:
        size = cells.type.byte_width
        values = np.frombuffer(cells.buffers()[1] or b"", np.uint8).reshape(-1, size)
    rows: npt.NDArray[Any] = values[cells.offset :]
    return rows


def _grouped(batches: Iterable[pa.RecordBatch]) -> Iterator[list[pa.RecordBatch]]:
    """Groups of batches with at least `ROW_GROUP` rows."""
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
    """Size of a cell in bytes; 0 for types of variable length."""
    if pa.types.is_fixed_size_list(kind):
        return int(kind.list_size * _width(kind.value_type))
    return 0 if pa.types.is_string(kind) or pa.types.is_binary(kind) else kind.bit_width // 8
