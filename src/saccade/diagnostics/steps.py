"""Checks of single steps of odometry: jumps, and resets to the origin."""

from collections.abc import Iterator

import numpy as np

from saccade.diagnostics.findings import Finding, counted
from saccade.plane import long_steps, steps_between
from saccade.types import FloatArray


def check_steps(time: FloatArray, path: FloatArray) -> Iterator[Finding]:
    """Checks for jumps and resets in the path (t + 1, 3) of odometry at times (t + 1,)."""
    jumps, resets = long_steps(time, path)
    length = np.hypot(*steps_between(path)[:, :2].T)
    for name, kind, found in (
        ("odometry reset", "returns to its origin", resets),
        ("odometry jump", "jumps", jumps & ~resets),
    ):
        if found.any():
            steps = np.flatnonzero(found)
            what = (
                f"odometry {kind} in {counted(len(steps), 'step', 'steps')}, first "
                f"{time[steps[0] + 1] - time[0]:.1f} s after the first pose, by up to "
                f"{length[found].max():.2f} m"
            )
            yield Finding.of(name, what, len(steps))
