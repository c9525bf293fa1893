"""Landmark logs as one CSV table, which any program can write and read.

A row is a pose or an observation, and the header names its cells:

    time                            seconds, or the number of the pose; never goes back
    x, y, heading                   of the first row alone: the start pose
    forward, left, turn             this pose in the frame of the last one
      or distance, turn             turned before driven
    cov_forward_forward, ...        its covariance, upper triangle
    landmark                        identity of the landmark; empty where it is not known
    range, bearing                  of an observation from the last pose above
    cov_range_range, ...            its covariance, upper triangle

The first row is the first pose and has no control; every other row has either a control or an
observation. An empty off-diagonal covariance is zero. Metres and radians.
"""

from pathlib import Path
from typing import Literal

import numpy as np

from saccade.datasets.covariances import covariance_names, from_upper_triangle, symmetric_columns
from saccade.datasets.table import write_table
from saccade.datasets.text import Row, read_rows
from saccade.errors import LogError
from saccade.types import BoolArray, FloatArray, IntArray, LandmarkLog

_START = ("x", "y", "heading")
_OBSERVATION = ("range", "bearing")
_CONTROLS = {"compose": ("forward", "left", "turn"), "drive": ("distance", "turn")}


def columns_of(motion: str) -> list[str]:
    """The header of a log whose controls are "compose" or "drive"."""
    control = _CONTROLS[motion]
    return [
        *("time", *_START, *control, *covariance_names(control)),
        *("landmark", *_OBSERVATION, *covariance_names(_OBSERVATION)),
    ]


def write_log_csv(path: str | Path, log: LandmarkLog) -> None:
    """Write a log with every digit; ground truth is not part of it.

    Raises:
        LogError: the controls are those of a custom motion model.
        OutputError: the file cannot be written.
    """
    if log.motion not in _CONTROLS:
        raise LogError(
            f"{log.name}: expected controls of drive or compose, found those of a custom motion "
            "model"
        )
    control = _CONTROLS[log.motion]
    poses, observations = np.arange(len(log.time)), np.arange(len(log.observation))
    pose_row = poses + np.searchsorted(log.observation_pose, poses)
    observation_row = observations + log.observation_pose + 1
    n = len(poses) + len(observations)
    table = {name: np.full(n, np.nan) for name in columns_of(log.motion)}
    table["time"][pose_row] = log.time
    table["time"][observation_row] = log.time[log.observation_pose]
    for rows, columns in (
        (pose_row[:1], zip(_START, log.start[:, None], strict=True)),
        (pose_row[1:], zip(control, log.control.T, strict=True)),
        (pose_row[1:], symmetric_columns(control, log.control_covariance).items()),
        (observation_row, zip(_OBSERVATION, log.observation.T, strict=True)),
        (observation_row, symmetric_columns(_OBSERVATION, log.observation_covariance).items()),
    ):
        for name, values in columns:
            table[name][rows] = values
    landmark = np.full(n, "", dtype=object)
    landmark[observation_row] = ["" if i < 0 else str(i) for i in log.landmark.tolist()]
    write_table(path, table | {"landmark": landmark})


def read_log_csv(path: str | Path) -> LandmarkLog:
    """Read a log.

    Args:
        path: a table with the columns of the module's docstring, in any order; off-diagonal
            covariances may be left out.

    Raises:
        LogError: no such file, another header, or a row that is neither a pose nor an
            observation; names the line.
    """
    path = Path(path)
    rows = read_rows(path, delimiter=",")
    header = next(rows, Row(path, 1, []))
    motion: Literal["drive", "compose"] = "drive" if "distance" in header.cells else "compose"
    control = _CONTROLS[motion]
    _check_header(header, motion)
    table = _Table(header.cells, list(rows))
    if not table.rows:
        raise LogError(f"{path}: expected a row for the first pose, found none")
    is_control, is_observation = (table.any_of(names) for names in (control, _OBSERVATION))
    if is_control[0] or is_observation[0]:
        found = [n for n, cell in zip(header.cells, table.rows[0].cells, strict=True) if cell]
        raise table.rows[0].error("the first pose", ", ".join(found))
    for i in np.flatnonzero(is_control[1:] == is_observation[1:])[:1].tolist():
        raise table.rows[i + 1].error(
            f"{', '.join(control)} or {', '.join(_OBSERVATION)}",
            "both" if is_control[i + 1] else "neither",
        )
    observation_rows = np.flatnonzero(is_observation)
    control_rows = np.flatnonzero(is_control)
    observation_pose = np.cumsum(~is_observation)[observation_rows] - 1
    return LandmarkLog(
        name=path.stem,
        start=table.values(np.array([0]), _START, blank=0.0)[0],
        time=table.pose_times(is_observation, observation_pose),
        motion=motion,
        control=table.values(control_rows, control),
        control_covariance=table.covariances(control_rows, control),
        observation_pose=observation_pose.astype(np.int64),
        observation=table.values(observation_rows, _OBSERVATION),
        observation_covariance=table.covariances(observation_rows, _OBSERVATION),
        landmark=table.landmarks(observation_rows),
    )


