"""Many images in, one table out: what `saccade extract` does."""

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
from saccade.batch.planning import Plan, remove_orphans
from saccade.batch.shards import Shard, ShardReport, extract_shard
from saccade.batch.sources import Source
from saccade.batch.store import open_store
from saccade.errors import OutputError


@dataclass(frozen=True)
class Extraction:
    """What a run did."""

    done: int
    """Images that were worked on."""
    same: int
    """Images that had been done before."""
    totals: Totals
    """Of all runs."""
    complete: bool
    """Whether every image of the source was looked at; not if it was stopped."""
    problem: str | None = None
    """What could not even be recorded."""


def extract(
    source: Source,
    job: Job,
    out: str,
    engine: Engine,
    *,
    name: str = "",
    size: int | None = None,
    redo: bool = False,
    stopped: Callable[[], bool] = lambda: False,
    watch: Callable[[ShardReport], None] = lambda report: None,
) -> Extraction:
    """Do a job on all images of a source that are not yet done.

    Args:
        source: the images.
        job: what to do with each.
        out: folder or URL of the results; of one job only.
        engine: what does the work.
        name: of the source, for the manifest.
        size: images to a shard; None for as many as give every worker enough of them.
        redo: whether what another version or configuration made is made anew.
        stopped: asked before every shard; true ends the run after those that have begun.
        watch: told what came of every shard.

    Returns:
        What was done; the manifest says the same of all runs.

    Raises:
        ConfigError: the folder holds what another configuration made.
        OutputError: it cannot be written to, or another run writes to it.
    """
    store = open_store(out)
    done = same = 0
    lost: list[tuple[str, str]] = []
    problem = None
    with store.locked():
        check_manifest(store, job, redo=redo)
        remove_orphans(store, job)
        plan = Plan.of(source, store, size)
        write_manifest(store, job, name, last_totals(store), complete=False)
        work = partial(extract_shard, job, out, redo=redo)
        for report in engine.run(work, _until(stopped, plan.shards(store))):
            done += report.done
            same += report.unchanged
            lost.extend(report.lost)
            watch(report)
        complete = not stopped()
        try:
            remove_orphans(store, job)
            totals = write_errors(store, job, lost)
            write_manifest(store, job, name, totals, complete=complete)
        except OutputError as error:
            totals, problem = Totals(errors=len(lost)), str(error)
    return Extraction(done, same, totals, complete, problem)


def _until(stopped: Callable[[], bool], shards: Iterator[Shard]) -> Iterator[Shard]:
    for shard in shards:
        if stopped():
            return
        yield shard
