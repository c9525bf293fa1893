"""`saccade extract`: features of many images, on one machine or a cluster."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

from saccade.cli.options import EXECUTION, INPUT, OUTPUT, JsonOptions, Options, SettingsOptions
from saccade.cli.output import (
    INTERRUPTED,
    Result,
    facts_table,
    print_message,
    progress_bar,
    resumable,
    stop_on_interrupt,
)
from saccade.errors import require, setting
from saccade.extras import import_optional
from saccade.settings import load_model

if TYPE_CHECKING:
    from saccade.batch.engines import Engine, ShardReport
    from saccade.batch.sources import Source


What: TypeAlias = Literal["sift", "must", "symroid", "saliency", "contrast", "symmetry", "scanpath"]
"""Features that can be extracted."""
KINDS = {"saliency": "attention", "scanpath": "attention"}
"""Kinds of the configurations, where they differ from the names of the features."""


@dataclass(frozen=True)
class SourceArgument(Options):
    """Many images."""

    source: str
    """Folder, quoted pattern, list (.txt), video, tar, or a URL of one of these."""


@dataclass(frozen=True, kw_only=True)
class ExtractOptions(SettingsOptions, JsonOptions, SourceArgument):
    """Options of `saccade extract`."""

    what: What = "sift"
    """Features to extract."""
    out: Annotated[str, OUTPUT, Parameter(("--out", "-o"), metavar="DIR")] = "saccade-extract"
    """Folder or URL of the data set."""
    model: Path | None = None
    """Fitted model of saccade fit, for saliency and scanpath."""
    fixations: int = setting(10, 1)
    """Length of a scanpath."""
    maps: Annotated[Literal["zarr", "png"], OUTPUT] = "zarr"
    """Format of saliency maps: float16 Zarr or 16-bit PNG."""
    exact: Annotated[bool, OUTPUT] = False
    """Store keypoints without rounding, in a third more space."""
    every: Annotated[int, INPUT, Parameter(metavar="N")] = setting(1, 1)
    """Use every Nth frame of a video."""
    redo: Annotated[bool, EXECUTION] = False
    """Replace results of other settings or another version."""
    workers: Annotated[int | None, EXECUTION] = setting(None, 1)
    """Number of processes; by default as cores and memory allow."""
    size: Annotated[int | None, EXECUTION, Parameter("--shard")] = setting(None, 1)
    """Images per shard; at most 256 by default."""
    scheduler: Annotated[str | None, EXECUTION, Parameter(metavar="ADDRESS")] = None
    """Address of a Dask scheduler: tcp://host:8786."""

    def settings_of(self, what: What) -> Any:
        """The configuration of a kind of features, or the fitted model."""
        if self.model is None:
            return self.settings(KINDS.get(what, what))
        require(what in KINDS, "model", "--what saliency or scanpath", what)
        given = self.preset or self.config
        require(given is None, "model", "no --preset and --config with a fitted model", given)
        return load_model(self.model)


def extract(options: ExtractOptions) -> Result:
    """Extract features of many images into a Parquet data set.

    DuckDB, Polars and pandas read it directly (docs/extract.md). The same
    command resumes an interrupted extraction, and processes images that are
    new or have changed. Images that cannot be read are listed in
    errors.parquet; the exit code is then 1.

    Ctrl-C stops after the shards in progress; pressed twice, at once.

    Example: saccade extract photos --what sift --out features
    """
    if options.scheduler is None:
        preload(options.source, options.workers)
    import_optional("pyarrow", "parquet")
    from saccade.batch import Job, open_source
    from saccade.batch import extract as extract_all
    from saccade.batch.engines import connect

    out, what = options.out, options.what
    job = Job(
        what,
        options.settings_of(what),
        fixations=options.fixations,
        exact=options.exact,
        maps=options.maps,
    )
    images = open_source(options.source, options.every)
    with ExitStack() as stack:
        engine: Engine = (
            local_engine(images, options.workers)
            if options.scheduler is None
            else stack.enter_context(connect(options.scheduler))
        )
        stack.enter_context(resumable(Path(out) / "manifest.json"))
        result = extract_all(
            images,
            job,
            out,
            engine,
            source_name=options.source,
            shard_size=options.size,
            redo=options.redo,
            should_stop=stack.enter_context(stop_on_interrupt()),
            on_report=stack.enter_context(batch_progress("images", len(images))),
        )
    totals, code = result.totals, 0
    if totals.by_other_versions:
        print_message(
            f"{totals.by_other_versions} images were processed by another version; --redo "
            "processes them again"
        )
    if not result.complete:
        done, code = result.done + result.unchanged + result.failed, INTERRUPTED
        print_message(f"stopped after {done} of {len(images)} images; run it again to resume")
    elif totals.errors:
        code = 1
        print_message(f"{totals.errors} of {len(images)} images failed; see {out}/errors.parquet")
    row = {
        "out": out,
        "done": result.done,
        "already_done": result.unchanged,
        "failed": result.failed,
        **asdict(totals),
        "complete": result.complete,
    }
    title = f"{what} -> {Path(out) if '://' not in out else out}"
    return Result(row, [facts_table(title, row)], code)


def preload(source: str, workers: int | None) -> None:
    """Let the workers import their libraries while this process does: both take a second."""
    from saccade.batch.engines import worker_context
    from saccade.io.files import IMAGE_SUFFIXES

    one_image = source.lower().endswith(IMAGE_SUFFIXES) and Path(source).is_file()
    if workers != 1 and os.cpu_count() != 1 and not one_image:
        worker_context("saccade.cli")


def local_engine(images: "Source", workers: int | None) -> "Engine":
    """Processes on this machine, or this one alone."""
    from saccade.batch.engines import InProcess, Processes, count_workers

    count = count_workers(images) if workers is None else workers
    return Processes(count) if count > 1 else InProcess()


@contextmanager
def batch_progress(what: str, total: int) -> Iterator[Callable[["ShardReport"], None]]:
    """A progress bar with speed, in which what was done before does not count, and errors.

    Args:
        what: "images" or "pairs".
        total: their number.
    """
    done = new = errors = 0
    start = monotonic()
    with progress_bar(what, total) as update:

        def watch(report: "ShardReport") -> None:
            nonlocal done, new, errors
            failed = report.failed + len(report.lost)
            done += report.done + report.unchanged + failed
            new += report.done + failed
            errors += failed
            parts = [f"{new / (monotonic() - start):.1f} {what}/s"] if new else []
            parts += [f"{errors:,} errors"] if errors else []
            update(done, total, "  ".join(parts))

        yield watch
