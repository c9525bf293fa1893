"""Odometry of a camera drive as CSV; the header selects one of three kinds.

    increments  ahead_m, left_m, turn_rad and their covariance: cov_ahead_ahead, cov_ahead_left,
                cov_ahead_turn, cov_left_left, cov_left_turn, cov_turn_turn; row i is the motion
                from frame i to frame i + 1, in the robot's frame at i
    speeds      time_s, ahead_mps, turn_radps; sampled independently of the frames, on their clock
    OXTS        frame, t, vf, vl, vu, wf, wl, wu; of KITTI's inertial unit

Lines that begin with `#` are comments.
"""

from pathlib import Path

import numpy as np

from saccade.datasets.drives.frame_times import FrameTimes
from saccade.datasets.drives.odometry_increments import (
    WHEELS,
    OdometryIncrements,
    SpeedNoise,
    compose_increments,
    increments_from_speeds,
)
from saccade.datasets.table import (
    covariance_names,
    from_upper_triangle,
    symmetric_columns,
    write_table,
)
from saccade.datasets.text import Row, read_rows, require_ascending
from saccade.errors import DriveError

_MOTION = ("ahead", "left", "turn")
INCREMENT_COLUMNS = ("ahead_m", "left_m", "turn_rad", *covariance_names(_MOTION))
SPEED_COLUMNS = ("time_s", "ahead_mps", "turn_radps")
OXTS_COLUMNS = ("frame", "t", "vf", "vl", "vu", "wf", "wl", "wu")
_HEADERS = (INCREMENT_COLUMNS, SPEED_COLUMNS, OXTS_COLUMNS)

OXTS = SpeedNoise(ahead=0.17, left=0.05, turn=0.018, turn_bias=0.005)
"""Measured against the ground truth of KITTI 07: 0.52 m/s and 0.05 rad/s, white at 10 Hz."""


def read_odometry(path: Path, frames: FrameTimes) -> OdometryIncrements:
    """Odometry between the frames of a drive.

    Args:
        path: a file of one of the three kinds.
        frames: of the drive.
    """
    rows = read_rows(path, delimiter=",")
    header = tuple(next(rows, Row(path, 1, [])).cells)
    if header not in _HEADERS:
        raise DriveError(
            f"{path}: expected the header {' or '.join(','.join(h[:3]) for h in _HEADERS)},..., "
            f"found {','.join(header)[:80]!r}"
        )
    values = [row.require_cells(len(header)).numbers() for row in rows]
    table = np.array(values, np.float64).reshape(-1, len(header))
    if header == INCREMENT_COLUMNS:
        increments = OdometryIncrements(table[:, :3], from_upper_triangle(table[:, 3:]))
        return compose_increments(increments, frames.index, str(path))
    columns, noise = ([0, 1, 2], WHEELS) if header == SPEED_COLUMNS else ([1, 2, 7], OXTS)
    if len(table) < 2:
        raise DriveError(f"{path}: expected at least two rows of speeds, found {len(table)}")
    table = require_ascending(table[:, columns], lambda i: f"{path}, row {i}")
    time, speed, turn_rate = table.T
    frame_time = frames.time
    period = float(np.median(np.diff(time)))
    if frame_time[0] < time[0] - period or frame_time[-1] > time[-1] + period:
        raise DriveError(
            f"{path}: expected speeds from {frame_time[0]:.3f} to {frame_time[-1]:.3f} s as the "
            f"frames, found {time[0]:.3f} to {time[-1]:.3f} s"
        )
    return increments_from_speeds(time, speed, turn_rate, frame_time, noise)


def write_increments(path: Path, increments: OdometryIncrements) -> None:
    """Write increments with every digit."""
    columns = dict(zip(INCREMENT_COLUMNS[:3], increments.control.T, strict=True))
    write_table(path, columns | symmetric_columns(_MOTION, increments.covariance))
