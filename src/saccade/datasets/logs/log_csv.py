"""Landmark logs as one CSV table, which any program can write and read.

A row is a pose or an observation, and the header names its cells:

    time                            seconds, or the number of the pose; never goes back
    x, y, heading                   of the first row alone: the start pose
    forward, left, turn             this pose in the frame of the last one
      or distance, turn             turned before driven
    cov_forward_forward, ...        its covariance, upper triangle
    landmark                        name of the landmark, an integer from 0 on or text; empty where
                                    it is not known
    range, bearing                  of an observation from the last pose above
    cov_range_range, ...            its covariance, upper triangle

The first row is the first pose and has no control; every other row has either a control or an
observation. An empty off-diagonal covariance is zero; without a column of the covariances of
either, they are assumed. Metres and radians.
"""

import warnings
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from saccade.datasets.logs.conversions import (
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    sensor_variances,
)
from saccade.datasets.tables import (
    Row,
    covariance_names,
    from_upper_triangle,
    read_rows,
    require_ascending,
    symmetric_columns,
    write_table,
)
from saccade.errors import LogError, LogWarning
from saccade.landmark_names import parse_name
from saccade.types import FloatArray, IntArray, LandmarkLog, invalid_range_bearing

ROUNDING = 1e-9
"""Eigenvalue of a covariance, as a fraction of the largest, that rounding may make negative."""
LOG_FILE = "log.csv"
"""Name of the log in a folder."""
ASSUMED = (
    f"{ASSUMED_ODOMETRY.distance:g} m and {ASSUMED_ODOMETRY.drift:g} rad after 1 m, "
    f"{ASSUMED_ODOMETRY.turn:g} rad after a turn by 1 rad",
    f"{ASSUMED_SENSOR[0]:.0%} of the range, {ASSUMED_SENSOR[1]:g} rad of the bearing",
)
"""Standard deviations of controls and of observations, in words."""
_START = ("x", "y", "heading")
_OBSERVATION = ("range", "bearing")
_CONTROLS = {"compose": ("forward", "left", "turn"), "turn_then_translate": ("distance", "turn")}


def columns_of(motion: str) -> list[str]:
    """The header of a log whose controls are "compose" or "turn_then_translate"."""
    control = _CONTROLS[motion]
    return [
        *("time", *_START, *control, *covariance_names(control)),
        *("landmark", *_OBSERVATION, *covariance_names(_OBSERVATION)),
    ]


def write_log_csv(path: str | Path, log: LandmarkLog) -> None:
    """Write a log with every digit; ground truth is not part of it.

    Raises:
        OutputError: the file cannot be written.
    """
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
    landmark[observation_row] = np.where(log.landmark < 0, "", log.names.astype(np.str_))
    write_table(path, table | {"landmark": landmark})


def read_log_csv(path: str | Path) -> LandmarkLog:
    """Read a log.

    Args:
        path: a table with the columns of the module's docstring, in any order, or a folder that
            holds it as log.csv; off-diagonal covariances may be left out. Without any of the
            controls, or of the observations, they are assumed as in a ROS bag (`LogWarning`).

    Raises:
        LogError: no such file, another header, or a row that is neither a pose nor an
            observation; names the line.
    """
    source = path = Path(path)
    if path.is_dir():
        path = path / LOG_FILE
    lines = read_rows(path, delimiter=",")
    header = next(lines, Row(path, 1, []))
    motion: Literal["turn_then_translate", "compose"] = (
        "turn_then_translate" if "distance" in header.cells else "compose"
    )
    control = _CONTROLS[motion]
    _check_header(header, motion)
    rows = [row.require_cells(len(header.cells)) for row in lines]
    if not rows:
        raise LogError(f"{path}: expected a row for the first pose, found none")
    values = dict.fromkeys(columns_of(motion), np.full(len(rows), np.nan))
    for i, name in enumerate(header.cells):
        if name != "landmark":
            cells = [row.numbers(slice(i, i + 1), blank=np.nan)[0] for row in rows]
            values[name] = np.array(cells)
    table = _Table(header, rows, values)
    controls, observations = _rows_of_each(table, control)
    poses = np.setdiff1d(np.arange(len(rows)), observations)
    time = table.cells(np.arange(len(rows)), ("time",))
    require_ascending(time[poses], lambda i: f"{path}, line {rows[poses[i]].line}")
    observation_pose = np.searchsorted(poses, observations) - 1
    observed, expected = time[observations, 0], time[poses[observation_pose], 0]
    for k in np.flatnonzero(observed != expected)[:1].tolist():
        raise rows[int(observations[k])].error(
            f"an observation at the time of the pose above, {expected[k]:g}", f"{observed[k]:g}"
        )
    step = table.cells(controls, control)
    observation = table.cells(observations, _OBSERVATION)
    invalid = invalid_range_bearing(observation)
    if invalid is not None:
        raise rows[int(observations[invalid[0]])].error(*invalid[1:])
    along, heading = ASSUMED_ODOMETRY.variances(np.linalg.norm(step[:, :-1], axis=1), step[:, -1])
    assumed = np.stack([*[along] * (len(control) - 1), heading], 1)
    return LandmarkLog(
        name=source.stem,
        start=np.array([np.nan_to_num(values[name][0]) for name in _START]),
        time=time[poses, 0],
        motion=motion,
        control=step,
        control_covariance=table.covariances(controls, control, assumed),
        observation_pose=observation_pose.astype(np.int64),
        observation=observation,
        observation_covariance=table.covariances(
            observations, _OBSERVATION, sensor_variances(observation[:, 0], ASSUMED_SENSOR)
        ),
        landmark=_landmarks(header.cells, rows, observations),
    )


