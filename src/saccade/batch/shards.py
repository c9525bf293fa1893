"""Extracts one shard: some images in, a Parquet table or maps and its record out.

A shard is done when its record exists, which is written last. An interrupted shard leaves at most a
table without a record, which the next run removes. Images that are done again make a new generation
of the shard beside the old one, so that a record never describes a table that it was not written
for; the rows and the maps of the images that have not changed are kept.
"""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import lru_cache, partial
from itertools import chain
from typing import Any, TypeAlias

import cv2
import numpy as np
import pyarrow as pa
from pyarrow import compute

from saccade import keypoints
from saccade.batch import tables
from saccade.batch.dataset import RECORDS, read_record, read_table, shard_file, write_table
from saccade.batch.engines import Shard, ShardReport
from saccade.batch.job import MAPS, POINTS, Job
from saccade.batch.sources import Item, Store, content_hash, decode, open_store, read_content
from saccade.batch.tables import RECORD_SCHEMA, record_batch
from saccade.errors import OutputError, SaccadeError
from saccade.extras import import_optional
from saccade.types import Float32Array, Image

FOLDER = "maps"
PNG_MAXIMUM = 65535
"""Pixel of a PNG that stands for 1."""

AddMap: TypeAlias = Callable[[str, Float32Array], tuple[str, str]]
"""Writes the map of an image, by its name; gives the file and the array in it, "" for a PNG."""


@contextmanager
def map_writer(job: Job, store: Store, shard: str) -> Iterator[AddMap]:
    """A function that writes the maps of a shard: all to one Zarr archive, or each as a PNG.

    Raises:
        OutputError: they cannot be written.
        ConfigError: zarr is asked for and not installed.
    """
    if job.what not in MAPS or job.maps == "png":
        yield partial(_write_png, store, shard)
        return
    zarr = import_optional("zarr", "zarr")
    file = f"{FOLDER}/part-{shard}.zarr.zip"
    with store.writing(file) as path, closing(zarr.storage.ZipStore(path, mode="w")) as archive:
        group = zarr.create_group(archive)

        def add(name: str, values: Float32Array) -> tuple[str, str]:
            group.create_array(name, data=values.astype(np.float16), chunks=values.shape)
            return file, name

        yield add


def _write_png(store: Store, shard: str, name: str, values: Float32Array) -> tuple[str, str]:
    file = f"{FOLDER}/part-{shard}/{name}.png"
    encoded, packed = cv2.imencode(".png", np.rint(values * PNG_MAXIMUM).astype(np.uint16))
    if not encoded:
        raise OutputError(f"{store.location}/{file}: cannot be written as PNG")
    with store.writing(file) as path:
        path.write_bytes(packed.tobytes())
    return file, ""


Row: TypeAlias = dict[str, Any]
"""A row of a record."""


def extract_shard(job: Job, location: str, shard: Shard, redo: bool = False) -> ShardReport:
    """Process the images of a shard that are not done; runs in any process on any machine.

    Args:
        job: what to extract.
        location: of the store.
        shard: the images.
        redo: whether to redo what another version or configuration made.
    """
    store = open_store(location)
    record = [row for file in shard.inputs for row in read_record(store, file).to_pylist()]
    rows = kept_rows(job, record, shard, redo)
    names, failed = {row["image"] for row in rows}, _count_failed(rows)
    todo, kept = [item for item in shard.items if item.name not in names], len(rows)
    report = ShardReport(unchanged=kept - failed, failed=failed)
    if not todo and kept == len(record):
        return report
    file = shard_file(shard.name)
    try:
        with map_writer(job, store, shard.name) as add_map:
            added = chain(
                _kept_features(job, store, shard, names), _new_features(job, todo, rows, add_map)
            )
            write_table(store, f"{job.what}/{file}", added, schema_of(job))
        write_table(store, f"{RECORDS}/{file}", [record_batch(rows, RECORD_SCHEMA)], RECORD_SCHEMA)
    except OutputError as error:
        return report._replace(lost=ShardReport.of_lost(todo, str(error)).lost)
    failed_now = _count_failed(rows[kept:])
    return report._replace(done=len(todo) - failed_now, failed=failed + failed_now)


