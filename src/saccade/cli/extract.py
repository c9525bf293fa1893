"""`saccade extract`: features of many images, on one machine or on a cluster."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from saccade.cli.options import Json, Preset, Settings

if TYPE_CHECKING:
    from saccade.batch import Extraction
    from saccade.batch.engines import Engine
    from saccade.batch.shards import ShardReport
    from saccade.batch.sources import Source


class What(StrEnum):
    """What is extracted."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"
    SALIENCY = "saliency"
    CONTRAST = "contrast"
    SYMMETRY = "symmetry"
    SCANPATH = "scanpath"


class MapFormat(StrEnum):
    """Files that maps are written to."""

    ZARR = "zarr"
    PNG = "png"


KINDS = {What.SALIENCY: "attention", What.SCANPATH: "attention"}
"""Of the configuration, as `saccade config` calls it, where that is another name."""
INTERRUPTED = 130
WHERE = "Where the work is done"
"""Heading of options."""


def extract(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A folder, a quoted pattern, a list (.txt), a video, a tar, or a URL of them.",
        ),
    ],
    what: Annotated[
        What,
        typer.Option(metavar="KIND", help=f"What to extract: {', '.join(What)}."),
    ] = What.SIFT,
    out: Annotated[
        str, typer.Option("--out", "-o", metavar="DIR", help="Folder or URL for the data set.")
    ] = "saccade-extract",
    preset: Preset = None,
    config: Settings = None,
    fixations: Annotated[
        int, typer.Option(min=1, metavar="N", help="Of a scanpath: how many.")
    ] = 10,
    maps: Annotated[
        MapFormat, typer.Option(help="Files of maps: float16 Zarr, or 16-bit PNG.")
    ] = MapFormat.ZARR,
    exact: Annotated[
        bool, typer.Option("--exact", help="Keep all bits of points: a third more bytes.")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, metavar="N", help="Of a video, take one frame of N.")
    ] = 1,
    redo: Annotated[
        bool, typer.Option("--redo", help="Do anew what other settings or another version made.")
    ] = False,
    as_json: Json = False,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Processes; the default suits cores and memory.",
            rich_help_panel=WHERE,
        ),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option(
            "--shard",
            min=1,
            metavar="N",
            help="Images to a file; up to 256 by default.",
            rich_help_panel=WHERE,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="A Dask cluster: tcp://host:8786.", rich_help_panel=WHERE
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="SYSTEM",
            help="Jobs of a batch system, through Dask: slurm, pbs, sge, lsf, htcondor or oar.",
            rich_help_panel=WHERE,
        ),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            min=1, metavar="N", help="With --cluster: how many jobs.", rich_help_panel=WHERE
        ),
    ] = 1,
) -> None:
    """Extract features of many images into a Parquet data set.

    DuckDB, Polars and pandas open it as it is (docs/extract.md). The same command
    given again goes on where it was cut off, and does images that are new or have
    changed. What cannot be read is listed in errors.parquet; exit code 1 then.

    Ctrl-C lets the shards that have begun finish; pressed twice it ends at once.
    """
    from saccade.extras import import_optional

    if not (scheduler or cluster):
        _begin_loading(source, workers)
    import_optional("pyarrow", "parquet")
    from saccade.batch import Job, open_source
    from saccade.batch import extract as extract_all
    from saccade.cli.output import print_json, print_message, resumable
    from saccade.settings import load_settings

    job = Job(
        what.value,
        load_settings(KINDS.get(what, what.value), preset, config),
        fixations=fixations,
        exact=exact,
        maps=maps.value,
    )
    images = open_source(source, every)
    with resumable(Path(out) / "manifest.json"), ExitStack() as stack:
        engine = stack.enter_context(_engine(images, workers, scheduler, cluster, jobs))
        stopped = stack.enter_context(_stopping())
        watch = stack.enter_context(_watching(len(images)))
        result = extract_all(
            images,
            job,
            out,
            engine,
            source_name=source,
            shard_size=size,
            redo=redo,
            should_stop=lambda: bool(stopped),
            on_report=watch,
        )
    row = _row(result, out)
    if as_json:
        print_json(row)
    else:
        _print(result, what.value, out)
    if result.error is not None:
        print_message(result.error)
    others = result.totals.by_other_versions
    if others:
        print_message(f"{others} images were done by another version; --redo does them anew")
    if not result.complete:
        seen = result.done + result.unchanged
        print_message(
            f"stopped after {seen} of {len(images)} images; give the same command to go on"
        )
        raise SystemExit(INTERRUPTED)
    if result.totals.errors:
        print_message(
            f"{result.totals.errors} of {len(images)} images failed; see {out}/errors.parquet"
        )
        raise typer.Exit(1)


