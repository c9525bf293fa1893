"""Extracts features from all images of a source into a data set, and writes its manifest."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from itertools import takewhile
from typing import Any

from saccade.batch.dataset import (
    MANIFEST,
    RECORDS,
    name_generation,
    read_manifest,
    read_record,
    read_records,
    read_table,
    record_files,
    split_generation,
    write_table,
)
from saccade.batch.engines import Engine, Shard, ShardReport
from saccade.batch.job import MAPS, Job
from saccade.batch.shards import extract_shard
from saccade.batch.sources import Item, Source, Store, open_store
from saccade.batch.tables import ERROR_SCHEMA, MAP_SCHEMA, record_batch
from saccade.errors import ConfigError
from saccade.io.files import FORMATS

ERROR_FILE = "errors.parquet"
MAX_SHARD_SIZE = 256
"""Images in a shard: minutes of work, and a file of about 30 MB."""
MIN_SHARD_SIZE = 4
"""Images in a shard of a small job: a file costs as much as a tenth of an image."""
MIN_SHARDS = 32
"""Into which a small job is cut if it has enough images, so that all workers have work."""


@dataclass(frozen=True)
class Totals:
    """Counts of a data set."""

    images: int = 0
    """Images in the table, including those without a row."""
    rows: int = 0
    """Rows of the table."""
    errors: int = 0
    """Images that failed."""
    shards: int = 0
    """Files of the table."""
    by_other_versions: int = 0
    """Images that another version of this package did."""


@dataclass(frozen=True)
class Extraction:
    """Results of a run."""

    done: int
    """Images processed, without those that failed."""
    unchanged: int
    """Images done before, likewise."""
    failed: int
    """Images that failed, now or before."""
    totals: Totals
    """Totals of the data set."""
    complete: bool
    """Whether all images of the source were processed; false if the run was stopped."""


def extract(
    source: Source,
    job: Job,
    out: str,
    engine: Engine,
    *,
    source_name: str | None = None,
    shard_size: int | None = None,
    redo: bool = False,
    should_stop: Callable[[], bool] = lambda: False,
    on_report: Callable[[ShardReport], None] = lambda report: None,
) -> Extraction:
    """Run a job on all images of a source that are not done.

    Args:
        source: the images.
        job: what to extract from each.
        out: folder or URL of the data set; of one job only.
        engine: runs the shards.
        source_name: for the manifest.
        shard_size: images in a shard; None to choose it so that every worker has work.
        redo: whether to redo what another version or configuration made.
        should_stop: called before every shard; true ends the run after the shards that have begun.
        on_report: called with the report of every shard.

    Returns:
        Counts of this run, and totals of the data set as in its manifest.

    Raises:
        ConfigError: the data set was made with another configuration, or another run writes to it.
        OutputError: it cannot be written.
    """
    store = open_store(out)
    done = unchanged = failed = 0
    lost: list[tuple[str, str]] = []
    with store.locked():
        if not redo:
            _check_manifest(store, job)
        remove_orphans(store, job)
        _write_manifest(store, job, source_name, _last_totals(store), complete=False)
        work = partial(extract_shard, job, out, redo=redo)
        shards = plan_shards(source, store, shard_size)
        for report in engine.run(work, takewhile(lambda _: not should_stop(), shards)):
            done += report.done
            unchanged += report.unchanged
            failed += report.failed
            lost.extend(report.lost)
            on_report(report)
        complete = not should_stop()
        remove_orphans(store, job)
        totals = _write_errors(store, job, lost)
        _write_manifest(store, job, source_name, totals, complete=complete)
    return Extraction(done, unchanged, failed + len(lost), totals, complete)


def plan_shards(source: Source, store: Store, shard_size: int | None = None) -> Iterator[Shard]:
    """First the recorded shards, whose images may have changed, then the new ones.

    A recorded shard is planned as its next generation, of the images that the source still has. A
    new shard is a block of the source without the images that are done, so that after any
    interruption the same images make the same shard.

    Args:
        source: the images.
        store: of the results.
        shard_size: images in a shard; None to choose it.
    """
    if shard_size is None:
        shard_size = min(max(len(source) // MIN_SHARDS, MIN_SHARD_SIZE), MAX_SHARD_SIZE)
    item_of = {item.name: item for item in source}
    done: set[str] = set()
    for file in record_files(store):
        names = read_record(store, file, ["image"])["image"].to_pylist()
        done.update(names)
        shard, generation = split_generation(file)
        items = [item_of[name] for name in names if name in item_of]
        yield Shard(name_generation(shard, generation + 1), items, [file])
    for first in range(0, len(source), shard_size):
        items = [item for item in source[first : first + shard_size] if item.name not in done]
        if items:
            yield Shard(_name_shard(first, items), items)


def remove_orphans(store: Store, job: Job) -> None:
    """Remove tables that an interrupted run left without a record, and older generations."""
    recorded = record_files(store)
    for file in store.list_files(RECORDS):
        if file not in recorded:
            store.remove(f"{RECORDS}/{file}")
    orphans = [file for file in store.list_files(job.what) if file not in recorded]
    if job.what in MAPS and orphans:
        for map_file in _map_files(store, job, orphans) - _map_files(store, job, recorded):
            store.remove(map_file)
    for file in orphans:
        store.remove(f"{job.what}/{file}")


def _map_files(store: Store, job: Job, files: Sequence[str]) -> set[str]:
    """The files of the maps in these tables."""
    tables = (read_table(store, f"{job.what}/{file}", MAP_SCHEMA, ["file"]) for file in files)
    return {name for table in tables for name in table["file"].to_pylist()}


def _name_shard(first: int, items: list[Item]) -> str:
    """The number of the first image, and a hash of the names of all."""
    names = "\n".join(item.name for item in items)
    return f"{first:09d}-{hashlib.blake2b(names.encode(), digest_size=4).hexdigest()}"


def _check_manifest(store: Store, job: Job) -> None:
    """Check that a data set was made with the configuration of a job.

    Raises:
        ConfigError: it was not; says what differs.
    """
    manifest = read_manifest(store)
    if manifest is None:
        return
    requested = _flatten(json.loads(json.dumps(job.describe())))
    recorded = _flatten(manifest["configuration"])
    for name in dict.fromkeys([*recorded, *requested]):
        if requested.get(name) != recorded.get(name):
            raise ConfigError(
                f"{store.location}: made with {name} = {recorded.get(name)!r}, now "
                f"{requested.get(name)!r}; take another --out, or --redo to do all anew"
            )


def _last_totals(store: Store) -> Totals:
    """Totals of the last run that was completed."""
    manifest = read_manifest(store) or {}
    return Totals(*(manifest.get(field.name, 0) for field in fields(Totals)))


def _write_manifest(
    store: Store, job: Job, source: str | None, totals: Totals, *, complete: bool
) -> None:
    """Write the manifest, which describes the job, its source and its progress."""
    manifest = {
        "format": FORMATS["extraction"],
        "saccade": job.version,
        "what": job.what,
        "configuration": job.describe(),
        "fingerprint": job.fingerprint,
        "source": source,
        "complete": complete,
        **asdict(totals),
    }
    with store.writing(MANIFEST) as path:
        path.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")


def _write_errors(store: Store, job: Job, lost: Sequence[tuple[str, str]]) -> Totals:
    """Collect the failed images in one file, if there are any, and count all images.

    Args:
        store: with the records of every shard.
        job: whose version is this one.
        lost: images whose results could not be written, and why.
    """
    records = list(read_records(store))
    failed = [{"image": name, "error": reason} for name, reason in lost]
    for record in records:
        failed += record.filter(record["error"].is_valid()).select(ERROR_SCHEMA.names).to_pylist()
    if failed:
        write_table(store, ERROR_FILE, [record_batch(failed, ERROR_SCHEMA)], ERROR_SCHEMA)
    else:
        store.remove(ERROR_FILE)
    return Totals(
        images=sum(record["error"].null_count for record in records),
        rows=sum(sum(record["rows"].to_pylist()) for record in records),
        errors=len(failed),
        shards=len(records),
        by_other_versions=sum(
            version != job.version
            for record in records
            for version in record["version"].to_pylist()
        ),
    )


def _flatten(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their dotted names."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            flat |= _flatten(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat
