"""One shard of the work: some images in, a Parquet file and its record out.

A shard counts as done when its record is there, which is written last. One that was
interrupted before leaves at most a table without a record: the next run takes it away.
What is done anew of a shard makes another one beside it, a generation younger, so that at no
moment a record tells of a table that it was not written for.
"""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from saccade.batch.analysis import Product, analysis, schema_of
from saccade.batch.job import MAPS, Job
from saccade.batch.maps import read_map, writing_maps
from saccade.batch.reading import decoded, digest_of, read_content
from saccade.batch.sources import Item
from saccade.batch.store import Store, open_store
from saccade.batch.tables import RECORD, batch_of, check_columns, parquet_options, texts
from saccade.errors import KeypointsError, OutputError, SaccadeError
from saccade.files import one_line
from saccade.npz import check_unpacked

PREFIX, SUFFIX = "part-", ".parquet"
RECORDS = "images"
"""Folder of the records, a row for every image."""
ROWS_AT_ONCE = 1 << 16
"""That are packed together: of points they take 10 MB."""


class Shard(NamedTuple):
    """Images that share a file."""

    name: str
    """It follows from the names of its images, and from the generation."""
    items: Sequence[Item]
    before: str | None = None
    """The record of the generation before, if there is one."""

    @property
    def file(self) -> str:
        """What it is called in every folder."""
        return f"{PREFIX}{self.name}{SUFFIX}"


class ShardReport(NamedTuple):
    """What came of a shard."""

    done: int = 0
    """Images that were worked on."""
    unchanged: int = 0
    """Images that had been done before."""
    rows: int = 0
    """Of the table that were made."""
    failed: int = 0
    """Images with an error in the record."""
    lost: Sequence[tuple[str, str]] = ()
    """Images whose results could not be written, and why."""


def extract_shard(job: Job, place: str, shard: Shard, redo: bool = False) -> ShardReport:
    """Do what is not yet done of a shard; in any process on any machine.

    Args:
        job: what to do.
        place: of the store.
        shard: the images.
        redo: whether what another version or configuration made is made anew.
    """
    store = open_store(place)
    before = read_record(store, shard.before).to_pylist() if shard.before else []
    kept = kept_records(job, before, shard, redo)
    todo = [item for item in shard.items if item.name not in kept]
    failed = sum(row["error"] is not None for row in kept.values())
    if not todo and len(kept) == len(before):
        return ShardReport(unchanged=len(kept), failed=failed)
    try:
        made = _write(job, store, shard, kept, todo)
    except OutputError as error:
        return ShardReport(unchanged=len(kept), lost=[(item.name, str(error)) for item in todo])
    failed += sum(row["error"] is not None for row in made)
    return ShardReport(len(todo), len(kept), sum(row["rows"] for row in made), failed)


def read_rows(
    store: Store, name: str, schema: pa.Schema, columns: Sequence[str] | None = None
) -> pa.Table:
    """What is in a Parquet file; Arrow's own `read_table` would load pandas.

    Args:
        store: where it is.
        name: of the file.
        schema: what it was written with.
        columns: those that are wanted; all unless told otherwise.

    Raises:
        KeypointsError: it is missing, broken, or something else.
    """
    names = columns or schema.names
    wanted = pa.schema([schema.field(each) for each in names])
    try:
        with store.open(name) as opened, pq.ParquetFile(opened) as file:
            size = opened.seek(0, os.SEEK_END)
            check_unpacked(size, file.metadata.num_rows * _bytes_of(wanted))
            table = file.read(names)
            check_columns(table, wanted)
            return table
    except (pa.ArrowException, OSError, ValueError) as error:
        message = f"{store.place}/{name}: expected a table of `saccade extract`: {one_line(error)}"
        raise KeypointsError(message) from error


def read_record(store: Store, file: str, columns: Sequence[str] | None = None) -> pa.Table:
    """The record of a shard."""
    return read_rows(store, f"{RECORDS}/{file}", RECORD, columns)


