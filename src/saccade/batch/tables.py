"""The rows of the tables, and how they are packed into Parquet files."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import pyarrow as pa

from saccade.types import Float32Array, Keypoints, Regions, Scanpath

NUMBERS = ("x", "y", "size", "angle", "response")
BOX = ("left", "top", "right", "bottom")
ENTRIES = 128
"""Of a descriptor."""
STEP = 3
"""To a multiple of which the entries of a descriptor are rounded: none is off by more than 1,
and they take 79 bytes where they took 103."""
PLACE = 256
"""Steps to a pixel of a place: a hundredth of what the best detectors are off by."""
TURN = 4096
"""Steps to a radian of an angle."""
MANTISSA = 12
"""Bits kept of a size and a response."""
LEVEL = 1
"""Of zstd: 3 takes longer by a factor of three and saves nothing on what is nearly random."""


def point_schema(*, boxes: bool) -> pa.Schema:
    """The columns of points; of regions with their boxes."""
    numbers = (*NUMBERS, *BOX) if boxes else NUMBERS
    return pa.schema(
        [
            ("image", pa.string()),
            *((name, pa.float32()) for name in numbers),
            ("octave", pa.int8()),
            ("descriptor", pa.binary(ENTRIES)),
        ]
    )


def point_table(name: str, found: Keypoints | Regions, *, exact: bool) -> pa.RecordBatch:
    """A row for every point of an image, or every region.

    Args:
        name: of the image.
        found: n points with descriptors.
        exact: whether all bits are kept. If not, places are rounded to 1/256 px, angles to
            1/4096 rad, sizes, responses and boxes to 12 bits, and the entries of descriptors to
            multiples of 3: all far below what a detector is sure of, and random bits are
            what zstd cannot pack.

    Returns:
        Columns image, x, y, size, angle, response, (left, top, right, bottom,) octave, and
        descriptor: 128 bytes, each an entry.
    """
    points = found.keypoints if isinstance(found, Regions) else found
    descriptors = points.descriptors
    if descriptors is None:
        descriptors = np.zeros((len(points), ENTRIES), np.uint8)
    columns = [*points.xy.T, points.size, points.angle, points.response]
    boxes = list(found.boxes.T) if isinstance(found, Regions) else []
    if not exact:
        places, (size, angle, response) = columns[:2], columns[2:]
        columns = [to_multiples(each, PLACE) for each in places]
        columns += [shortened(size), to_multiples(angle, TURN), shortened(response)]
        boxes = [shortened(each) for each in boxes]
        descriptors = in_threes(cast("npt.NDArray[np.uint8]", descriptors))
    packed = np.ascontiguousarray(descriptors).reshape(-1, ENTRIES)
    return pa.RecordBatch.from_arrays(
        [
            _repeated(name, len(points)),
            *(column(each, np.float32) for each in columns + boxes),
            column(points.octave, np.int8),
            pa.FixedSizeBinaryArray.from_buffers(
                pa.binary(ENTRIES), len(points), [None, pa.py_buffer(packed)]
            ),
        ],
        schema=point_schema(boxes=isinstance(found, Regions)),
    )


FIXATIONS = pa.schema(
    [
        ("image", pa.string()),
        ("fixation", pa.int16()),
        *((name, pa.float32()) for name in ("x", "y", "time", "saliency")),
    ]
)
"""x and y in image pixels, time in seconds; the first fixation is 1."""


def fixation_table(name: str, path: Scanpath) -> pa.RecordBatch:
    """A row for every fixation of a scanpath."""
    n = len(path)
    columns = (*path.xy.T, path.time, path.saliency)
    return pa.RecordBatch.from_arrays(
        [
            _repeated(name, n),
            column(np.arange(1, n + 1), np.int16),
            *(column(each, np.float32) for each in columns),
        ],
        schema=FIXATIONS,
    )


MAP_ROWS = pa.schema(
    [
        ("image", pa.string()),
        ("file", pa.string()),
        ("array", pa.string()),
        ("rows", pa.int32()),
        ("columns", pa.int32()),
        *((name, pa.float32()) for name in ("x", "y", "maximum", "mean")),
    ]
)
"""Where the map of an image is, its shape, and its highest value, at x and y in image pixels."""


def map_row(name: str, file: str, array: str, values: Float32Array, shape: Any) -> pa.RecordBatch:
    """The row of a map: `values` (h, w) of an image of some `shape`."""
    row, column = np.unravel_index(int(values.argmax()), values.shape)
    x = (column + 0.5) * shape[1] / values.shape[1] - 0.5
    y = (row + 0.5) * shape[0] / values.shape[0] - 0.5
    cells = [name, file, array, *values.shape, x, y, values.max(), values.mean()]
    return batch_of([dict(zip(MAP_ROWS.names, cells, strict=True))], MAP_ROWS)


RECORD = pa.schema(
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
"""What is known of every image: the hash of its content (BLAKE2b, 128 bits), how many rows of
the table are its own, how long it took, what made them, and what was wrong with it."""

UNKNOWN = {"content", "width", "height", "seconds", "error"}
"""Columns of a record in which a cell may be empty."""

ERRORS = pa.schema([("image", pa.string()), ("content", pa.string()), ("error", pa.string())])


def check_columns(table: pa.Table, schema: pa.Schema) -> None:
    """Refuse a table that is not what was written.

    Raises:
        ValueError: a column of the schema is missing, is of another type, or has an empty cell.
        pyarrow.ArrowInvalid: what is in a column is not of its type.
    """
    for field in schema:
        if field.name not in table.column_names:
            raise ValueError(f"no column {field.name!r}")
        column = table[field.name]
        if column.type != field.type:
            raise ValueError(f"{field.name}: expected {field.type}, found {column.type}")
        if column.null_count and field.name not in UNKNOWN:
            raise ValueError(f"{field.name}: expected no empty cell, found one")
    table.validate(full=True)


def parquet_options(schema: pa.Schema) -> dict[str, Any]:
    """How the columns are packed best: numbers by their bytes, names by a dictionary."""
    numbers = [each.name for each in schema if pa.types.is_float32(each.type)]
    names = [
        each.name
        for each in schema
        if pa.types.is_string(each.type) or pa.types.is_integer(each.type)
    ]
    return {
        "compression": "zstd",
        "compression_level": LEVEL,
        "use_dictionary": names,
        "column_encoding": dict.fromkeys(numbers, "BYTE_STREAM_SPLIT"),
        "write_statistics": [name for name in names if name == "image"],
    }


MULTIPLES = np.minimum((np.arange(256) + STEP // 2) // STEP * STEP, 255).astype(np.uint8)
"""The nearest multiple of `STEP` to each byte."""


def column(values: npt.NDArray[Any], dtype: npt.DTypeLike) -> pa.Array:
    """The values as they lie, without a copy."""
    packed = np.ascontiguousarray(values, dtype)
    kind = pa.from_numpy_dtype(packed.dtype)
    return pa.Array.from_buffers(kind, len(packed), [None, pa.py_buffer(packed)])


def texts(values: Sequence[str | None]) -> pa.Array:
    """A column of text, from its buffers: all that takes Python objects would load pandas."""
    packed = [(value or "").encode("utf-8", "backslashreplace") for value in values]
    offsets = np.cumsum([0, *map(len, packed)], dtype=np.int32)
    buffers = [_validity(values), pa.py_buffer(offsets), pa.py_buffer(b"".join(packed))]
    return pa.Array.from_buffers(pa.string(), len(values), buffers)


def _repeated(value: str, n: int) -> pa.Array:
    packed = value.encode()
    offsets = np.arange(n + 1, dtype=np.int32) * len(packed)
    return pa.Array.from_buffers(
        pa.string(), n, [None, pa.py_buffer(offsets), pa.py_buffer(packed * n)]
    )


def batch_of(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.RecordBatch:
    """Rows of text and numbers; what a row lacks, or has as None, is a null."""
    arrays = []
    for field in schema:
        cells = [row.get(field.name) for row in rows]
        if pa.types.is_string(field.type):
            arrays.append(texts(cells))
        else:
            filled = [0 if cell is None else cell for cell in cells]
            packed = pa.py_buffer(np.array(filled, field.type.to_pandas_dtype()))
            arrays.append(pa.Array.from_buffers(field.type, len(cells), [_validity(cells), packed]))
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _validity(cells: Sequence[Any]) -> pa.Buffer:
    """A bit for every cell that has a value."""
    valid = np.array([cell is not None for cell in cells], bool)
    return pa.py_buffer(np.packbits(valid, bitorder="little"))


def to_multiples(values: Float32Array, parts: int) -> Float32Array:
    """To the nearest multiple of 1 / parts."""
    rounded: Float32Array = np.rint(values * np.float32(parts)) / np.float32(parts)
    return rounded


def shortened(values: Float32Array) -> Float32Array:
    """With `MANTISSA` bits kept of each number."""
    lost = 23 - MANTISSA
    bits: npt.NDArray[np.uint32] = np.ascontiguousarray(values, np.float32).view(np.uint32)
    kept = (bits + np.uint32(1 << (lost - 1))) >> np.uint32(lost) << np.uint32(lost)
    rounded: Float32Array = kept.view(np.float32)
    return rounded


def in_threes(descriptors: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Each entry as the nearest multiple of `STEP`."""
    if not len(descriptors):
        return descriptors
    return np.asarray(cv2.LUT(descriptors, MULTIPLES), np.uint8)
