"""Compiles in another process meanwhile: Numba compiles one function at a time in each.

A kernel that both processes need is compiled by the one that comes first (see `saccade._jit`), so
each begins with what the other needs last.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def compiled_ahead(*tasks: str) -> Iterator[None]:
    """Run tasks of `TASKS` in another process, if the last one's kernels are not in the cache."""
    command = [sys.executable, "-c", f"import {__name__} as a; a.run_tasks()", *tasks]
    if (os.cpu_count() or 1) < 2 or not sys.executable or not _needs_compiling(tasks[-1]):
        yield
        return
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as process:
        try:
            yield
        finally:
            process.kill()


def _needs_compiling(task: str) -> bool:
    from saccade._jit import needs_compiling

    if task == "points":
        from saccade.keypoints._gradient_kernels import fill_descriptors

        return needs_compiling(fill_descriptors)
    from saccade.slam.filter._range_bearing_kernels import predict_by_control

    return needs_compiling(predict_by_control)


def compile_association() -> None:
    """Compile what a step of the filter calls last: recovery, association and prediction."""
    import numpy as np

    from saccade._jit import compile_for
    from saccade.slam import Slam
    from saccade.slam._recovery_kernels import contradicts
    from saccade.slam.association._kernels import associate_nearest, compare_identities

    slam, z, R = Slam(), np.zeros((1, 2)), np.zeros((1, 2, 2))
    f, names, confirmed = slam.ekf.view, np.zeros(1, np.int64), np.zeros(1, np.bool_)
    recovery, gates = slam.recovery, slam.associate.gates
    evidence = recovery.evidence, recovery.rule
    compile_for(contradicts, f, *evidence, z, R, confirmed, names, 0)
    compile_for(associate_nearest, f, z, R, gates, names, confirmed, names)
    compile_for(compare_identities, f, z, R, names, z[:, 0].copy(), z[:, 1].copy())
    slam.ekf.predict(np.zeros(2), np.eye(2))


def compile_updates() -> None:
    """Compile what takes the longest of a step: augmentation and update."""
    import numpy as np

    from saccade.slam import EkfSlam

    ekf, z, R = EkfSlam(np.zeros(3), np.eye(3)), np.array([1.0, 0.1]), np.eye(2)
    ekf.augment(z, R)
    ekf.update(z, R, 0)


def compile_points() -> None:
    """Compile SIFT on a small image: first what it calls last, orientation and descriptor."""
    import numpy as np

    from saccade.keypoints import Sift, SiftConfig
    from saccade.types import Keypoints

    image = np.random.default_rng(0).random((64, 64), np.float32)
    sift = Sift(SiftConfig(max_keypoints=10, spread=True))
    sift.describe(image, Keypoints.at([(32, 32)], 8), orient=True)
    sift(image)


def compile_drive() -> None:
    """Compile what a camera drive calls besides, of which most is the adjustment of its window."""
    from saccade.evaluation.gaze import gaze_drive
    from saccade.simulation import DriveConfig

    gaze_drive(DriveConfig(frames=3, image_size=(64, 48), color=True), "active", seed=0)


TASKS = {
    "points": compile_points,
    "updates": compile_updates,
    "association": compile_association,
    "drive": compile_drive,
}


def run_tasks() -> None:
    """Run the tasks in `sys.argv`."""
    for name in sys.argv[1:]:
        TASKS[name]()
