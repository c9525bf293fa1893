"""Matches many images and reports progress, for `saccade match`."""

from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import typer

from saccade.batch.matching import FEATURES, MatchRun, match_images
from saccade.cli.batch_run import INTERRUPTED, batch_progress, local_engine, stop_on_interrupt
from saccade.cli.output import Table, emit, print_message

if TYPE_CHECKING:
    from saccade.batch.job import Job
    from saccade.batch.matching import Format, MatchConfig
    from saccade.batch.shards import ShardReport


def match_many(
    source: str,
    pairs: Path | None,
    out: Path,
    job: "Job",
    config: "MatchConfig",
    formats: Sequence[str],
    *,
    workers: int | None,
    redo: bool,
    as_json: bool,
) -> None:
    """Match many images and print the counts.

    Raises:
        Exit: an image failed, or the run was stopped.
    """
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_on_interrupt())
        watch = _Watch(stack)
        run = match_images(
            source,
            out,
            pairs=pairs,
            job=job,
            config=config,
            formats=cast("Sequence[Format]", formats),
            engine=partial(local_engine, workers=workers),
            redo=redo,
            should_stop=stopped,
            on_report=watch,
        )
    row = _as_row(run)
    names = {"done": "pairs matched now", "already_done": "pairs matched before"}
    facts = [(names.get(name, name.replace("_", " ")), value) for name, value in row.items()]
    shown = [(name, str(value)) for name, value in facts if not isinstance(value, bool | dict)]
    emit(row, as_json, Table(f"{source} -> {out}", ["", ""], [*shown, *row["files"].items()]))
    if not run.complete:
        total = run.done + run.unchanged
        print_message(f"stopped after {total} of {run.pairs} pairs; run it again to resume")
        raise SystemExit(INTERRUPTED)
    if run.extraction.failed:
        print_message(
            f"{run.extraction.failed} images failed, and {run.pairs - len(run.matched)} pairs are "
            f"left out; see {out / FEATURES}/errors.parquet"
        )
        raise typer.Exit(1)


class _Watch:
    """A progress bar for the images, then one for the pairs."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._bars: dict[str, Any] = {}

    def __call__(self, stage: str, total: int, report: "ShardReport") -> None:
        """Advance the bar of a stage."""
        if stage not in self._bars:
            self._bars[stage] = self._stack.enter_context(batch_progress(stage, total))
        self._bars[stage](report)


def _as_row(run: MatchRun) -> dict[str, Any]:
    counts = [
        len(each.indices) if each.verification is None else int(each.verification.inliers.sum())
        for each in run.matched
    ]
    verified = any(each.verification is not None for each in run.matched)
    row: dict[str, Any] = {
        "images": run.extraction.done + run.extraction.unchanged,
        "pairs": run.pairs,
        "done": run.done,
        "already_done": run.unchanged,
        "matches": sum(len(each.indices) for each in run.matched),
    }
    if verified:
        row |= {"verified_pairs": int(np.count_nonzero(counts)), "inliers": sum(counts)}
    return {
        **row,
        "complete": run.complete,
        "files": {name: str(path) for name, path in run.files.items()},
    }