def _check_header(header: Row, motion: str) -> None:
    known, names = columns_of(motion), header.cells
    for sign, found_sign in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and sign in names[0]:
            raise header.error("commas between cells, and decimal points", found_sign)
    required = ["time", *_CONTROLS[motion], *_OBSERVATION]
    for group in (_CONTROLS[motion], _OBSERVATION):
        if set(covariance_names(group)) & set(names):
            required += [f"cov_{name}_{name}" for name in group]
    found = [repr(name[:40]) for name in names if name not in known]
    found += [f"no {name}" for name in required if name not in names]
    found += ["one twice"] if len(set(names)) < len(names) else []
    if found:
        raise header.error(f"the columns {', '.join(known)}, each once", found[0])


def _rows_of_each(table: "_Table", control: tuple[str, ...]) -> tuple[IntArray, IntArray]:
    """Indices of the rows with a control and of those with an observation; the first has none."""
    is_control, is_observation = (
        np.asarray(np.isfinite([table.values[name] for name in names]).any(0))
        for names in (control, _OBSERVATION)
    )
    if is_control[0] or is_observation[0]:
        row = table.rows[0]
        given = [n for n, cell in zip(table.header.cells, row.cells, strict=True) if cell]
        raise row.error("the first pose", ", ".join(given))
    for i in (np.flatnonzero(is_control[1:] == is_observation[1:])[:1] + 1).tolist():
        found = "both" if is_control[i] else "neither"
        raise table.rows[i].error(f"{', '.join(control)} or {', '.join(_OBSERVATION)}", found)
    return np.flatnonzero(is_control), np.flatnonzero(is_observation)


class _Table(NamedTuple):
    """The rows of a file, and the numbers (n,) in its columns, NaN where a cell is empty."""

    header: Row
    rows: list[Row]
    values: dict[str, FloatArray]

    def cells(self, chosen: IntArray, names: tuple[str, ...]) -> FloatArray:
        """Numbers (len(chosen), len(names)), none of which may be missing."""
        values = np.stack([self.values[name][chosen] for name in names], 1)
        for i, k in np.argwhere(np.isnan(values))[:1].tolist():
            raise self.rows[int(chosen[i])].error(f"a finite number for {names[k]}", "nothing")
        return values

    def covariances(
        self, chosen: IntArray, names: tuple[str, ...], assumed: FloatArray
    ) -> FloatArray:
        """Covariances (k, d, d) of rows; variances (k, d) are assumed if there is no column."""
        if not set(covariance_names(names)) & set(self.header.cells):
            warnings.warn(
                f"{self.header.path}: no covariance of {', '.join(names)}: assumed standard "
                f"deviations of {ASSUMED[names == _OBSERVATION]}; columns "
                f"cov_{names[0]}_{names[0]}, ... give the true ones",
                LogWarning,
                stacklevel=4,
            )
            return assumed[:, :, None] * np.eye(len(names))
        self.cells(chosen, tuple(f"cov_{name}_{name}" for name in names))
        entries = np.stack([self.values[name][chosen] for name in covariance_names(names)], 1)
        covariances = from_upper_triangle(np.nan_to_num(entries))
        eigenvalues = np.linalg.eigvalsh(covariances)  # ascending
        negative = eigenvalues[:, 0] < -ROUNDING * eigenvalues[:, -1].clip(0)
        for k in np.flatnonzero(negative)[:1].tolist():
            raise self.rows[int(chosen[k])].error(
                f"a covariance of {', '.join(names)} (no negative variance)",
                str(covariances[k].tolist()),
            )
        return covariances


def _landmarks(header: list[str], records: list[Row], rows: IntArray) -> npt.NDArray[Any]:
    """Names (len(rows),), integers or text, -1 where the cell is empty."""
    if "landmark" not in header:
        return np.full(len(rows), -1, np.int64)
    column = header.index("landmark")
    named = [records[i] for i in rows.tolist()]
    names = [parse_name(row.cells[column]) for row in named]
    if None in names:
        row = named[names.index(None)]
        raise row.error(
            "the name of a landmark (text, or an integer from 0 on)", repr(row.cells[column][:40])
        )
    return np.array(names, object)
