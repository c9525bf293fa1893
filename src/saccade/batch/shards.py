"""Extracts one shard: some images in, a Parquet table or maps and its record out.

A shard is done when its record exists, which is written last. An interrupted shard leaves at most a
table without a record, which the next run removes. Images that are done again make a new generation
of the shard beside the old one, so that a record never describes a table that it was not written
for.
"""

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from saccade import keypoints
from saccade.batch import tables
from saccade.batch.dataset import RECORDS, read_record, read_table, shard_file
from saccade.batch.job import MAPS, POINTS, Job
from saccade.batch.sources import Item, Store, content_hash, decode, open_store, read_content
from saccade.batch.tables import RECORD_SCHEMA, parquet_options, record_batch, text_array
from saccade.errors import KeypointsError, OutputError, SaccadeError
from saccade.extras import import_optional
from saccade.io.files import LARGEST_IMAGE, one_line
from saccade.io.image import decode_stored, size_in_header
from saccade.types import Float32Array, Image, Keypoints, Regions

FOLDER = "maps"
PNG_MAXIMUM = 65535
"""Pixel of a PNG that stands for 1."""

AddMap: TypeAlias = Callable[[str, Float32Array], tuple[str, str]]
"""Writes the map of an image, by its name; gives the file and the array in it, "" for a PNG."""


@contextmanager
def map_writer(job: Job, store: Store, shard: str) -> Iterator[AddMap]:
    """A function that writes the maps of a shard; it must not be called where a job has none.

    Raises:
        OutputError: they cannot be written.
        ConfigError: zarr is asked for and not installed.
    """
    if job.what not in MAPS:
        yield _no_map
    elif job.maps == "png":
        yield partial(_write_png, store, shard)
    else:
        zarr = import_optional("zarr", "zarr")
        file = f"{FOLDER}/part-{shard}.zarr.zip"
        with store.writing(file) as path, _archive(zarr, path, "w") as archive:
            group = zarr.create_group(archive)

            def add(name: str, values: Float32Array) -> tuple[str, str]:
                group.create_array(name, data=values.astype(np.float16), chunks=values.shape)
                return file, name

            yield add


def read_map(store: Store, row: pa.Table) -> Float32Array:
    """The map of a row of the table, (h, w) in [0, 1].

    Raises:
        KeypointsError: it is missing, broken, or of another shape than in the row.
        ConfigError: zarr is needed and not installed.
    """
    names = ("file", "array", "rows", "columns")
    file, array, *shape = (row[name][0].as_py() for name in names)
    try:
        return _read_array(store, file, array, tuple(shape))
    except (SaccadeError, MemoryError):
        raise
    except Exception as error:  # zarr raises anything for a broken file
        message = f"{store.location}/{file}: expected a map: {one_line(error)}"
        raise KeypointsError(message) from error


def _read_array(store: Store, file: str, array: str, shape: tuple[int, ...]) -> Float32Array:
    with store.open(file) as opened:
        if not array:
            data = opened.read()
            _check_shape(size_in_header(data, file)[::-1], shape)
            pixels = decode_stored(data, f"{store.location}/{file}")
            _check_shape(pixels.shape, shape)
            return (np.asarray(pixels) / np.float32(PNG_MAXIMUM)).astype(np.float32)
        zarr = import_optional("zarr", "zarr")
        with tempfile.NamedTemporaryFile(suffix=".zip") as copy:
            shutil.copyfileobj(opened, copy)
            copy.flush()
            with _archive(zarr, Path(copy.name), "r") as archive:
                values = zarr.open_group(archive, mode="r")[array]
                _check_shape(values.shape, shape)
                return np.asarray(values[...], np.float32)


