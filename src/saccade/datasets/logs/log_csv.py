"""Landmark logs as a single CSV table.

A row is a pose or an observation, with the columns listed in docs/slam.md. The first row is the
first pose and has no control; every other row has either a control or an observation. Units are
meters and radians. A comment "# sensor: x, y, yaw" gives the pose of the sensor.
"""

import re
import warnings
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.datasets.formats import first_lines
from saccade.datasets.logs.conversions import (
    ASSUMED,
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    sensor_variances,
)
from saccade.datasets.tables import (
    MAX_SHOWN,
    Row,
    TextTable,
    covariance_names,
    from_upper_triangle,
    is_number,
    read_csv,
    require_ascending,
    symmetric_columns,
    write_table,
)
from saccade.errors import LogError, LogWarning
from saccade.io.files import read_text
from saccade.landmark_names import parse_name
from saccade.motions import MOTIONS, Motion, find_motion
from saccade.types import FloatArray, IntArray, LandmarkLog, Trajectory, invalid_range_bearing

EIGENVALUE_ROUNDING = 1e-9
"""Tolerance for negative eigenvalues of a covariance due to rounding, relative to the largest."""
UNUSED_VARIANCE = 1.0
"""Placeholder variance of a component that was not measured; it is never used."""
LOG_FILE = "log.csv"
"""Name of the log in a folder."""
_START = ("x", "y", "heading")
_OBSERVATION = ("range", "bearing")
_TRUTH = ("true_x", "true_y", "true_heading")
_COMMENTS = {
    "sensor": "x, y, yaw in meters and radians",
    "odometry_bias": "relative error of the distance, radians per meter, meters per radian",
    "range_errors": "relative error, meters",
}
"""Fields of a log that a comment "# NAME: numbers" declares, and the meaning of their numbers."""


def columns_of(motion: str | Motion) -> list[str]:
    """The header of a log with controls of this motion."""
    control = find_motion(motion).columns
    return [
        *("time", *_START, *control, *covariance_names(control)),
        *("landmark", *_OBSERVATION, *covariance_names(_OBSERVATION)),
    ]


def is_log_csv(path: Path) -> bool:
    """Whether the content of a file begins with the header of a log."""
    lines = [line for line in first_lines(path) if line.strip() and not line.startswith("#")]
    names = {cell.strip(' "') for cell in lines[0].split(",")} if lines else set()
    return "time" in names and bool(names & set(_OBSERVATION))


def write_log_csv(path: str | Path, log: LandmarkLog) -> None:
    """Write a log with every digit.

    The true trajectory is written at the times of the poses; true landmarks are not.
    """
    control = find_motion(log.motion).columns
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
    table["landmark"] = landmark
    if log.truth is not None:
        truth = np.full((n, 3), np.nan)
        truth[pose_row] = log.truth.at(log.time)
        table |= zip(_TRUTH, truth.T, strict=True)
    declared = {name: [*map(float, getattr(log, name))] for name in _COMMENTS}
    comments = [
        f"{name}: {', '.join(map(repr, values))}"
        for name, values in declared.items()
        if any(values)
    ]
    write_table(path, table, "\n# ".join(comments))


def read_log_csv(path: str | Path) -> LandmarkLog:
    """Read a log.

    Args:
        path: a table with the columns of docs/slam.md, in any order, or a folder with log.csv.
            Off-diagonal covariances are optional. If controls or observations have no covariance,
            defaults are assumed as for a ROS bag (`LogWarning`). The range or the bearing of an
            observation may be empty or "nan".
    """
    path = Path(path)
    file = path / LOG_FILE if path.is_dir() else path
    table = read_csv(file, _check_header)
    _empty_nan(table)
    motion = _motion_of(table.names)
    control = find_motion(motion).columns
    if not table.rows:
        raise LogError(f"{table.header.path}: expected a row for the first pose, found none")
    controls, observations = _rows_of_each(table, control)
    poses = np.setdiff1d(np.arange(len(table.rows)), observations)
    time = _cells(table, ("time",))[:, 0]
    require_ascending(time[poses, None], lambda i: table.rows[poses[i]].name)
    observation_pose = np.searchsorted(poses, observations) - 1
    expected = time[poses[observation_pose]]
    for k in np.flatnonzero(time[observations] != expected)[:1].tolist():
        row, found = int(observations[k]), time[observations[k]]
        raise table.rows[row].error(
            f"an observation at the time of the pose above, {expected[k]:g}", f"{found:g}"
        )
    controlled, observed = table.select(controls), table.select(observations)
    step, observation = _cells(controlled, control), observed.numbers(*_OBSERVATION, blank=np.nan)
    invalid = invalid_range_bearing(observation)
    if invalid is not None:
        raise observed.rows[invalid[0]].error(*invalid[1:])
    along, heading = ASSUMED_ODOMETRY.variances(np.linalg.norm(step[:, :-1], axis=1), step[:, -1])
    assumed = np.stack([*[along] * (len(control) - 1), heading], 1)
    truth = _truth(table.select(poses), time[poses])
    return LandmarkLog(
        name=path.stem,
        start=_start(table.select([0]), truth),
        time=time[poses],
        motion=motion,
        control=step,
        control_covariance=_covariances(controlled, control, assumed),
        observation_pose=observation_pose.astype(np.int64),
        observation=observation,
        observation_covariance=_covariances(
            observed, _OBSERVATION, sensor_variances(observation[:, 0], ASSUMED_SENSOR)
        ),
        landmark=_landmarks(observed),
        **_declared(file),
        truth=truth,
    )


