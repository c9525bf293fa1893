"""The table of motions: kinds of controls, and their conversion to relative poses.

A relative pose is the next pose of the robot in the frame of the last: forward and left in meters,
turn to the left in radians. The filter, smoothing and the search of a pose know relative poses
only. Systematic errors of the odometry are errors of controls, and apply to every motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError

Numbers: TypeAlias = npt.NDArray[np.float64]
"""Array of numbers."""
SYSTEMATIC_ERRORS = 3
"""Number of systematic errors of the odometry: relative error of the distance; turn in radians per
meter driven; and meters lost per radian turned."""


@dataclass(frozen=True)
class Motion:
    """A kind of controls."""

    columns: tuple[str, ...]
    """Names of the c numbers of a control, as in the header of a CSV log: lengths in meters, then
    the turn in radians. The systematic errors are those of the first length and of the turn, so
    that speeds, durations and wheels are to be converted before."""
    relative_poses: Callable[[Numbers], tuple[Numbers, Numbers]]
    """Converts controls (t, c) to relative poses (t, 3); also returns their Jacobians (t, 3, c)."""


def _unchanged(control: Numbers) -> tuple[Numbers, Numbers]:
    """Relative poses are controls already."""
    return control, np.broadcast_to(np.eye(3), (len(control), 3, 3))


def _turn_then_translate(control: Numbers) -> tuple[Numbers, Numbers]:
    """A turn, then a distance straight ahead (C.5, C.9)."""
    d, turn = control[:, 0], control[:, 1]
    c, s = np.cos(turn), np.sin(turn)
    step, J = np.empty((len(control), 3)), np.zeros((len(control), 3, 2))
    x, y = d * c, d * s
    step[:, 0], step[:, 1], step[:, 2] = x, y, turn
    J[:, 0, 0], J[:, 0, 1] = c, -y
    J[:, 1, 0], J[:, 1, 1] = s, x
    J[:, 2, 1] = 1.0
    return step, J


MOTIONS: dict[str, Motion] = {
    "compose": Motion(("forward", "left", "turn"), _unchanged),
    "turn_then_translate": Motion(("distance", "turn"), _turn_then_translate),
}
"""Motions by name; of those with equal numbers of columns, the first is the default."""
RELATIVE = next(iter(MOTIONS))
"""Name of the motion whose controls are relative poses."""


def find_motion(name: str | Motion, owner: str = "motion") -> Motion:
    """The motion with this name, or a user's motion itself.

    Args:
        name: name in `MOTIONS`, or a `Motion`.
        owner: what has the motion, for the message.

    Raises:
        LogError: there is none.
    """
    if isinstance(name, Motion):
        return name
    if name not in MOTIONS:
        names = ", ".join(MOTIONS)
        raise LogError(f"{owner}: expected one of {names}, or a Motion, found {name!r}")
    return MOTIONS[name]


def motion_of_size(size: int) -> Motion | None:
    """The first motion whose controls have this number of columns; None without one."""
    for motion in MOTIONS.values():
        if len(motion.columns) == size:
            return motion
    return None


class RelativePoses(NamedTuple):
    """Relative poses of controls."""

    step: Numbers
    """(t, 3)."""
    covariance: Numbers
    """(t, 3, 3), to first order."""


def to_relative_poses(motion: Motion, control: Numbers, covariance: Numbers) -> RelativePoses:
    """Relative poses of controls (t, c) with covariances (t, c, c)."""
    step, J = motion.relative_poses(control)
    return RelativePoses(step, J @ covariance @ J.transpose(0, 2, 1))