def _check_shape(found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Check a shape before the array is unpacked: a small file may hold a large one."""
    if found != expected or prod(expected) > LARGEST_IMAGE:
        raise ValueError(f"expected {expected} values, found {found}")


@contextmanager
def _archive(zarr: Any, path: Path, mode: str) -> Iterator[Any]:
    """A Zarr store in one file; a folder of many small files would be slow."""
    archive = zarr.storage.ZipStore(path, mode=mode)
    try:
        yield archive
    finally:
        archive.close()


def _write_png(store: Store, shard: str, name: str, values: Float32Array) -> tuple[str, str]:
    file = f"{FOLDER}/part-{shard}/{name}.png"
    encoded, packed = cv2.imencode(".png", np.rint(values * PNG_MAXIMUM).astype(np.uint16))
    if not encoded:
        raise OutputError(f"{store.location}/{file}: cannot be written as PNG")
    with store.writing(file) as path:
        path.write_bytes(packed.tobytes())
    return file, ""


def _no_map(name: str, values: Float32Array) -> tuple[str, str]:
    raise AssertionError(name)


ROW_GROUP = 1 << 16
"""Rows that are written together; as points they take 10 MB."""

Row: TypeAlias = dict[str, Any]
"""A row of a record."""
AddImage: TypeAlias = Callable[[str, pa.Table, Float32Array | None], None]
"""Adds the rows of an image, by its name, and its map to the files of a shard."""


class Shard(NamedTuple):
    """Images that share a file."""

    name: str
    """Made of the names of its images, and of the generation."""
    items: Sequence[Item]
    previous: str | None = None
    """Record of the previous generation, if there is one."""


class ImageResult(NamedTuple):
    """Features of an image."""

    rows: pa.RecordBatch
    """Rows of the table."""
    map: Float32Array | None = None
    """(h, w) in [0, 1], if the job is for maps."""


class ShardReport(NamedTuple):
    """Counts of a shard that was processed."""

    done: int = 0
    """Images processed."""
    unchanged: int = 0
    """Images done before."""
    rows: int = 0
    """Rows added to the table."""
    failed: int = 0
    """Images with an error in the record, of those processed and those kept."""
    failed_now: int = 0
    """Failed images among those processed."""
    lost: Sequence[tuple[str, str]] = ()
    """Images whose results could not be written, and why."""


def extract_shard(job: Job, location: str, shard: Shard, redo: bool = False) -> ShardReport:
    """Process the images of a shard that are not done; runs in any process on any machine.

    Args:
        job: what to extract.
        location: of the store.
        shard: the images.
        redo: whether to redo what another version or configuration made.
    """
    store = open_store(location)
    previous = read_record(store, shard.previous).to_pylist() if shard.previous else []
    kept = kept_rows(job, previous, shard, redo)
    todo = [item for item in shard.items if item.name not in kept]
    failed = sum(row["error"] is not None for row in kept.values())
    if not todo and len(kept) == len(previous):
        return ShardReport(unchanged=len(kept), failed=failed)
    try:
        added = _write_shard(job, store, shard, kept, todo)
    except OutputError as error:
        return ShardReport(unchanged=len(kept), lost=[(item.name, str(error)) for item in todo])
    failed_now = sum(row["error"] is not None for row in added)
    rows = sum(row["rows"] for row in added)
    return ShardReport(len(todo), len(kept), rows, failed + failed_now, failed_now)


def kept_rows(job: Job, record: Sequence[Row], shard: Shard, redo: bool) -> dict[str, Row]:
    """The rows of the previous record that are still valid, by image.

    Each gets a `first`, the index of its first row in the table. Kept are images that have not
    changed, and images that are no longer in the source unless they had failed.
    """
    items = {item.name: item for item in shard.items}
    first, kept = 0, {}
    for row in record:
        valid = row["configuration"] == job.fingerprint
        if valid and not (redo and row["version"] != job.version):
            item = items.get(row["image"])
            if row["error"] is None if item is None else _is_unchanged(item, row["content"]):
                kept[row["image"]] = {**row, "first": first}
        first += row["rows"]
    return kept


def _is_unchanged(item: Item, recorded_hash: str | None) -> bool:
    if recorded_hash is None:
        return False
    try:
        return content_hash(read_content(item)) == recorded_hash
    except SaccadeError:
        return True


def _write_shard(
    job: Job, store: Store, shard: Shard, kept: Mapping[str, Row], todo: Sequence[Item]
) -> list[Row]:
    """Write the table and the record of a shard; gives the new rows of the record."""
    added = []
    with _table_writer(job, store, shard) as add:
        if kept:
            table = read_table(store, f"{job.what}/{shard.previous}", schema_of(job))
            for name, row in kept.items():
                rows = table.slice(row["first"], row["rows"])
                has_map = job.what in MAPS and len(rows)
                add(name, rows, read_map(store, rows) if has_map else None)
        for item in todo:
            row, result = _extract_image(job, item)
            if result is not None:
                add(item.name, pa.Table.from_batches([result.rows]), result.map)
            added.append(row)
    record = pa.Table.from_batches([record_batch([*kept.values(), *added], RECORD_SCHEMA)])
    with store.writing(f"{RECORDS}/{shard_file(shard.name)}") as path, path.open("wb") as file:
        pq.write_table(record, file, **parquet_options(RECORD_SCHEMA))
    return added


def _extract_image(job: Job, item: Item) -> tuple[Row, ImageResult | None]:
    """The row of the record of an image, and its result unless it failed."""
    row: Row = {"image": item.name, "rows": 0, "error": None}
    row |= {"configuration": job.fingerprint, "version": job.version}
    analyze = analyzer(job)  # outside of `try`: a missing library is no error of the image
    try:
        content = read_content(item)
        row["content"] = content_hash(content)
        start = time.perf_counter()
        image = decode(content, item.name)
        result = analyze(item.name, image)
    except (SaccadeError, MemoryError) as error:
        return {**row, "error": str(error) or "not enough memory"}, None
    except Exception as error:  # one image must not end the work on a million
        return {**row, "error": f"{type(error).__name__}: {error}"}, None
    row["seconds"] = time.perf_counter() - start
    row["height"], row["width"] = image.shape[:2]
    return {**row, "rows": result.rows.num_rows}, result


@contextmanager
def _table_writer(job: Job, store: Store, shard: Shard) -> Iterator[AddImage]:
    """A function that adds the rows of an image, and its map, to the files of a shard."""
    schema = schema_of(job)
    buffered: list[pa.Table] = []
    with (
        map_writer(job, store, shard.name) as add_map,
        store.writing(f"{job.what}/{shard_file(shard.name)}") as path,
        path.open("wb") as file,  # Arrow accepts only paths that are text
        pq.ParquetWriter(file, schema, **parquet_options(schema)) as writer,
    ):

        def flush() -> None:
            if buffered:
                writer.write_table(pa.concat_tables(buffered))
                buffered.clear()

        def add(name: str, rows: pa.Table, values: Float32Array | None) -> None:
            if values is not None:
                for field, text in zip(("file", "array"), add_map(name, values), strict=True):
                    rows = rows.set_column(schema.get_field_index(field), field, text_array([text]))
            buffered.append(rows)
            if sum(map(len, buffered)) >= ROW_GROUP:
                flush()

        yield add
        flush()


@lru_cache(maxsize=1)
def analyzer(job: Job) -> Callable[[str, Image], ImageResult]:
    """A function from the name and pixels of an image to the result; detectors keep their memory.

    Args:
        job: what to extract.
    """
    if job.what in POINTS:
        detect = _detector(job)
        return lambda name, image: ImageResult(
            tables.point_table(name, detect(image), exact=job.exact)
        )
    if job.what in MAPS:
        model = _saliency_model(job)

        def extract_map(name: str, image: Image) -> ImageResult:
            saliency = model(image, job.settings).saliency
            values = saliency.astype(np.float16).astype(np.float32)  # as it is stored
            return ImageResult(tables.map_row(name, values, image.shape), values)

        return extract_map

    def extract_scanpath(name: str, image: Image) -> ImageResult:
        from saccade import attention

        saliency = _saliency_model(job)(image, job.settings).saliency
        path = attention.scanpath(saliency, image.shape, job.fixations, job.network)
        return ImageResult(tables.fixation_table(name, path))

    return extract_scanpath


def schema_of(job: Job) -> pa.Schema:
    """The columns of the table of a job."""
    if job.what in POINTS:
        return tables.point_schema(boxes=job.what == "symroid")
    return tables.MAP_SCHEMA if job.what in MAPS else tables.FIXATION_SCHEMA


def _detector(job: Job) -> Callable[[Image], Keypoints | Regions]:
    if job.what == "sift":
        return keypoints.Sift(job.settings, threads=1)
    if job.what == "must":
        return keypoints.Must(job.settings, threads=1)
    return keypoints.SymRoid(job.settings, threads=1)


def _saliency_model(job: Job) -> Callable[[Image, Any], Any]:
    from saccade import attention

    if isinstance(job.settings, attention.FittedModel):
        return lambda image, model: model.maps(image)
    if job.what == "contrast":
        return attention.contrast_saliency
    if job.what == "symmetry":
        return attention.symmetry_saliency
    return attention.attention_saliency
