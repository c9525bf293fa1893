"""Extracts features from all images of a source into a data set."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from saccade.batch.engines import Engine
from saccade.batch.job import Job
from saccade.batch.manifest import (
    Totals,
    check_manifest,
    last_totals,
    write_errors,
    write_manifest,
)
from saccade.batch.planning import plan_shards, remove_orphans
from saccade.batch.shards import Shard, ShardReport, extract_shard
from saccade.batch.sources import Source
from saccade.batch.store import open_store
from saccade.errors import OutputError


@dataclass(frozen=True)
class Extraction:
    """Results of a run."""

    done: int
    """Images processed."""
    unchanged: int
    """Images done before."""
    totals: Totals
    """Of the data set."""
    complete: bool
    """Whether all images of the source were processed; false if the run was stopped."""
    error: str | None = None
    """Why the manifest could not be written; None if it was."""


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
        ConfigError: the data set was made with another configuration.
        OutputError: it cannot be written, or another run writes to it.
    """
    store = open_store(out)
    done = unchanged = 0
    lost: list[tuple[str, str]] = []
    error = None
    with store.locked():
        if not redo:
            check_manifest(store, job)
        remove_orphans(store, job)
        shards = plan_shards(source, store, shard_size)
        write_manifest(store, job, source_name, last_totals(store), complete=False)
        work = partial(extract_shard, job, out, redo=redo)
        for report in engine.run(work, _until(should_stop, shards)):
            done += report.done
            unchanged += report.unchanged
            lost.extend(report.lost)
            on_report(report)
        complete = not should_stop()
        try:
            remove_orphans(store, job)
            totals = write_errors(store, job, lost)
            write_manifest(store, job, source_name, totals, complete=complete)
        except OutputError as failure:
            totals, error = Totals(errors=len(lost)), str(failure)
    return Extraction(done, unchanged, totals, complete, error)


def _until(should_stop: Callable[[], bool], shards: Iterator[Shard]) -> Iterator[Shard]:
    for shard in shards:
        if should_stop():
            return
        yield shard
