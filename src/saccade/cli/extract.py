"""`saccade extract`: features of many images, on one machine or a cluster."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.options import Config, Json, Preset

if TYPE_CHECKING:
    from saccade.batch import Extraction
    from saccade.batch.engines import Engine
    from saccade.batch.shards import ShardReport
    from saccade.batch.sources import Source


class What(StrEnum):
    """Features that can be extracted."""

    SIFT = "sift"
    MUST = "must"
    SYMROID = "symroid"
    SALIENCY = "saliency"
    CONTRAST = "contrast"
    SYMMETRY = "symmetry"
    SCANPATH = "scanpath"


class MapFormat(StrEnum):
    """File formats of saliency maps."""

    ZARR = "zarr"
    PNG = "png"


KINDS = {What.SALIENCY: "attention", What.SCANPATH: "attention"}
"""Kinds of the configurations, where they differ from the names of the features."""
INTERRUPTED = 130
"""Exit code."""
EXECUTION = "Execution"
"""Heading of options."""


def extract(
    source: Annotated[
        str,
        Argument(
            metavar="SOURCE",
            help="Folder, quoted pattern, list (.txt), video, tar, or a URL of one of these.",
        ),
    ],
    what: Annotated[
        What, Option(metavar="KIND", help=f"Features to extract: {', '.join(What)}.")
    ] = What.SIFT,
    out: Annotated[
        str, Option("--out", "-o", metavar="DIR", help="Folder or URL of the data set.")
    ] = "saccade-extract",
    preset: Preset = None,
    config: Config = None,
    model: Annotated[
        Path | None,
        Option(metavar="FILE", help="Fitted model of saccade fit, for saliency and scanpath."),
    ] = None,
    fixations: Annotated[int, Option(min=1, metavar="N", help="Length of a scanpath.")] = 10,
    maps: Annotated[
        MapFormat, Option(help="Format of saliency maps: float16 Zarr or 16-bit PNG.")
    ] = MapFormat.ZARR,
    exact: Annotated[
        bool, Option("--exact", help="Store keypoints without rounding, in a third more space.")
    ] = False,
    every: Annotated[int, Option(min=1, metavar="N", help="Use every Nth frame of a video.")] = 1,
    redo: Annotated[
        bool, Option("--redo", help="Replace results of other settings or another version.")
    ] = False,
    as_json: Json = False,
    workers: Annotated[
        int | None,
        Option(
            min=1,
            metavar="N",
            help="Number of processes; by default as cores and memory allow.",
            rich_help_panel=EXECUTION,
        ),
    ] = None,
    size: Annotated[
        int | None,
        Option(
            "--shard",
            min=1,
            metavar="N",
            help="Images per shard; at most 256 by default.",
            rich_help_panel=EXECUTION,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(
            metavar="ADDRESS",
            help="Address of a Dask scheduler: tcp://host:8786.",
            rich_help_panel=EXECUTION,
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        Option(
            metavar="SYSTEM",
            help="Batch system for Dask jobs: slurm, pbs, sge, lsf, htcondor or oar.",
            rich_help_panel=EXECUTION,
        ),
    ] = None,
    jobs: Annotated[
        int,
        Option(
            min=1, metavar="N", help="With --cluster: number of jobs.", rich_help_panel=EXECUTION
        ),
    ] = 1,
) -> None:
    """Extract features of many images into a Parquet data set.

    DuckDB, Polars and pandas read it directly (docs/extract.md). The same
    command resumes an interrupted extraction, and processes images that are
    new or have changed. Images that cannot be read are listed in
    errors.parquet; the exit code is then 1.

    Ctrl-C stops after the shards in progress; pressed twice, at once.
    """
    from saccade.extras import import_optional

    if not (scheduler or cluster):
        _preload(source, workers)
    import_optional("pyarrow", "parquet")
    from saccade.batch import Job, open_source
    from saccade.batch import extract as extract_all
    from saccade.cli.output import print_json, print_message, resumable

    job = Job(
        what.value,
        _settings(what, preset, config, model),
        fixations=fixations,
        exact=exact,
        maps=maps.value,
    )
    images = open_source(source, every)
    with resumable(Path(out) / "manifest.json"), ExitStack() as stack:
        engine = stack.enter_context(_engine(images, workers, scheduler, cluster, jobs))
        stopped = stack.enter_context(_stop_on_interrupt())
        watch = stack.enter_context(_progress(len(images)))
        result = extract_all(
            images,
            job,
            out,
            engine,
            source_name=source,
            shard_size=size,
            redo=redo,
            should_stop=stopped,
            on_report=watch,
        )
    if as_json:
        print_json(_as_row(result, out))
    else:
        _print(result, what.value, out)
    if result.error is not None:
        print_message(result.error)
    others = result.totals.by_other_versions
    if others:
        print_message(
            f"{others} images were processed by another version; --redo processes them again"
        )
    if not result.complete:
        done = result.done + result.unchanged + result.failed
        print_message(f"stopped after {done} of {len(images)} images; run it again to resume")
        raise SystemExit(INTERRUPTED)
    if result.totals.errors:
        print_message(
            f"{result.totals.errors} of {len(images)} images failed; see {out}/errors.parquet"
        )
        raise typer.Exit(1)


def _settings(what: What, preset: str | None, config: Path | None, model: Path | None) -> Any:
    from saccade.errors import require
    from saccade.settings import load_model, load_settings

    if model is None:
        return load_settings(KINDS.get(what, what.value), preset, config)
    require(what in KINDS, "model", "--what saliency or scanpath", what.value)
    given = preset or config
    require(given is None, "model", "no --preset and --config with a fitted model", given)
    return load_model(model)


def _preload(source: str, workers: int | None) -> None:
    """Let the workers import their libraries while this process does: both take a second."""
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
            count = f"{jobs} {'job' if jobs == 1 else 'jobs'}"
            print_message(f"submitting {count} to {cluster}; waiting for the first")
        where = connect(scheduler) if scheduler else submit_jobs(str(cluster), jobs)
        with where as engine:
            yield engine
        return
    if workers is None:
        from saccade.batch.workers import count_workers

        workers = count_workers(images)
    yield Processes(workers) if workers > 1 else InProcess()


@contextmanager
def _stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed; pressed again, it raises KeyboardInterrupt."""
    from threading import Event

    from saccade.cli.output import print_message

    pressed = Event()

    def stop(*_: Any) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, previous)
        print_message("stopping after the shards in progress; press Ctrl-C again to stop at once")

    previous = signal.signal(signal.SIGINT, stop)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, previous)


@contextmanager
def _progress(total: int) -> Iterator[Callable[["ShardReport"], None]]:
    """A progress bar with time left, speed and errors; what was done before does not count."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    text = TextColumn("{task.fields[text]}")
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), text)
    hidden = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        task = bar.add_task("", total=total, text="")
        done = errors = 0

        def watch(report: "ShardReport") -> None:
            nonlocal done, errors
            processed = report.done + len(report.lost)
            done += processed + report.unchanged
            errors += report.failed + len(report.lost)
            if processed:
                speed = bar.tasks[0].speed
                parts = [f"{speed:.1f} images/s"] if speed else []
                parts += [f"{errors:,} errors"] if errors else []
                bar.update(task, completed=done, text="  ".join(parts))
            else:  # the speed is that of the images processed from here on
                bar.reset(task, completed=done)

        yield watch


def _as_row(result: "Extraction", out: str) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "out": out,
        "done": result.done,
        "already_done": result.unchanged,
        "failed": result.failed,
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
            ("images done before", f"{result.unchanged:,}"),
            ("images in total", f"{totals.images:,}"),
            ("rows in total", f"{totals.rows:,}"),
            ("errors", f"{totals.errors:,}"),
            ("shards", f"{totals.shards:,}"),
        ],
    )
