"""`saccade extract`: features of many images, on one machine or a cluster."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from cyclopts import Parameter

from saccade.cli.model_options import DEFAULT_MODEL
from saccade.cli.options import (
    EXECUTION,
    INPUT,
    OUTPUT,
    JsonOptions,
    SettingsOptions,
)
from saccade.cli.output import (
    INTERRUPTED,
    Result,
    facts_table,
    print_message,
    progress_bar,
    stop_on_interrupt,
)
from saccade.errors import require, setting
from saccade.extras import import_optional
from saccade.keypoints.detectors import DEFAULT_DETECTOR

MAX_REASONS = 10
"""Largest number of failed images whose reasons are printed."""


@dataclass(frozen=True, kw_only=True)
class ExtractOptions(SettingsOptions, JsonOptions):
    """Options of `saccade extract`."""

    what: Annotated[str, Parameter(metavar="NAME")] = DEFAULT_DETECTOR
    """Features to extract: a detector (see saccade detect), a saliency model (see saccade look),
    scanpath, or module:function of your own."""
    out: Annotated[str, OUTPUT, Parameter(("--out", "-o"), metavar="DIR")] = "saccade-extract"
    """Folder or URL of the data set."""
    model: Path | None = None
    """Fitted model of saccade fit, for saliency and scanpath."""
    length: int = setting(10, 1)
    """Length of a scanpath."""
    every: Annotated[int, INPUT, Parameter(metavar="N")] = setting(1, 1)
    """Use every Nth frame of a video."""
    anonymous: Annotated[bool, INPUT] = False
    """Read a public bucket without credentials."""
    root: Annotated[str | None, INPUT, Parameter(metavar="DIR")] = None
    """Folder from which the paths in a list of images start; by default that of the list."""
    stretch: Annotated[bool, INPUT] = False
    """Stretch the contrast of each image to its .5 and 99.5 percentiles, as for thermal images of
    16 bits."""
    masks: Annotated[Path | None, INPUT, Parameter(metavar="DIR")] = None
    """Folder of masks for keypoints, named as COLMAP's: DIR/NAME.png for the image NAME, black
    where no keypoint is wanted."""
    workers: Annotated[int | None, EXECUTION] = setting(None, 1)
    """Number of processes; by default as many as cores and memory allow."""
    scheduler: Annotated[str | None, EXECUTION, Parameter(metavar="ADDRESS")] = None
    """Address of a Dask scheduler: tcp://host:8786."""

    def settings_of(self, what: str) -> Any:
        """The configuration of a kind of features, or the fitted model; None for a function."""
        from saccade.batch.job import ATTENTION, Job

        by_attention = what in ATTENTION
        if self.model is not None:
            require(by_attention, "model", f"--what {' or '.join(ATTENTION)}", what)
            return self.fitted_model(self.model)
        if not by_attention and Job(what).is_own:
            given = self.preset or self.config
            require(given is None, "what", "no --preset and --config with a function", given)
            return None
        return self.settings("attention" if by_attention else what)


Source: TypeAlias = Annotated[
    str, Parameter(help="Folder, quoted pattern, list (.txt), video, or a URL of one of these.")
]


def extract(source: Source, /, options: ExtractOptions = ExtractOptions()) -> Result:
    """Extract features of many images into a Parquet data set.

    DuckDB, Polars and pandas read it directly (docs/extract.md). Repeating the
    command resumes an interrupted extraction and processes new or changed
    images. images.parquet lists unreadable images with the reason; the exit code
    is then 1.

    Ctrl-C stops after the images in progress; a second Ctrl-C stops at once.

    Example: saccade extract photos --what sift --out features
    """
    import_optional("pyarrow", "parquet")
    from saccade.batch import Job, open_source
    from saccade.batch import extract as extract_all
    from saccade.batch.job import SALIENCY
    from saccade.batch.storage import ANONYMOUS
    from saccade.workers import count_workers

    out, what = options.out, options.what
    what = SALIENCY if what == DEFAULT_MODEL else what
    settings = options.settings_of(what)
    masks = None if options.masks is None else str(options.masks)
    job = Job(what, settings, fixations=options.length, stretch=options.stretch, masks=masks)
    if options.anonymous:
        source = source.replace("://", f"://{ANONYMOUS}", 1)
    images = open_source(source, options.every, root=options.root, without=out)
    with ExitStack() as stack:
        result = extract_all(
            images,
            job,
            out,
            workers=options.workers or count_workers(len(images)),
            scheduler=options.scheduler,
            should_stop=stack.enter_context(stop_on_interrupt()),
            on_progress=stack.enter_context(batch_progress("images")),
        )
    code, failed = 0, len(result.failed)
    if not result.complete:
        done, code = result.done + result.unchanged + failed, INTERRUPTED
        print_message(f"stopped after {done} of {len(images)} images; run it again to resume")
    elif failed:
        code = 1
        print_message(f"{failed} of {len(images)} images failed; see {out}/images.parquet")
        print_failures(result.failed)
    row = {
        "out": out,
        "done": result.done,
        "already_done": result.unchanged,
        "failed": failed,
        "images": result.images,
        "rows": result.rows,
        "complete": result.complete,
    }
    title = f"{what} -> {Path(out) if '://' not in out else out}"
    return Result(row, [facts_table(title, row)], code)


def print_failures(failed: Mapping[str, str]) -> None:
    """Print the reasons of the first failed images."""
    for name, reason in [*failed.items()][:MAX_REASONS]:
        print_message(reason if name in reason else f"{name}: {reason}")
    if len(failed) > MAX_REASONS:
        print_message(f"... and {len(failed) - MAX_REASONS} more")


@contextmanager
def batch_progress(what: str) -> Iterator[Callable[[int, int, int], None]]:
    """A progress bar; yields a function of the numbers of items done, failed and in total."""
    with progress_bar(what) as update:

        def show(done: int, failed: int, total: int) -> None:
            update(done + failed, total, f"{failed:,} errors" if failed else "")

        yield show
