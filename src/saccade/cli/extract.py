"""`saccade extract`: features of many images, on one machine or a cluster."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from saccade.cli.batch_run import (
    INTERRUPTED,
    Workers,
    batch_progress,
    local_engine,
    preload,
    stop_on_interrupt,
)
from saccade.cli.options import Config, Json, Preset
from saccade.cli.output import Table, emit, print_message, resumable
from saccade.errors import ConfigError, require
from saccade.extras import import_optional
from saccade.settings import load_model, load_settings

if TYPE_CHECKING:
    from saccade.batch import Extraction
    from saccade.batch.engines import Engine
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


def extract(
    source: Annotated[
        str,
        Argument(
            metavar="SOURCE",
            help="Folder, quoted pattern, list (.txt), video, tar, or a URL of one of these.",
        ),
    ],
    what: Annotated[
        list[What] | None,
        Option(
            metavar="KIND",
            help=f"Features to extract: {', '.join(What)}; several with commas, each in a folder "
            "of its own in --out.",
            show_default="sift",
        ),
    ] = None,
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
    workers: Workers = None,
    size: Annotated[
        int | None,
        Option("--shard", min=1, metavar="N", help="Images per shard; at most 256 by default."),
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(metavar="ADDRESS", help="Address of a Dask scheduler: tcp://host:8786."),
    ] = None,
    cluster: Annotated[
        str | None,
        Option(
            metavar="SYSTEM",
            help="Batch system for Dask jobs: slurm, pbs, sge, lsf, htcondor or oar.",
        ),
    ] = None,
    jobs: Annotated[
        int,
        Option(min=1, metavar="N", help="With --cluster: number of jobs."),
    ] = 1,
) -> None:
    """Extract features of many images into a Parquet data set.

    DuckDB, Polars and pandas read it directly (docs/extract.md). The same
    command resumes an interrupted extraction, and processes images that are
    new or have changed. Images that cannot be read are listed in
    errors.parquet; the exit code is then 1.

    Ctrl-C stops after the shards in progress; pressed twice, at once.
    """
    if not (scheduler or cluster):
        preload(source, workers)
    import_optional("pyarrow", "parquet")
    from saccade.batch import Job, open_source
    from saccade.batch import extract as extract_all

    kinds = list(dict.fromkeys(what or [What.SIFT]))
    made = [
        Job(
            each.value,
            _settings(each, preset, config, model),
            fixations=fixations,
            exact=exact,
            maps=maps.value,
        )
        for each in kinds
    ]
    folders = [out] if len(kinds) == 1 else [f"{out}/{each.value}" for each in kinds]
    images = open_source(source, every)
    results: dict[str, Extraction] = {}
    with ExitStack() as stack:
        engine = stack.enter_context(_engine(images, workers, scheduler, cluster, jobs))
        stopped = stack.enter_context(stop_on_interrupt())
        for job, folder in zip(made, folders, strict=True):
            with (
                resumable(Path(folder) / "manifest.json"),
                batch_progress("images", len(images)) as watch,
            ):
                results[folder] = extract_all(
                    images,
                    job,
                    folder,
                    engine,
                    source_name=source,
                    shard_size=size,
                    redo=redo,
                    should_stop=stopped,
                    on_report=watch,
                )
            if stopped():
                break
    rows = [_as_row(result, folder) for folder, result in results.items()]
    tables = [
        _table(result, kind.value, folder)
        for kind, (folder, result) in zip(kinds, results.items(), strict=False)
    ]
    emit(rows[0] if len(kinds) == 1 else {"data_sets": rows}, as_json, *tables)
    codes = [_tell(result, folder, len(images)) for folder, result in results.items()]
    raise typer.Exit(max(codes, default=0))


def _tell(result: "Extraction", out: str, images: int) -> int:
    """Print what is wrong with a data set; returns the exit code."""
    others = result.totals.by_other_versions
    if others:
        print_message(
            f"{others} images were processed by another version; --redo processes them again"
        )
    if not result.complete:
        done = result.done + result.unchanged + result.failed
        print_message(f"stopped after {done} of {images} images; run it again to resume")
        return INTERRUPTED
    if result.totals.errors:
        print_message(f"{result.totals.errors} of {images} images failed; see {out}/errors.parquet")
        return 1
    return 0


def _settings(what: What, preset: str | None, config: Path | None, model: Path | None) -> Any:
    if model is None:
        return load_settings(KINDS.get(what, what.value), preset, config)
    require(what in KINDS, "model", "--what saliency or scanpath", what.value)
    given = preset or config
    require(given is None, "model", "no --preset and --config with a fitted model", given)
    return load_model(model)


@contextmanager
def _engine(
    images: "Source", workers: int | None, scheduler: str | None, cluster: str | None, jobs: int
) -> Iterator["Engine"]:
    from saccade.batch.engines import connect, submit_jobs

    if scheduler is not None and cluster is not None:
        raise ConfigError("cluster: expected --scheduler or --cluster, found both")
    if scheduler is not None or cluster is not None:
        if cluster is not None:
            count = f"{jobs} {'job' if jobs == 1 else 'jobs'}"
            print_message(f"submitting {count} to {cluster}; waiting for the first")
        where = connect(scheduler) if scheduler else submit_jobs(str(cluster), jobs)
        with where as engine:
            yield engine
        return
    yield local_engine(images, workers)


def _as_row(result: "Extraction", out: str) -> dict[str, Any]:
    return {
        "out": out,
        "done": result.done,
        "already_done": result.unchanged,
        "failed": result.failed,
        **asdict(result.totals),
        "complete": result.complete,
    }


def _table(result: "Extraction", what: str, out: str) -> Table:
    totals = result.totals
    return Table(
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
