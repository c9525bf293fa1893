"""Schemas of the tables of a data set, and their rows as Arrow record batches."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import pyarrow as pa

from saccade.types import Float32Array, Keypoints, Regions, Scanpath

POINT_COLUMNS = ("x", "y", "size", "angle", "response")
BOX_COLUMNS = ("left", "top", "right", "bottom")
DESCRIPTOR_SIZE = 128
"""Entries of a descriptor."""
DESCRIPTOR_STEP = 3
"""The entries of a descriptor are rounded to its multiples: none is off by more than 1, and a
descriptor takes 79 bytes instead of 103."""
STEPS_PER_PIXEL = 256
"""Resolution of positions: a hundredth of the localization error of the best detectors."""
STEPS_PER_RADIAN = 4096
"""Resolution of angles."""
MANTISSA_BITS = 12
"""Kept of sizes, responses and boxes."""
ZSTD_LEVEL = 1
"""Level 3 takes three times as long and saves nothing on data that is nearly random."""


def point_schema(*, boxes: bool) -> pa.Schema:
    """The columns of interest points, or of regions with their boxes."""
    numbers = (*POINT_COLUMNS, *BOX_COLUMNS) if boxes else POINT_COLUMNS
    return pa.schema(
        [
            ("image", pa.string()),
            *((name, pa.float32()) for name in numbers),
            ("octave", pa.int8()),
            ("descriptor", pa.binary(DESCRIPTOR_SIZE)),
        ]
    )


def point_rows(name: str, detected: Keypoints | Regions, *, exact: bool) -> pa.RecordBatch:
    """A row for every point of an image, or every region.

    Args:
        name: of the image.
        detected: n points or regions with descriptors.
        exact: whether all bits are kept. If not, positions are rounded to 1/256 px, angles to
            1/4096 rad, sizes, responses and boxes to 12 bits, and the entries of descriptors to
            multiples of 3: all far below the precision of a detector, and random bits cannot be
            compressed.

    Returns:
        Columns image, x, y, size, angle, response, (left, top, right, bottom,) octave, and
        descriptor: 128 bytes, each an entry.
    """
    if isinstance(detected, Regions):
        points, boxes = detected.keypoints, list(detected.boxes.T)
    else:
        points, boxes = detected, []
    descriptors = points.descriptors
    if descriptors is None:
        descriptors = np.zeros((len(points), DESCRIPTOR_SIZE), np.uint8)
    x, y = points.xy.T
    size, angle, response = points.size, points.angle, points.response
    if not exact:
        x, y = (_round_to_fraction(values, STEPS_PER_PIXEL) for values in (x, y))
        angle = _round_to_fraction(angle, STEPS_PER_RADIAN)
        size, response, *boxes = (_round_mantissa(values) for values in (size, response, *boxes))
        descriptors = quantize_descriptors(cast("npt.NDArray[np.uint8]", descriptors))
    columns = (x, y, size, angle, response, *boxes, points.octave, descriptors)
    return _rows_of_image(name, columns, point_schema(boxes=bool(boxes)))


FIXATION_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("fixation", pa.int16()),
        *((name, pa.float32()) for name in ("x", "y", "time", "saliency")),
    ]
)
"""x and y in image pixels, time in seconds; the first fixation is 1."""


def fixation_rows(name: str, path: Scanpath) -> pa.RecordBatch:
    """A row for every fixation of a scanpath."""
    columns = (np.arange(1, len(path) + 1), *path.xy.T, path.time, path.saliency)
    return _rows_of_image(name, columns, FIXATION_SCHEMA)


MAP_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("file", pa.string()),
        ("array", pa.string()),
        ("rows", pa.int32()),
        ("columns", pa.int32()),
        *((name, pa.float32()) for name in ("x", "y", "maximum", "mean")),
    ]
)
"""File of the map of an image, array in it (Zarr only), shape, and maximum at x and y in image
pixels."""


def map_row(
    name: str, values: Float32Array, shape: tuple[int, ...], file: str, array: str
) -> pa.RecordBatch:
    """The row of a map.

    Args:
        name: of the image.
        values: (h, w) of the map.
        shape: (H, W, ...) of the image.
        file: that holds the map.
        array: of it in the file, "" in a PNG.
    """
    row, column = np.unravel_index(int(values.argmax()), values.shape)
    cells = {
        "image": name,
        "file": file,
        "array": array,
        "rows": values.shape[0],
        "columns": values.shape[1],
        "x": (column + 0.5) * shape[1] / values.shape[1] - 0.5,
        "y": (row + 0.5) * shape[0] / values.shape[0] - 0.5,
        "maximum": values.max(),
        "mean": values.mean(),
    }
    return record_batch([cells], MAP_SCHEMA)


RECORD_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("content", pa.string()),
        ("width", pa.int32()),
        ("height", pa.int32()),
        ("rows", pa.int64()),
        ("seconds", pa.float32()),
        ("configuration", pa.string()),
        ("version", pa.string()),
        ("error", pa.string()),
    ]
)
"""A row for every image: hash of its content (BLAKE2b, 128 bits), size, number of its rows in the
table, time, fingerprint of the job and version of saccade that made them, and error."""

NULLABLE = {"content", "width", "height", "seconds", "error"}
"""Columns of a record that may hold nulls."""

ERROR_SCHEMA = pa.schema([("image", pa.string()), ("content", pa.string()), ("error", pa.string())])


def check_columns(table: pa.Table, schema: pa.Schema) -> None:
    """Check a table that was read against its schema.

    Raises:
        ValueError: a column is missing, is of another type, or holds a null.
        pyarrow.ArrowInvalid: the data of a column is not of its type.
    """
    for field in schema:
        if field.name not in table.column_names:
            raise ValueError(f"no column {field.name!r}")
        column = table[field.name]
        if column.type != field.type:
            raise ValueError(f"{field.name}: expected {field.type}, found {column.type}")
        if column.null_count and field.name not in NULLABLE:
            raise ValueError(f"{field.name}: expected no empty cell, found one")
    table.validate(full=True)


def parquet_options(schema: pa.Schema) -> dict[str, Any]:
    """Encodings for `write_table`: byte streams for floats, dictionaries for texts and integers."""
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


def record_batch(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.RecordBatch:
    """Rows of text, bytes and numbers; what a row lacks is a null."""
    arrays = [column([row.get(field.name) for row in rows], field.type) for field in schema]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def column(cells: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Text, bytes or numbers; None is a null, and text that is not UTF-8 is escaped.

    Built from buffers: `pa.array` would import pandas, which takes a second.
    """
    valid = np.array([cell is not None for cell in cells], bool)
    validity = pa.py_buffer(np.packbits(valid, bitorder="little"))
    if pa.types.is_string(kind) or pa.types.is_binary(kind):
        packed = [
            cell.encode("utf-8", "backslashreplace") if isinstance(cell, str) else cell or b""
            for cell in cells
        ]
        offsets = np.cumsum([0, *map(len, packed)], dtype=np.int32)
        buffers = [validity, pa.py_buffer(offsets), pa.py_buffer(b"".join(packed))]
        return pa.Array.from_buffers(kind, len(cells), buffers)
    numbers = np.array([0 if cell is None else cell for cell in cells], kind.to_pandas_dtype())
    return pa.Array.from_buffers(kind, len(cells), [validity, pa.py_buffer(numbers)])


