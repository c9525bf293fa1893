"""Compiling ahead in another process: Numba compiles one function at a time in each."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

TIMEOUT = 180
"""Seconds that are waited for the other process; what it has not compiled is compiled here."""


@contextmanager
def filter_compiled_ahead(log: Path) -> Iterator[Callable[[], None]]:
    """Let another process compile the filter meanwhile, where that was never done.

    Args:
        log: of Victoria Park, which that process filters.

    Yields:
        What waits until it is done.
    """
    from saccade._jit import needs_compiling
    from saccade.slam._log_kernels import replay

    words = [sys.executable, "-c", f"import {__name__} as a; a.run_filter()", str(log)]
    if (os.cpu_count() or 1) < 2 or not sys.executable or not needs_compiling(replay):
        yield lambda: None
        return
    quiet = subprocess.DEVNULL
    with subprocess.Popen(words, stdin=quiet, stdout=quiet, stderr=quiet) as process:

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
    """Begin to filter the log that the command line names, and thereby compile the filter."""
    from saccade import datasets, slam

    def stop(done: int, _: int) -> None:
        if done > 0:
            sys.exit()

    slam.run(datasets.load("victoria-park", Path(sys.argv[1])), slam.EkfConfig(), stop)