def _begin_loading(source: str, workers: int | None) -> None:
    """Let workers load what they need while this process does: both take a second."""
    from saccade.batch.forkserver import worker_context
    from saccade.files import IMAGE_SUFFIXES

    one_image = source.lower().endswith(IMAGE_SUFFIXES) and Path(source).is_file()
    if workers != 1 and os.cpu_count() != 1 and not one_image:
        worker_context("saccade.cli")


@contextmanager
def _engine(
    images: "Source", workers: int | None, scheduler: str | None, cluster: str | None, jobs: int
) -> Iterator["Engine"]:
    from saccade.batch.engines import InProcess, Processes, connect, submit_jobs
    from saccade.errors import ConfigError

    if scheduler is not None and cluster is not None:
        raise ConfigError("cluster: expected --scheduler or --cluster, found both")
    if scheduler is not None or cluster is not None:
        from saccade.cli.output import print_message

        if cluster is not None:
            print_message(
                f"{jobs} {'job' if jobs == 1 else 'jobs'} of {cluster}: waiting for the first"
            )
        where = connect(scheduler) if scheduler else submit_jobs(str(cluster), jobs)
        with where as engine:
            yield engine
        return
    if workers is None:
        from saccade.batch.workers import count_workers

        workers = count_workers(images)
    yield Processes(workers) if workers > 1 else InProcess()


@contextmanager
def _stopping() -> Iterator[list[int]]:
    """A list that has an entry after the first Ctrl-C; the second raises KeyboardInterrupt."""
    from saccade.cli.output import print_message

    asked: list[int] = []

    def stop(number: int, _: Any) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, before)
        print_message(
            "stopping: what has begun is finished first; press Ctrl-C again to end at once"
        )

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


class Pace:
    """How fast the work goes; what had been done before passes too quickly to count.

    Args:
        total: images.
    """

    def __init__(self, total: int) -> None:
        self.seen = 0
        """Images of which a report has come."""
        self.since = time.monotonic()
        """When the first began that is done now."""
        self._total = total
        self._before = self._errors = 0

    def after(self, report: "ShardReport", now: float) -> str:
        """Images per second, time left and errors so far, when a report has come."""
        self.seen += report.done + report.unchanged + len(report.lost)
        self._errors += report.failed + len(report.lost)
        if self.seen == self._before + report.unchanged:
            self._before, self.since = self.seen, now
        rate = (self.seen - self._before) / max(now - self.since, 1e-3)
        parts = [f"{self._errors:,} errors"] if self._errors else []
        if rate > 0:
            left = timedelta(seconds=round((self._total - self.seen) / rate))
            parts = [f"{rate:.1f} images/s", f"{left} left", *parts]
        return "  ".join(parts)


@contextmanager
def _watching(total: int) -> Iterator[Any]:
    """What shows the progress: images per second, time left and errors; only on a terminal."""
    from saccade.cli.output import messages

    console = messages()
    if not console.is_terminal:
        yield lambda report: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[said]}"))
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=total, said="starting")
        pace = Pace(total)

        def watch(report: Any) -> None:
            said = pace.after(report, time.monotonic())
            progress.update(task, completed=pace.seen, said=said)

        yield watch


def _row(result: "Extraction", out: str) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "out": out,
        "done": result.done,
        "already_done": result.unchanged,
        **asdict(result.totals),
        "complete": result.complete,
    }


def _print(result: "Extraction", what: str, out: str) -> None:
    from saccade.cli.output import print_table

    totals = result.totals
    print_table(
        f"{what} -> {Path(out) if '://' not in out else out}",
        ["", ""],
        [
            ("images done now", f"{result.done:,}"),
            ("done before", f"{result.unchanged:,}"),
            ("images in all", f"{totals.images:,}"),
            ("rows in all", f"{totals.rows:,}"),
            ("errors", f"{totals.errors:,}"),
            ("files", f"{totals.shards:,}"),
        ],
    )