def _empty_nan(table: TextTable) -> None:
    """Empties the cells of observations that are "nan", as pandas writes them."""
    names = {*_OBSERVATION, *covariance_names(_OBSERVATION)} & set(table.names)
    columns = [table.names.index(name) for name in names]
    for row in table.rows:
        for column in columns:
            if row.cells[column].lower() == "nan":
                row.cells[column] = ""


def _declared(path: Path) -> dict[str, Any]:
    """Fields of the log that the file's comments declare."""
    text, found = read_text(path), {}
    for name, meaning in _COMMENTS.items():
        pattern = rf'^[ \t"]*#[ \t]*{name.replace("_", "[ _-]")}[ \t]*:(.*)$'
        match = re.search(pattern, text, re.IGNORECASE | re.MULTILINE)
        if match is None:
            continue
        cells, size = match[1].strip(' ,;"\r').split(","), meaning.count(",") + 1
        valid = len(cells) == size and all(map(is_number, cells))
        if not valid or (name != "sensor" and min(map(float, cells)) < 0):
            row = Row(path, text.count("\n", 0, match.start()) + 1, cells)
            raise row.error(f"# {name}: {meaning}", repr(match[1].strip()[:60]))
        found[name] = tuple(map(float, cells))
    return found


def _start(first: TextTable, truth: Trajectory | None) -> FloatArray:
    """The first pose (3,): from the start columns, else the true pose, else the origin."""
    given = [name for name in _START if name in first.names]
    start = np.zeros(3)
    if truth is not None and not first.is_filled(given)[0]:
        at_first = truth.at(first.numbers("time")[0])[0]
        start = at_first if isfinite(at_first.sum()) else start
    for name, value in zip(given, first.numbers(*given, blank=np.nan)[0].tolist(), strict=True):
        if isfinite(value):
            start[_START.index(name)] = value
    return start


def _truth(poses: TextTable, time: FloatArray) -> Trajectory | None:
    """The true poses of the rows that have them, with NaN for missing headings; or None."""
    if not {"true_x", "true_y"} <= set(poses.names):
        return None
    has_heading = "true_heading" in poses.names
    true = np.full((len(time), 3), np.nan)
    true[:, : 2 + has_heading] = poses.numbers(*_TRUTH[: 2 + has_heading], blank=np.nan)
    known = np.isfinite(true[:, :2]).all(1)
    without = known & np.isnan(true[:, 2])
    if without.any() and not without[known].all():
        row = poses.rows[int(without.argmax())]
        raise row.error("true_heading in every row with true_x and true_y, or in none", "nothing")
    return Trajectory(time[known], true[known]) if known.any() else None


def _motion_of(names: list[str]) -> str:
    """The motion with the most columns in a header; the first of equals."""
    found = [len({*each.columns} & {*names}) / len(each.columns) for each in MOTIONS.values()]
    return list(MOTIONS)[found.index(max(found))]


def _name_covariances(cells: list[str]) -> None:
    """Renames columns such as c01 to the covariances of the control, in place."""
    control = MOTIONS[_motion_of(cells)].columns
    names = {f"c{i}{j}": f"cov_{a}_{b}" for j, b in enumerate(control)
             for i, a in enumerate(control[: j + 1])}  # fmt: skip
    cells[:] = [names.get(cell.lower(), cell) for cell in cells]


