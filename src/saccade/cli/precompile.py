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
    from saccade.slam._recovery_kernels import contradicts

    with _compiled_ahead(contradicts, *also.split(), "filter") as wait:

        def finish() -> None:
            if wait is not None:
                _compile_updates()
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
    """Compile what a step calls beside the filter: association and recovery."""
    import numpy as np

    from saccade._jit import compile_for
    from saccade.slam import NearestNeighbor, Slam
    from saccade.slam._recovery_kernels import contradicts
    from saccade.slam.association._kernels import associate_nearest, compare_identities

    slam, z, R = Slam(), np.zeros((1, 2)), np.zeros((1, 2, 2))
    f, names, confirmed = slam.ekf.view, np.zeros(1, np.int64), np.zeros(1, np.bool_)
    recovery, gates = slam.recovery, NearestNeighbor().gates
    evidence = recovery.evidence, recovery.rule
    compile_for(contradicts, f, *evidence, z, R, confirmed, names, 0)
    compile_for(associate_nearest, f, z, R, gates, names, confirmed, names)
    compile_for(compare_identities, f, z, R, names, z[:, 0].copy(), z[:, 1].copy())


def _compile_updates() -> None:
    """Compile the filter: predict, augment and update."""
    import numpy as np

    from saccade.slam import EkfSlam

    ekf, z, R = EkfSlam(np.zeros(3), np.eye(3)), np.array([1.0, 0.1]), np.eye(2)
    ekf.augment(z, R)
    ekf.predict(np.zeros(2), np.eye(2))
    ekf.update(z, R, 0)


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
