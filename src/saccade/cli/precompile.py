"""Compiles in another process meanwhile: Numba compiles one function at a time in each."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

TIMEOUT = 180
"""Seconds after which the other process is ended; the rest is compiled when it is called."""


@contextmanager
def filter_compiled_ahead(also: str = "") -> Iterator[Callable[[], None]]:
    """Compile half of the filter in another process, if it is not in the cache.

    Args:
        also: what that process compiles before, see `TASKS`.

    Yields:
        A function that compiles the other half and waits for the process.
    """
    from saccade.slam._step_kernels import take_steps
    from saccade.slam.compiling import compile_half

    with _compiled_ahead(take_steps, *also.split(), "filter") as wait:

        def finish() -> None:
            if wait is not None:
                compile_half(0)
                wait()

        yield finish


@contextmanager
def points_compiled_ahead() -> Iterator[None]:
    """Compile SIFT in another process, if it is not in the cache."""
    from saccade.keypoints._refinement_kernels import fit_extrema

    with _compiled_ahead(fit_extrema, "points"):
        yield


@contextmanager
def _compiled_ahead(kernel: Callable[..., Any], *tasks: str) -> Iterator[Callable[[], None] | None]:
    """Run tasks in another process if a kernel is to be compiled; yields what waits for it."""
    from saccade._jit import needs_compiling

    command = [sys.executable, "-c", f"import {__name__} as a; a.run_tasks()", *tasks]
    if (os.cpu_count() or 1) < 2 or not sys.executable or not needs_compiling(kernel):
        yield None
        return
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as process:

        def wait() -> None:
            try:
                process.wait(TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()

        try:
            yield wait
        finally:
            process.kill()


def compile_filter() -> None:
    """Compile half of the filter."""
    from saccade.slam.compiling import compile_half

    compile_half(1)


def compile_points() -> None:
    """Compile SIFT: detect points of a small image."""
    import numpy as np

    from saccade.keypoints import Sift, SiftConfig

    Sift(SiftConfig(max_keypoints=10, spread=True))(
        np.random.default_rng(0).random((64, 64), np.float32)
    )


TASKS = {"filter": compile_filter, "points": compile_points}
"""What another process can compile."""


def run_tasks() -> None:
    """Run the tasks in `sys.argv`."""
    for name in sys.argv[1:]:
        TASKS[name]()
