"""Workers and progress of commands that process many images."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

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
    """A progress bar with time left, speed and errors; what was done before does not count.

    Args:
        what: "images" or "pairs".
        total: their number.
    """
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
            failed = report.failed + len(report.lost)
            done += report.done + report.unchanged + failed
            errors += failed
            if report.done or report.lost:
                speed = bar.tasks[0].speed
                parts = [f"{speed:.1f} {what}/s"] if speed else []
                parts += [f"{errors:,} errors"] if errors else []
                bar.update(task, completed=done, text="  ".join(parts))
            else:  # the speed is that of the images processed from here on
                bar.reset(task, completed=done)

        yield watch