def _check_header(header: Row) -> None:
    _name_covariances(header.cells)
    motion, names = _motion_of(header.cells), header.cells
    known = [*columns_of(motion), *_TRUTH]
    for sign, found_sign in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and sign in names[0]:
            raise header.error("commas between cells, and decimal points", found_sign)
    required = ["time", *MOTIONS[motion].columns, *_OBSERVATION]
    for group in (MOTIONS[motion].columns, _OBSERVATION):
        if set(covariance_names(group)) & set(names):
            required += [f"cov_{name}_{name}" for name in group]
    required += ["true_x", "true_y"] * bool({*_TRUTH} & set(names))
    unknown = [name[:MAX_SHOWN] for name in names if name not in known]
    absent = [name for name in known if name not in names]
    near = get_close_matches(unknown[0], absent, 1) if unknown else []
    if near:
        raise header.error(f"the column {near[0]} (see Logs in docs/slam.md)", repr(unknown[0]))
    found = [repr(name) for name in unknown]
    found += [f"no {name}" for name in required if name not in names]
    found += [f"{name} twice" for name in known if names.count(name) > 1]
    if found:
        needed = f"the columns {', '.join(required)} and no others than in docs/slam.md"
        raise header.error(needed, found[0])


def _rows_of_each(table: TextTable, control: tuple[str, ...]) -> tuple[IntArray, IntArray]:
    """Indices of the rows with a control and of those with an observation; the first has none."""
    is_control, is_observation = table.is_filled(control), table.is_filled(_OBSERVATION)
    if is_control[0] or is_observation[0]:
        row = table.rows[0]
        given = [name for name, cell in zip(table.names, row.cells, strict=True) if cell]
        raise row.error("the first pose, in a row with its time alone", ", ".join(given))
    for i in (np.flatnonzero(is_control[1:] == is_observation[1:])[:1] + 1).tolist():
        found = "both" if is_control[i] else "neither"
        raise table.rows[i].error(f"{', '.join(control)} or {', '.join(_OBSERVATION)}", found)
    return np.flatnonzero(is_control), np.flatnonzero(is_observation)


def _cells(table: TextTable, names: tuple[str, ...]) -> FloatArray:
    """Numbers (n, len(names)); raises if one is missing."""
    values = table.numbers(*names, blank=np.nan)
    for i, k in np.argwhere(np.isnan(values))[:1].tolist():
        raise table.rows[i].error(f"a finite number for {names[k]}", "nothing")
    return values


def _covariances(table: TextTable, names: tuple[str, ...], assumed: FloatArray) -> FloatArray:
    """Covariances (n, d, d); without a column, diagonal with the assumed variances (n, d)."""
    columns, missing = covariance_names(names), np.isnan(table.numbers(*names, blank=np.nan))
    if not set(columns) & set(table.names):
        warnings.warn(
            f"{table.header.path}: {', '.join(names)} without covariance: assumed standard "
            f"deviations of {ASSUMED[names == _OBSERVATION]}; add columns "
            f"cov_{names[0]}_{names[0]}, ... for the true ones",
            LogWarning,
            stacklevel=4,
        )
        return np.where(missing, UNUSED_VARIANCE, assumed)[:, :, None] * np.eye(len(names))
    diagonal = table.numbers(*(f"cov_{name}_{name}" for name in names), blank=np.nan)
    for i, k in np.argwhere(np.isnan(diagonal) & ~missing)[:1].tolist():
        expected = f"a finite number for cov_{names[k]}_{names[k]}"
        raise table.rows[i].error(expected, "nothing")
    absent = np.zeros((len(table.rows), 1))
    entries = [
        table.numbers(name, blank=0.0) if name in table.names else absent for name in columns
    ]
    covariances = from_upper_triangle(np.hstack(entries))
    both = missing[:, :, None] | missing[:, None]
    covariances = np.where(both, UNUSED_VARIANCE * np.eye(len(names)), covariances)
    eigenvalues = np.linalg.eigvalsh(covariances)  # ascending
    negative = eigenvalues[:, 0] < -EIGENVALUE_ROUNDING * eigenvalues[:, -1].clip(0)
    for k in np.flatnonzero(negative)[:1].tolist():
        raise table.rows[k].error(
            f"a covariance of {', '.join(names)} (no negative variance)",
            str(covariances[k].tolist()),
        )
    return covariances


def _landmarks(table: TextTable) -> npt.NDArray[Any]:
    """Labels (n,), integers or text, -1 where the cell is empty."""
    if "landmark" not in table.names:
        return np.full(len(table.rows), -1, np.int64)
    column = table.names.index("landmark")
    labels = [parse_name(row.cells[column]) for row in table.rows]
    if None in labels:
        row = table.rows[labels.index(None)]
        raise row.error(
            "the name of a landmark (text, or an integer from 0 on)", repr(row.cells[column][:40])
        )
    return np.array(labels, object)
