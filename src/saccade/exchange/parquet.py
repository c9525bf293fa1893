"""Parquet, many images to a table: a row for every point."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.exchange.fields import check_name, checked, keypoints_from, reading
from saccade.extras import import_optional
from saccade.files import atomic_write, check_file
from saccade.formats import FORMATS, check_format
from saccade.npz import check_unpacked
from saccade.types import IntArray, Keypoints

NUMBERS = ("x", "y", "size", "angle", "response")
COLUMNS = ("image", *NUMBERS, "octave", "descriptor")
ENTRIES = 128
"""Of a descriptor."""
ROW = 64
"""Bytes of the rest of a row, about."""
NOTE = b"saccade"
"""Key of what the file says about itself, as JSON: the images, since one may have no points."""


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
    parts = [_part(pa, name, points) for name, points in keypoints.items()]
    schema = _schema(pa).with_metadata(
        {NOTE: json.dumps({"images": list(keypoints), "format": FORMATS["points"]})}
    )
    return pa.Table.from_batches(parts, schema) if parts else schema.empty_table()


def write_parquet(path: str | Path, keypoints: Mapping[str, Keypoints]) -> None:
    """Write the points of many images to one file; see `to_arrow` for its columns.

    Args:
        path: whole or not at all; an old file is replaced.
        keypoints: by the name of their image.

    Raises:
        KeypointsError: shapes that do not fit together, or NaN.
        ConfigError: pyarrow is not installed.
        OutputError: the file cannot be written.
    """
    table = to_arrow(keypoints)
    pq = import_optional("pyarrow.parquet", "parquet")
    with atomic_write(path) as temporary, temporary.open("wb") as file:  # Arrow's paths are text
        pq.write_table(table, file, compression="zstd")


def read_parquet(path: str | Path) -> dict[str, Keypoints]:
    """Read a file as `write_parquet` writes it, or a folder of such files.

    The rows of an image need not lie together; they keep their order.

    Raises:
        KeypointsError: the file is missing, is something else, or lacks a column.
        ConfigError: pyarrow is not installed.
    """
    pa = import_optional("pyarrow", "parquet")
    pq = import_optional("pyarrow.parquet", "parquet")
    path = Path(path)
    with reading(path, "a Parquet file", pa.ArrowException, ValueError, AttributeError):
        check_unpacked(*_sizes(pq, path))
        table = pq.read_table(path)
        missing = [name for name in COLUMNS if name not in table.column_names]
        if missing:
            raise KeypointsError(f"{path}: expected a column {missing[0]}, found none")
        columns = {name: table[name].to_numpy() for name in (*NUMBERS, "octave")}
        described, descriptors = _descriptors(pa, table["descriptor"])
        images = table["image"].to_pylist()
        told = json.loads((table.schema.metadata or {}).get(NOTE, b"{}"))
        check_format("points", told.get("format"), path, KeypointsError)
        listed = told.get("images", ())
        rows: dict[str, list[int]] = {str(name): [] for name in listed}
    for row, name in enumerate(images):
        rows.setdefault(name, []).append(row)
    return {
        name: _points(f"{path}: {name}", np.array(those, np.int64), columns, described, descriptors)
        for name, those in rows.items()
    }


def _sizes(pq: Any, path: Path) -> tuple[int, int]:
    """Bytes of a file, or of a folder of files, and of their rows."""
    files = sorted(path.glob("**/*.parquet")) if path.is_dir() else [path]
    for file in files:
        check_file(file)
    rows = sum(pq.read_metadata(file).num_rows for file in files)
    return sum(file.stat().st_size for file in files), rows * (ENTRIES + ROW)


def _schema(pa: Any) -> Any:
    numbers = [(name, pa.float32()) for name in NUMBERS]
    descriptor = ("descriptor", pa.list_(pa.uint8(), ENTRIES))
    return pa.schema([("image", pa.string()), *numbers, ("octave", pa.int32()), descriptor])


def _part(pa: Any, name: str, points: Keypoints) -> Any:
    """The rows of one image."""
    points = checked(check_name(name), points)
    schema = _schema(pa)
    described = pa.nulls(len(points), schema.field("descriptor").type)
    if points.descriptors is not None:
        if points.descriptors.shape[1] != ENTRIES:
            raise KeypointsError(
                f"{name}: expected descriptors of {ENTRIES} entries, "
                f"found {points.descriptors.shape[1]}"
            )
        described = pa.FixedSizeListArray.from_arrays(points.descriptors.ravel(), ENTRIES)
    columns = (*points.xy.T, points.size, points.angle, points.response, points.octave)
    arrays = [pa.array(np.ascontiguousarray(column)) for column in columns]
    image = pa.repeat(name, len(points))
    return pa.RecordBatch.from_arrays([image, *arrays, described], schema=schema)


def _descriptors(pa: Any, column: Any) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
    """(n,) whether a row has a descriptor, and (n, 128) with zeros where it has none."""
    if pa.types.is_fixed_size_binary(column.type):  # as `saccade extract` packs them
        packed = b"".join(column.drop_null().to_pylist())
        flat = np.frombuffer(packed, np.uint8).reshape(-1, ENTRIES)
        described = column.is_valid().to_numpy()
        descriptors = np.zeros((len(column), ENTRIES), np.uint8)
        descriptors[described] = flat
        return described, descriptors
    rows = column.cast(pa.list_(pa.uint8(), ENTRIES)).combine_chunks()
    described = rows.is_valid().to_numpy(zero_copy_only=False)
    descriptors = np.zeros((len(rows), ENTRIES), np.uint8)
    descriptors[described] = rows.flatten().to_numpy().reshape(-1, ENTRIES)
    return described, descriptors


def _points(
    source: str,
    rows: IntArray,
    columns: Mapping[str, npt.NDArray[Any]],
    described: npt.NDArray[np.bool_],
    descriptors: npt.NDArray[np.uint8],
) -> Keypoints:
    if described[rows].any() and not described[rows].all():
        raise KeypointsError(f"{source}: expected descriptors for all points, found some empty")
    fields = {name: values[rows] for name, values in columns.items()}
    return keypoints_from(
        source,
        np.stack([fields.pop("x"), fields.pop("y")], axis=1),
        **fields,
        descriptors=None if len(rows) and not described[rows].any() else descriptors[rows],
    )
