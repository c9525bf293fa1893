"""Arguments, timing, memory, processes and intervals of the benchmarks."""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from importlib.resources import files
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from saccade.evaluation.intervals import mean_interval
from saccade.simulation import WorldConfig
from saccade.types import FloatArray, LandmarkLog

Item = TypeVar("Item")
Result = TypeVar("Result")

DATA = Path(str(files("saccade") / "data"))
"""Folder of the photographs and logs of the package."""
ROBOT = WorldConfig(
    course_length=60, landmarks=60, landmark_spread=6, steps=600, range_limits=(0.5, 8.0)
)
"""World of a small robot: 60 landmarks within 6 m of a course of 60 m, a reach of 8 m."""


def arguments(text: str | None, **options: Any) -> argparse.Namespace:
    """Parses the command line.

    Args:
        text: docstring of the benchmark, shown by `--help`.
        options: default value of each option by its name; or a dictionary of the arguments of
            `add_argument`, whose key `flags` replaces the name, as of a positional argument.
    """
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, given in options.items():
        words = dict(given) if isinstance(given, dict) else _option(given)
        flag = words.pop("flags", f"--{name.replace('_', '-')}")
        parser.add_argument(flag, **words)
    return parser.parse_args()


def _option(default: Any) -> dict[str, Any]:
    """Arguments of `add_argument` for an option with a default."""
    if isinstance(default, bool):
        return {"action": "store_true"}
    if isinstance(default, list):
        return {"nargs": "+", "default": default, "type": type(default[0]) if default else str}
    return {"default": default, "type": type(default)}


def require_one_thread() -> None:
    """Exits unless the linear algebra runs on one thread."""
    if os.environ.get("OMP_NUM_THREADS") != "1":
        sys.exit("expected OMP_NUM_THREADS=1 in the environment: one core is measured")


def seconds(work: Callable[[], object]) -> float:
    """Wall time of a call in seconds."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def times_in_turns(actions: Mapping[str, Callable[[], object]], rounds: int) -> FloatArray:
    """Wall times (rounds, actions) in seconds of actions that take turns, after a first call."""
    for action in actions.values():
        action()
    return np.array([[seconds(action) for action in actions.values()] for _ in range(rounds)])


def peak_bytes(*, reset: bool = False) -> int:
    """Peak of the resident memory since the last reset; Linux only."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024


def in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Iterable[Result]:
    """The result of each item in their order; with several processes, each has one thread."""
    if jobs == 1:
        yield from map(work, items)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), partial(cv2.setNumThreads, 1)) as pool:
        yield from pool.map(work, items)


def geometric_mean(logarithms: FloatArray) -> FloatArray:
    """(3,) geometric mean and ends of its 95 % bootstrap interval, of (n,) natural logarithms."""
    (low,), (high,) = mean_interval(logarithms[:, None], seed=0)
    return np.exp([logarithms.mean(), low, high])


def with_interval(values: Sequence[float], form: str = ".2f") -> str:
    """A value with its interval, as text."""
    mean, low, high = (f"{value:{form}}" for value in values)
    return f"{mean} [{low} {high}]"


def without_labels(log: LandmarkLog) -> LandmarkLog:
    """The log with unlabeled observations."""
    return replace(log, landmark=np.full_like(log.landmark, -1))


def resized(image: FloatArray, size: tuple[int, int]) -> FloatArray:
    """An image at a width and height, averaged where it shrinks."""
    smaller = size[0] < image.shape[1]
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