def _check_header(header: Row, motion: str) -> None:
    known, names = columns_of(motion), header.cells
    unknown = [name for name in names if name not in known]
    required = ["time", *_CONTROLS[motion], *_OBSERVATION]
    required += [f"cov_{name}_{name}" for name in required[1:]]
    missing = [name for name in required if name not in names]
    if unknown or missing or len(set(names)) < len(names):
        found = f"no {', '.join(missing)}" if missing else "one twice"
        raise header.error(
            f"the columns {', '.join(known)}, each once",
            repr(unknown[0][:40]) if unknown else found,
        )


class _Table:
    """The rows of a log by the names of their columns; an empty cell is NaN."""

    def __init__(self, header: list[str], rows: list[Row]) -> None:
        self.rows = [row.require_cells(len(header)) for row in rows]
        self.column = {name: i for i, name in enumerate(header)}
        self.table = np.full((len(rows), len(header)), np.nan)
        for name, i in self.column.items():
            if name != "landmark":
                columns = slice(i, i + 1)
                self.table[:, i] = [row.numbers(columns, blank=np.nan)[0] for row in rows]

    def any_of(self, names: tuple[str, ...]) -> BoolArray:
        """(n,) whether a row has any of some cells."""
        cells = self.table[:, [self.column[name] for name in names]]
        return np.asarray(np.isfinite(cells).any(1))

    def values(
        self, rows: IntArray, names: tuple[str, ...], blank: float | None = None
    ) -> FloatArray:
        """(len(rows), len(names)) cells; an empty one or a missing column is `blank`.

        Raises:
            LogError: an empty cell where `blank` is None.
        """
        values = np.full((len(rows), len(names)), np.nan)
        for k, name in enumerate(names):
            if name in self.column:
                values[:, k] = self.table[rows, self.column[name]]
        for i, k in np.argwhere(np.isnan(values))[: 1 if blank is None else 0].tolist():
            raise self.rows[int(rows[i])].error(f"a finite number for {names[k]}", "nothing")
        return np.where(np.isnan(values), blank, values) if blank is not None else values

    def covariances(self, rows: IntArray, names: tuple[str, ...]) -> FloatArray:
        """(len(rows), d, d) covariances; the variances are required."""
        self.values(rows, tuple(f"cov_{name}_{name}" for name in names))
        return from_upper_triangle(self.values(rows, tuple(covariance_names(names)), blank=0.0))

    def pose_times(self, is_observation: BoolArray, pose: IntArray) -> FloatArray:
        """(t + 1,) times of the poses, with which those of the observations must agree."""
        time = self.values(np.arange(len(self.rows)), ("time",))[:, 0]
        pose_time = time[~is_observation]
        for i in np.flatnonzero(np.diff(pose_time) < 0)[:1].tolist():
            row = self.rows[int(np.flatnonzero(~is_observation)[i + 1])]
            raise LogError(
                f"{row.path}, line {row.line}: time goes back from {pose_time[i]:g} to "
                f"{pose_time[i + 1]:g}"
            )
        for i in np.flatnonzero(time[is_observation] != pose_time[pose])[:1].tolist():
            raise self.rows[int(np.flatnonzero(is_observation)[i])].error(
                f"an observation at the time of the pose above, {pose_time[pose[i]]:g}",
                f"{time[is_observation][i]:g}",
            )
        return pose_time

    def landmarks(self, rows: IntArray) -> IntArray:
        """(len(rows),) identities, -1 where the cell is empty."""
        column = self.column.get("landmark")
        if column is None:
            return np.full(len(rows), -1, np.int64)
        chosen = [self.rows[i] for i in rows.tolist()]
        return np.array(
            [
                -1
                if row.cells[column] in ("", "-1")
                else row.integer(column, "the number of a landmark")
                for row in chosen
            ],
            np.int64,
        )
