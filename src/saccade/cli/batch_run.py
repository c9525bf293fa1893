"""Workers and progress of commands that process many images."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from saccade.cli.output import progress_bar

if TYPE_CHECKING:
    from saccade.batch.engines import Engine, ShardReport
    from saccade.batch.sources import Source


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
