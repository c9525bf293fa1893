"""Odometry of a camera drive as CSV; the header says which of three kinds it is.

    steps     ahead_m, left_m, turn_rad and their covariance: cov_ahead_ahead, cov_ahead_left,
              cov_ahead_turn, cov_left_left, cov_left_turn, cov_turn_turn; row i is the step
              from frame i to frame i + 1, in the robot's frame at i
    speeds    time_s, ahead_mps, turn_radps; by a clock of their own, in seconds of the frames
    OXTS      frame, t, vf, vl, vu, wf, wl, wu; as KITTI's inertial unit gives them

Lines that begin with `#` are left out.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from saccade.datasets.drives.odometry_increments import (
    WHEELS,
    OdometryIncrements,
    SpeedNoise,
    composed,
    increments_from_speeds,
)
from saccade.datasets.table import symmetric_columns, write_table
from saccade.datasets.text import in_order, numbers, read_lines
from saccade.errors import DriveError
from saccade.types import FloatArray, IntArray

_MOVED = ("ahead", "left", "turn")
STEP_COLUMNS = (
    "ahead_m",
    "left_m",
    "turn_rad",
    *symmetric_columns(_MOVED, np.zeros((0, 3, 3))),
)
SPEED_COLUMNS = ("time_s", "ahead_mps", "turn_radps")
OXTS_COLUMNS = ("frame", "t", "vf", "vl", "vu", "wf", "wl", "wu")

OXTS = SpeedNoise(ahead=0.17, left=0.05, turn=0.018, turn_bias=0.005)
"""Measured against the truth of KITTI 07: 0.52 m/s and 0.05 rad/s, white at 10 Hz."""


def read_odometry(path: Path, time: FloatArray, frame: IntArray) -> OdometryIncrements:
    """The steps between the frames of a drive.

    Args:
        path: one of the three kinds.
        time: (n,) seconds of the frames, ascending.
        frame: (n,) their numbers among all that the camera took, ascending.

    Raises:
        LogError: the file is missing, or a row is broken; names the line.
        DriveError: another header, or too few rows.
    """
    header, table = _read(path)
    if header == STEP_COLUMNS:
        upper = np.triu_indices(3)
        covariance = np.zeros((len(table), 3, 3))
        covariance[:, upper[0], upper[1]] = covariance[:, upper[1], upper[0]] = table[:, 3:]
        return composed(OdometryIncrements(table[:, :3], covariance), frame, str(path))
    clock = 0 if header == SPEED_COLUMNS else 1
    if len(table) < 2:
        raise DriveError(f"{path}: expected at least two rows of speeds, found {len(table)}")
    in_order(table[:, clock:], 0.0, lambda row: f"{path}, row {row}")
    begin, end = table[0, clock], table[-1, clock]
    period = float(np.median(np.diff(table[:, clock])))
    if time[0] < begin - period or time[-1] > end + period:
        raise DriveError(
            f"{path}: expected speeds from {time[0]:.3f} to {time[-1]:.3f} s as the frames, "
            f"found {begin:.3f} to {end:.3f} s"
        )
    if header == SPEED_COLUMNS:
        return increments_from_speeds(table[:, 0], table[:, 1], table[:, 2], time, WHEELS)
    return increments_from_speeds(table[:, 1], table[:, 2], table[:, 7], time, OXTS)


def write_increments(path: Path, steps: OdometryIncrements) -> None:
    """Write steps with every digit.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = dict(zip(STEP_COLUMNS[:3], steps.control.T, strict=True))
    write_table(path, columns | symmetric_columns(_MOVED, steps.covariance))


def _read(path: Path) -> tuple[tuple[str, ...], FloatArray]:
    """The header and the rows under it."""
    lines = read_lines(path)
    rows = [
        (number, [cell.strip() for cell in cells])
        for number, cells in enumerate(csv.reader(lines), 1)
        if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#")
    ]
    known: Sequence[tuple[str, ...]] = (STEP_COLUMNS, SPEED_COLUMNS, OXTS_COLUMNS)
    header = tuple(rows[0][1]) if rows else ()
    if header not in known:
        raise DriveError(
            f"{path}: expected the header {' or '.join(','.join(each[:3]) for each in known)},..., "
            f"found {','.join(header)[:80]!r}"
        )
    table = []
    for number, cells in rows[1:]:
        if len(cells) != len(header):
            raise DriveError(
                f"{path}, line {number}: expected {len(header)} cells, found {len(cells)}"
            )
        table.append(numbers(path, number, cells))
    return header, np.array(table, np.float64).reshape(-1, len(header))