def quantize_descriptors(descriptors: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Round each entry to the nearest multiple of `DESCRIPTOR_STEP`."""
    if not len(descriptors):
        return descriptors
    return np.asarray(cv2.LUT(descriptors, _MULTIPLES), np.uint8)


_MULTIPLES = np.minimum(
    (np.arange(256) + DESCRIPTOR_STEP // 2) // DESCRIPTOR_STEP * DESCRIPTOR_STEP, 255
).astype(np.uint8)
"""The nearest multiple of `DESCRIPTOR_STEP` to each byte."""


def _rows_of_image(
    name: str, columns: Sequence[npt.NDArray[Any]], schema: pa.Schema
) -> pa.RecordBatch:
    """Rows of numbers or descriptors, each with the name of the image in the first column."""
    n = len(columns[0])
    arrays = [pa.repeat(column([name], pa.string())[0], n)]
    for field, values in zip(list(schema)[1:], columns, strict=True):
        is_bytes = pa.types.is_fixed_size_binary(field.type)
        dtype = np.uint8 if is_bytes else field.type.to_pandas_dtype()
        packed = pa.py_buffer(np.ascontiguousarray(values, dtype))
        arrays.append(pa.Array.from_buffers(field.type, n, [None, packed]))
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _round_to_fraction(values: Float32Array, parts: int) -> Float32Array:
    """Round to the nearest multiple of 1 / parts."""
    rounded: Float32Array = np.rint(values * np.float32(parts)) / np.float32(parts)
    return rounded


def _round_mantissa(values: Float32Array) -> Float32Array:
    """Round to `MANTISSA_BITS` bits of mantissa."""
    dropped = 23 - MANTISSA_BITS
    bits: npt.NDArray[np.uint32] = np.ascontiguousarray(values, np.float32).view(np.uint32)
    kept = (bits + np.uint32(1 << (dropped - 1))) >> np.uint32(dropped) << np.uint32(dropped)
    rounded: Float32Array = kept.view(np.float32)
    return rounded
