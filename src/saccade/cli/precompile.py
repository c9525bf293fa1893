"""Compiles the filter in another process: Numba compiles one function at a time in each."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

TIMEOUT = 180
"""Seconds after which the other process is ended; the rest is compiled when it is called."""


@contextmanager
def filter_compiled_ahead(log: Path) -> Iterator[Callable[[], None]]:
    """Compile the filter in another process in the meantime, if it is not in the cache.

    Args:
        log: log of Victoria Park, with which that process runs the filter.

    Yields:
        A function that waits for the process.
    """
    from saccade._jit import needs_compiling
    from saccade.slam._step_kernels import take_steps

    command = [sys.executable, "-c", f"import {__name__} as a; a.run_filter()", str(log)]
    if (os.cpu_count() or 1) < 2 or not sys.executable or not needs_compiling(take_steps):
        yield lambda: None
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


def run_filter() -> None:
    """Run the filter over the first poses of the log in `sys.argv`, which compiles it."""
    from saccade import datasets, slam

    def stop(done: int, _: int) -> None:
        if done > 0:
            sys.exit()

    slam.run(datasets.load("victoria-park", Path(sys.argv[1])), slam.EkfConfig(), stop)
