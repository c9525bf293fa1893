"""Runs of a study: computed in several processes, and stored so that the study can be resumed."""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar

import cv2

from saccade.errors import ConfigError
from saccade.io.files import atomic_write, read_text, reason_of, written_at_once

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_in_processes(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> list[Result]:
    """The result of each item, in their order.

    Args:
        work: what is done with one; it can be pickled.
        items: the items.
        jobs: number of processes; with several, each has a single OpenCV thread.
        progress: called with the items done and their number.
    """
    results = []
    with ExitStack() as stack:
        mapped: Any = map
        if jobs > 1:
            one_thread = partial(cv2.setNumThreads, 1)  # in each child process alone
            pool = ProcessPoolExecutor(jobs, get_context("spawn"), one_thread)
            mapped = stack.enter_context(pool).map
        for result in mapped(work, items):
            results.append(result)
            if progress is not None:
                progress(len(results), len(items))
    return results


def write_run(path: Path, row: dict[str, Any]) -> None:
    """Store a run as JSON, whole or not at all."""
    with written_at_once(), atomic_write(path) as temporary:
        temporary.write_text(json.dumps(row, indent=2) + "\n", encoding="utf-8")


def read_run(
    path: Path,
    expected: dict[str, Any],
    scores: Sequence[str],
    series: dict[str, int] | None = None,
) -> dict[str, Any]:
    """A stored run, which has to match.

    Args:
        path: its file.
        expected: values that it has.
        scores: names of its numbers, which may be null.
        series: lengths of its lists, by name.

    Raises:
        ConfigError: it cannot be read, or does not match.
    """
    try:
        content: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}; delete it") from error
    row: dict[str, Any] = content if isinstance(content, dict) else {}
    scored = all(isinstance(row.get(name, ""), (float, int, NoneType)) for name in scores)
    for name, length in (series or {}).items():
        values = row.get(name)
        scored = scored and isinstance(values, list) and len(values) == length
    if not scored or any(row.get(name) != value for name, value in expected.items()):
        raise ConfigError(f"{path}: expected a run with its scores, found none; delete it")
    return row
