"""Trajectories as text, in the format of the TUM RGB-D benchmark, which evo reads."""

from pathlib import Path

import numpy as np

from saccade.files import atomic_write
from saccade.types import Trajectory


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write `time x y z qx qy qz qw` per pose; the ground is z = 0, headings turn about z.

    Args:
        path: the file; replaced if it exists.
        trajectory: poses with headings; covariances are not part of the format.

    Raises:
        OutputError: the file cannot be written.
    """
    x, y, theta = trajectory.pose.T
    zero = np.zeros(len(trajectory))
    rows = np.stack(
        [trajectory.time, x, y, zero, zero, zero, np.sin(theta / 2), np.cos(theta / 2)], 1
    )
    with atomic_write(path) as temporary:
        np.savetxt(temporary, rows, fmt="%.9f")
