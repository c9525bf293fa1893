"""Tables of points as Arrow has them, in Parquet files with a list of the images.

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
from saccade.exchange.fields import (
    COLUMNS,
    FIELDS,
    check_name,
    checked,
    columns_of,
    keypoints_from,
    keypoints_from_columns,
)
from saccade.io.files import FORMATS, atomic_write, check_format, natural_order, open_file, reading
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
NO_POINTS = keypoints_from("no points", np.zeros((0, 2)), np.zeros((0, DESCRIPTOR_SIZE)))


def point_rows(name: str, points: Keypoints) -> pa.RecordBatch:
    """A row for every point of an image.

    Raises:
        KeypointsError: shapes that do not fit together, NaN, or descriptors of another length.
    """
    points = checked(check_name(name), points)
    descriptors = points.descriptors
    if descriptors is not None and descriptors.shape[1] != DESCRIPTOR_SIZE:
        expected = f"expected descriptors of {DESCRIPTOR_SIZE} entries"
        raise KeypointsError(f"{name}: {expected}, found {descriptors.shape[1]}")
    return rows_of_image(name, [*columns_of(points).values(), descriptors], POINT_SCHEMA)


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


def metadata_of(images: Sequence[Mapping[str, Any]]) -> dict[bytes, str]:
    """The metadata of a file: its format, and its images."""
    return {METADATA: json.dumps({"format": FORMATS["points"], "images": images})}


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
        writer.add_key_value_metadata(metadata_of(images))


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


def to_arrow(keypoints: Mapping[str, Keypoints]) -> pa.Table:
    """Points as a `pyarrow.Table`, image by image.

    Args:
        keypoints: by the name of their image; descriptors have 128 entries or are None.

    Returns:
        Columns image (string), x, y, size, angle, response (float32), octave (int32) and
        descriptor (128 bytes, or null), in the units of `Keypoints`.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
    """
    batches = [point_rows(name, points) for name, points in keypoints.items()]
    metadata = metadata_of([{"image": name} for name in keypoints])
    return pa.Table.from_batches(batches, POINT_SCHEMA).replace_schema_metadata(metadata)


def write_parquet(path: str | Path, keypoints: Mapping[str, Keypoints]) -> None:
    """Writes the points of many images to one file; see `to_arrow` for its columns.

    Args:
        path: written whole or not at all; an old file is replaced.
        keypoints: by the name of their image.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        OutputError: the file cannot be written.
    """
    batches = (point_rows(name, points) for name, points in keypoints.items())
    with atomic_write(path) as temporary:
        write_rows(temporary, batches, POINT_SCHEMA, [{"image": name} for name in keypoints])


def read_parquet(path: str | Path) -> dict[str, Keypoints]:
    """Reads a file as `write_parquet` or `saccade extract` writes it, or a folder of such files.

    The rows of an image need not be adjacent; they keep their order.

    Raises:
        KeypointsError: the file is missing, is something else, or lacks a column.
    """
    path = Path(path)
    names: dict[str, None] = {}
    tables = [POINT_SCHEMA.empty_table()]
    with reading(path, KeypointsError, "a Parquet file", pa.ArrowException, ValueError, TypeError):
        for each in (
            sorted(path.glob("**/*.parquet"), key=natural_order) if path.is_dir() else [path]
        ):
            with open_file(each) as opened, pq.ParquetFile(opened) as file:
                names |= {
                    str(image["image"]): None for image in read_metadata(file, each)["images"]
                }
                tables.append(read_rows(file, each.stat().st_size, POINT_SCHEMA))
        found = points_by_image(path, pa.concat_tables(tables))
    return {name: found.get(name, NO_POINTS) for name in names | dict.fromkeys(found)}


def points_by_image(source: object, table: pa.Table) -> dict[str, Keypoints]:
    """The points of every image, whose rows need not be adjacent and keep their order.

    Raises:
        KeypointsError: numbers that are no points, or descriptors of some points only.
    """
    images = table["image"].combine_chunks().dictionary_encode()
    codes = images.indices.to_numpy()
    order = np.argsort(codes, kind="stable")
    ends = np.cumsum(np.bincount(codes, minlength=len(images.dictionary)))
    columns = {name: table[name].to_numpy() for name in COLUMNS}
    described = table["descriptor"].is_valid().to_numpy()
    cells = table["descriptor"].combine_chunks()
    packed = np.frombuffer(cells.buffers()[1] or b"", np.uint8).reshape(-1, DESCRIPTOR_SIZE)
    descriptors = packed[cells.offset :]
    found = {}
    for name, rows in zip(
        images.dictionary.to_pylist(), np.split(order, ends[:-1]), strict=bool(len(ends))
    ):
        some = described[rows]
        if some.any() and not some.all():
            raise KeypointsError(
                f"{source}: {name}: expected descriptors for all points, found some empty"
            )
        fields = {column: values[rows] for column, values in columns.items()}
        chosen = descriptors[rows] if some.all() else None
        found[name] = keypoints_from_columns(f"{source}: {name}", fields, chosen)
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