def kept_rows(job: Job, record: Sequence[Row], shard: Shard, redo: bool) -> list[Row]:
    """The rows of the previous record that are still valid.

    Kept are images that have not changed, and images that are no longer in the source unless they
    had failed.
    """
    items = {item.name: item for item in shard.items}

    def is_valid(row: Row) -> bool:
        if row["configuration"] != job.fingerprint or (redo and row["version"] != job.version):
            return False
        item = items.get(row["image"])
        return row["error"] is None if item is None else _is_unchanged(item, row["content"])

    return [row for row in record if is_valid(row)]


def _is_unchanged(item: Item, recorded_hash: str | None) -> bool:
    if recorded_hash is None:
        return False
    try:
        return content_hash(read_content(item)) == recorded_hash
    except SaccadeError:
        return True


def _count_failed(rows: Sequence[Row]) -> int:
    return sum(row["error"] is not None for row in rows)


def _kept_features(
    job: Job, store: Store, shard: Shard, names: Collection[str]
) -> Iterator[pa.Table]:
    """The rows of these images in the table of the previous generation; their maps stay."""
    for file in shard.inputs:
        table = read_table(store, f"{job.what}/{file}", schema_of(job))
        yield table.filter(compute.is_in(table["image"], tables.column(list(names), pa.string())))


def _new_features(
    job: Job, items: Sequence[Item], record: list[Row], add_map: AddMap
) -> Iterator[pa.RecordBatch]:
    """The rows of the table for each image that does not fail; appends all images to the record."""
    for item in items:
        row, found = _extract_image(job, item)
        record.append(row)
        if found is None:
            continue
        if job.what in POINTS:
            batch = tables.point_rows(item.name, found, exact=job.exact)
        elif job.what in MAPS:
            shape = row["height"], row["width"]
            batch = tables.map_row(item.name, found, shape, *add_map(item.name, found))
        else:
            batch = tables.fixation_rows(item.name, found)
        row["rows"] = batch.num_rows
        yield batch


def _extract_image(job: Job, item: Item) -> tuple[Row, Any]:
    """The row of the record of an image, and its features; None if it failed."""
    row: Row = {"image": item.name, "rows": 0, "error": None}
    row |= {"configuration": job.fingerprint, "version": job.version}
    analyze = analyzer(job)  # outside of `try`: a missing library is no error of the image
    try:
        content = read_content(item)
        row["content"] = content_hash(content)
        start = time.perf_counter()
        image = decode(content, item.name)
        found = analyze(image)
    except (SaccadeError, MemoryError) as error:
        return {**row, "error": str(error) or "not enough memory"}, None
    except Exception as error:  # one image must not end the work on a million
        return {**row, "error": f"{type(error).__name__}: {error}"}, None
    height, width = image.shape[:2]
    seconds = time.perf_counter() - start
    return {**row, "seconds": seconds, "height": height, "width": width}, found


@lru_cache(maxsize=1)
def analyzer(job: Job) -> Callable[[Image], Any]:
    """A function from an image to its features; detectors keep their memory.

    The features are `Keypoints`, `Regions`, a `Scanpath`, or a map (h, w) as it is stored.

    Args:
        job: what to extract.
    """
    if job.what in POINTS:
        detectors: dict[str, Any]
        detectors = {"sift": keypoints.Sift, "must": keypoints.Must, "symroid": keypoints.SymRoid}
        detector: Callable[[Image], Any] = detectors[job.what](job.settings, threads=1)
        return detector
    from saccade.attention import scanpath
    from saccade.attention.models import AttentionModel

    model = AttentionModel(job.settings)
    if job.what in MAPS:
        return lambda image: model.maps(image).saliency.astype(np.float16).astype(np.float32)
    return lambda image: scanpath(model.maps(image), job.network, fixations=job.fixations)


def schema_of(job: Job) -> pa.Schema:
    """The columns of the table of a job."""
    if job.what in POINTS:
        return tables.point_schema(boxes=job.what == "symroid")
    return tables.MAP_SCHEMA if job.what in MAPS else tables.FIXATION_SCHEMA