def _bytes_of(schema: pa.Schema) -> int:
    """Of a row, at least."""
    wide = [each.type for each in schema if not pa.types.is_string(each.type)]
    return sum(each.bit_width // 8 for each in wide)


def kept_records(
    job: Job, before: Sequence[dict[str, Any]], shard: Shard, redo: bool
) -> dict[str, dict[str, Any]]:
    """The rows of a record that still hold, by image, each with the `first` of its rows.

    Those are of images that have not changed, and of images that can no longer be seen: unless
    all that is known of them is an error.
    """
    items = {item.name: item for item in shard.items}
    first, kept, configuration = 0, {}, job.fingerprint
    for row in before:
        name, valid = row["image"], row["configuration"] == configuration
        if valid and not (redo and row["version"] != job.version):
            item = items.get(name)
            if row["error"] is None if item is None else _unchanged(item, row["content"]):
                kept[name] = {**row, "first": first}
        first += row["rows"]
    return kept


def _unchanged(item: Item, content: str | None) -> bool:
    if content is None:
        return False
    try:
        return digest_of(read_content(item)) == content
    except SaccadeError:
        return True


def _write(
    job: Job,
    store: Store,
    shard: Shard,
    kept: Mapping[str, dict[str, Any]],
    todo: Sequence[Item],
) -> list[dict[str, Any]]:
    """Write the table and the record of a shard; gives the rows of what was done now."""
    with _writing(job, store, shard) as write:
        if kept:
            table = read_rows(store, f"{job.what}/{shard.before}", schema_of(job))
            maps = store if job.what in MAPS else None
            for name, row in kept.items():
                rows = table.slice(row["first"], row["rows"])
                write(name, rows, read_map(maps, rows) if maps and row["rows"] else None)
        made = []
        for item in todo:
            row, product = _one(job, item)
            if product is not None:
                write(item.name, pa.Table.from_batches([product.rows]), product.map)
            made.append(row)
    records = [{name: row[name] for name in RECORD.names} for row in [*kept.values(), *made]]
    rows = pa.Table.from_batches([batch_of(records, RECORD)])
    with store.writing(f"{RECORDS}/{shard.file}") as path, path.open("wb") as file:
        pq.write_table(rows, file, **parquet_options(RECORD))
    return made


def _one(job: Job, item: Item) -> tuple[dict[str, Any], Product | None]:
    """The row of the record of one image, and what was made of it."""
    row: dict[str, Any] = dict.fromkeys(RECORD.names)
    row |= {"image": item.name, "rows": 0}
    row |= {"configuration": job.fingerprint, "version": job.version}
    analyze = analysis(job)  # what the machine lacks is no error of an image
    try:
        content = read_content(item)
        row["content"] = digest_of(content)
        start = time.perf_counter()
        image = decoded(content, item.name)
        product = analyze(item.name, image)
    except (SaccadeError, MemoryError) as error:
        return {**row, "error": str(error) or "not enough memory"}, None
    except Exception as error:  # one image must not end the work on a million
        return {**row, "error": f"{type(error).__name__}: {error}"}, None
    row["seconds"] = time.perf_counter() - start
    row["height"], row["width"] = image.shape[:2]
    return {**row, "rows": product.rows.num_rows}, product


@contextmanager
def _writing(job: Job, store: Store, shard: Shard) -> Iterator[Any]:
    """A function that adds the rows of an image, and its map, to the files of a shard."""
    schema = schema_of(job)
    waiting: list[pa.Table] = []
    with (
        writing_maps(job, store, shard.name) as add_map,
        store.writing(f"{job.what}/{shard.file}") as path,
        path.open("wb") as file,  # Arrow takes no path that is not text
        pq.ParquetWriter(file, schema, **parquet_options(schema)) as writer,
    ):

        def flush() -> None:
            if waiting:
                writer.write_table(pa.concat_tables(waiting))
                waiting.clear()

        def write(name: str, rows: pa.Table, values: Any) -> None:
            if values is not None:
                file, array = add_map(name, values)
                rows = rows.set_column(1, "file", texts([file]))
                rows = rows.set_column(2, "array", texts([array]))
            waiting.append(rows)
            if sum(map(len, waiting)) >= ROWS_AT_ONCE:
                flush()

        yield write
        flush()
