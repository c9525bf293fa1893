"""Reads data sets of `extract`: the manifest, records and tables; exports keypoints."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.job import POINTS
from saccade.batch.sources import Store, open_store
from saccade.batch.tables import (
    DESCRIPTOR_SIZE,
    RECORD_SCHEMA,
    check_columns,
    parquet_options,
    point_schema,
)
from saccade.errors import ConfigError, KeypointsError
from saccade.exchange import write_colmap, write_csv, write_hdf5
from saccade.exchange.fields import COLUMNS, check_name, keypoints_from_columns
from saccade.exchange.opencv import write_opencv
from saccade.io.files import LARGEST_TEXT, check_format, one_line, reason_of
from saccade.io.npz import check_unpacked
from saccade.types import Keypoints

MANIFEST = "manifest.json"
RECORDS = "images"
"""Folder of the records, a row for every image."""
IMAGE_COLUMNS = ("image", "rows", "width", "height", "error")
"""Columns of a record that readers of points need."""
PREFIX, SUFFIX = "part-", ".parquet"
ROW_GROUP = 1 << 16
"""Rows that are written together; as points they take 10 MB."""


class ImageKeypoints(NamedTuple):
    """The keypoints of an image."""

    image: str
    shape: tuple[int, int]
    """(H, W)."""
    points: Keypoints


def read_points(location: str) -> Iterator[ImageKeypoints]:
    """The keypoints of every image of a data set; one shard at a time is in memory.

    Args:
        location: folder or URL of the data set.

    Raises:
        ConfigError: there is no data set, or it holds no points.
        KeypointsError: one of its files is broken.
    """
    store = open_store(location)
    what = read_point_manifest(store)["what"]
    for shard in point_shards(store, what):
        yield from shard


def point_shards(store: Store, what: str) -> Iterator[list[ImageKeypoints]]:
    """The keypoints of all images of a shard, shard by shard."""
    for file in record_files(store):
        yield read_shard(store, what, file)


def read_shard(store: Store, what: str, file: str) -> list[ImageKeypoints]:
    """The keypoints of all images of a shard, by the file name of its record."""
    table = read_table(store, f"{what}/{file}", point_schema(boxes=False))
    record = read_record(store, file, IMAGE_COLUMNS).to_pylist()
    if sum(row["rows"] for row in record) != len(table):
        raise KeypointsError(f"{what}/{file}: expected the rows of its record, found {len(table)}")
    columns = {name: table[name].to_numpy() for name in COLUMNS}
    packed = table["descriptor"].combine_chunks().buffers()[1] or b""
    descriptors = np.frombuffer(packed, np.uint8).reshape(-1, DESCRIPTOR_SIZE)[: len(table)]
    points = keypoints_from_columns(f"{store.location}/{what}/{file}", columns, descriptors)
    images, start = [], 0
    for row in record:
        rows = slice(start, start + row["rows"])
        start = rows.stop
        if row["error"] is None:
            shape = (row["height"] or 0, row["width"] or 0)
            if min(shape) < 1:
                raise KeypointsError(f"{row['image']}: expected an image of a size, found {shape}")
            images.append(ImageKeypoints(row["image"], shape, points[rows]))
    return images


def read_point_manifest(store: Store) -> dict[str, Any]:
    """The manifest of a data set of points.

    Raises:
        ConfigError: there is none, or it is of something else.
    """
    manifest = read_manifest(store)
    if manifest is None or manifest["what"] not in POINTS:
        found = "no manifest.json" if manifest is None else manifest["what"]
        raise ConfigError(f"{store.location}: expected extracted points, found {found}")
    return manifest


def read_manifest(store: Store) -> dict[str, Any] | None:
    """The manifest; None where there is none.

    Raises:
        ConfigError: it is broken, or of a later version of saccade.
    """
    path = f"{store.location}/{MANIFEST}"
    try:
        with store.open(MANIFEST) as file:
            manifest = dict(json.loads(file.read(LARGEST_TEXT)))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}") from error
    check_format("extraction", manifest.get("format"), path, ConfigError)
    if not isinstance(manifest.get("configuration"), dict) or "what" not in manifest:
        raise ConfigError(f"{path}: expected what `saccade extract` writes, found other names")
    return manifest


def read_records(store: Store) -> Iterator[pa.Table]:
    """The records of all shards."""
    for file in record_files(store):
        yield read_record(store, file)


def read_record(store: Store, file: str, columns: Sequence[str] | None = None) -> pa.Table:
    """The record of a shard."""
    return read_table(store, f"{RECORDS}/{file}", RECORD_SCHEMA, columns)


def read_table(
    store: Store, name: str, schema: pa.Schema, columns: Sequence[str] | None = None
) -> pa.Table:
    """A Parquet file of a data set, checked. Arrow's own `read_table` would import pandas.

    Args:
        store: the data set.
        name: of the file.
        schema: with which it was written.
        columns: to read; None for all.

    Raises:
        KeypointsError: it is missing, broken, or something else.
    """
    names = columns or schema.names
    expected = pa.schema([schema.field(name) for name in names])
    try:
        with store.open(name) as opened, pq.ParquetFile(opened) as file:
            size = opened.seek(0, os.SEEK_END)
            check_unpacked(size, file.metadata.num_rows * _row_size(expected))
            table = file.read(names)
            check_columns(table, expected)
            return table
    except (pa.ArrowException, OSError, ValueError) as error:
        expectation = "expected a table of `saccade extract`"
        message = f"{store.location}/{name}: {expectation}: {one_line(error)}"
        raise KeypointsError(message) from error


def write_table(
    store: Store, name: str, parts: Iterable[pa.Table | pa.RecordBatch], schema: pa.Schema
) -> None:
    """Write a Parquet file of a data set.

    Args:
        store: the data set.
        name: of the file.
        parts: of the table; many of them need not fit into memory.
        schema: of all.

    Raises:
        OutputError: it cannot be written.
    """
    with (
        store.writing(name) as path,
        path.open("wb") as file,  # Arrow accepts only paths that are text
        pq.ParquetWriter(file, schema, **parquet_options(schema)) as writer,
    ):
        for group in _grouped(parts):
            writer.write_table(group)


def _grouped(parts: Iterable[pa.Table | pa.RecordBatch]) -> Iterator[pa.Table]:
    """Tables of `ROW_GROUP` rows or more."""
    group: list[pa.Table] = []
    for part in parts:
        group.append(pa.Table.from_batches([part]) if isinstance(part, pa.RecordBatch) else part)
        if sum(map(len, group)) >= ROW_GROUP:
            yield pa.concat_tables(group)
            group.clear()
    if group:
        yield pa.concat_tables(group)


def record_files(store: Store) -> list[str]:
    """File names of the records, of every shard that of its latest generation."""
    latest: dict[str, int] = {}
    for file in store.list_files(RECORDS):
        if file.endswith(SUFFIX):
            shard, generation = split_generation(file)
            latest[shard] = max(generation, latest.get(shard, 0))
    return sorted(shard_file(name_generation(*item)) for item in latest.items())


def shard_file(name: str) -> str:
    """The file name of a shard, the same in every folder."""
    return f"{PREFIX}{name}{SUFFIX}"


def name_generation(shard: str, generation: int) -> str:
    """The name of a generation of a shard."""
    return f"{shard}-{generation}" if generation else shard


def split_generation(file: str) -> tuple[str, int]:
    """The shard and the generation of a file."""
    first, *others = file.removeprefix(PREFIX).removesuffix(SUFFIX).split("-")
    return "-".join([first, *others[:1]]), int(others[1]) if others[1:] else 0


def _row_size(schema: pa.Schema) -> int:
    """Bytes of a row, without texts and bytes of any length."""
    return sum(
        f.type.bit_width // 8
        for f in schema
        if not (pa.types.is_string(f.type) or pa.types.is_binary(f.type))
    )


FILE_FORMATS: dict[str, Callable[..., None]] = {"colmap": write_colmap, "hdf5": write_hdf5}
"""Writers of formats with one file for all images."""
FOLDER_FORMATS = {"opencv": (".yml.gz", write_opencv), "csv": (".csv", write_csv)}
"""Suffixes and writers of formats with a file for each image, in a folder."""


def export_points(location: str, to: str, out: Path) -> int:
    """Write the points of a data set in another format.

    Args:
        location: folder or URL of the data set.
        to: one of `FILE_FORMATS` or `FOLDER_FORMATS`.
        out: the file, or folder, to write.

    Returns:
        Number of images.

    Raises:
        ConfigError: the data set holds no points, or a library is not installed.
        OutputError: it cannot be written.
    """
    if to in FILE_FORMATS:
        images = {image.image: image for image in read_points(location)}
        points = {name: image.points for name, image in images.items()}
        FILE_FORMATS[to](out, points, {name: image.shape for name, image in images.items()})
        return len(images)
    suffix, write = FOLDER_FORMATS[to]
    count = 0
    for image in read_points(location):
        if ".." in Path(check_name(image.image)).parts:
            raise KeypointsError(f"{image.image}: would be written outside {out}")
        write(out / f"{image.image}{suffix}", image.points)
        count += 1
    return count
