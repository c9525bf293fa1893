"""Landmark logs as one CSV table, which any program can write and read.

A row is a pose or an observation, and the header says what its cells are:

    time                            seconds, or the number of the pose; never goes back
    x, y, heading                   of the first row alone: where the log begins
    forward, left, turn             the way from the last pose to this one, in the frame of the
      or distance, turn             last one; or turned before driven
    cov_forward_forward, ...        its covariance, upper triangle
    landmark                        the identity of what was seen; empty where it is not known
    range, bearing                  of an observation from the last pose above
    cov_range_range, ...            its covariance, upper triangle

The first row is the first pose and has no control; every other row has either a control or an
observation. An empty covariance between two things is zero. Metres and radians.
"""

import csv
from collections.abc import Iterator
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from saccade.datasets.table import write_table
from saccade.datasets.text import numbers, read_lines
from saccade.errors import LogError
from saccade.types import FloatArray, LandmarkLog

_START = ("x", "y", "heading")
_OBSERVED = ("range", "bearing")
_CONTROLS = {"compose": ("forward", "left", "turn"), "drive": ("distance", "turn")}


def covariance_names(names: tuple[str, ...]) -> list[str]:
    """The columns of the covariance of some quantities."""
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]


def columns_of(motion: str) -> list[str]:
    """The header of a log whose controls are "compose" or "drive"."""
    control = _CONTROLS[motion]
    return [
        "time",
        *_START,
        *control,
        *covariance_names(control),
        "landmark",
        *_OBSERVED,
        *covariance_names(_OBSERVED),
    ]


def write_log_csv(path: str | Path, log: LandmarkLog) -> None:
    """Write a log with every digit; truth is not part of it.

    Raises:
        LogError: the controls are of a model of the log's own.
        OutputError: the file cannot be written.
    """
    if log.motion not in _CONTROLS:
        raise LogError(f"{log.name}: expected controls of drive or compose, found those of a model")
    control = _CONTROLS[log.motion]
    poses, seen = len(log.time), len(log.observation)
    place = np.arange(poses) + np.searchsorted(log.observation_pose, np.arange(poses))
    sight = np.arange(seen) + log.observation_pose + 1
    table = {name: np.full(poses + seen, np.nan) for name in columns_of(log.motion)}
    table["time"][place], table["time"][sight] = log.time, log.time[log.observation_pose]
    for i, name in enumerate(_START):
        table[name][0] = log.start[i]
    for i, name in enumerate(control):
        table[name][place[1:]] = log.control[:, i]
    for i, name in enumerate(_OBSERVED):
        table[name][sight] = log.observation[:, i]
    for names, rows, matrices in (
        (control, place[1:], log.control_covariance),
        (_OBSERVED, sight, log.observation_covariance),
    ):
        upper = matrices[:, *np.triu_indices(len(names))]
        for i, name in enumerate(covariance_names(names)):
            table[name][rows] = upper[:, i]
    identity = np.full(poses + seen, "", dtype=object)
    identity[sight] = ["" if name < 0 else str(name) for name in log.landmark.tolist()]
    write_table(path, table | {"landmark": identity})


def read_log_csv(path: str | Path) -> LandmarkLog:
    """Read a log.

    Args:
        path: a table with the columns that `log_csv` names, in any order; the covariances
            between two things may be left out.

    Raises:
        LogError: no such file, another header, or a row that is neither a pose nor an
            observation; names the line.
    """
    path = Path(path)
    rows = csv.reader(read_lines(path))
    header = [name.strip() for name in next(rows, [])]
    motion = "drive" if "distance" in header else "compose"
    _check_header(path, header, motion)
    table = _Table(path, header, motion)
    try:
        for cells in rows:
            if any(cell.strip() for cell in cells):
                table.add(rows.line_num, cells)
    except csv.Error as error:
        raise LogError(f"{path}, line {rows.line_num}: expected cells, found {error}") from error
    return table.log()


def _check_header(path: Path, header: list[str], motion: str) -> None:
    known = columns_of(motion)
    strange = [name for name in header if name not in known]
    needed = ["time", *_CONTROLS[motion], *_OBSERVED]
    needed += [f"cov_{name}_{name}" for name in (*_CONTROLS[motion], *_OBSERVED)]
    missing = [name for name in needed if name not in header]
    if strange or missing or len(set(header)) < len(header):
        wrong = f"{strange[0][:40]!r}" if strange else f"no {', '.join(missing)}"
        raise LogError(
            f"{path}, line 1: expected the columns {', '.join(known)}, each once, "
            f"found {wrong if strange or missing else 'one twice'}"
        )


class _Table:
    """A log as it is read, row by row."""

    def __init__(self, path: Path, header: list[str], motion: str) -> None:
        self.path, self.header, self.motion = path, header, motion
        self.control_names = _CONTROLS[motion]
        self.start = np.zeros(3)
        self.time: list[float] = []
        self.control: list[list[float]] = []
        self.control_covariance: list[FloatArray] = []
        self.pose: list[int] = []
        self.observation: list[list[float]] = []
        self.observation_covariance: list[FloatArray] = []
        self.landmark: list[int] = []

    def add(self, line: int, cells: list[str]) -> None:
        where = f"{self.path}, line {line}"
        if len(cells) != len(self.header):
            raise LogError(f"{where}: expected {len(self.header)} cells, found {len(cells)}")
        row = {n: c.strip() for n, c in zip(self.header, cells, strict=True) if c.strip()}
        moved = any(name in row for name in self.control_names)
        saw = any(name in row for name in _OBSERVED)
        if not self.time:
            if moved or saw:
                raise LogError(f"{where}: expected the first pose, found {', '.join(row)}")
            self.start = np.array([self._numbers(line, row, (n,), "0")[0] for n in _START])
        elif moved == saw:
            both = "both" if moved else "neither"
            raise LogError(
                f"{where}: expected {', '.join(self.control_names)} or {', '.join(_OBSERVED)}, "
                f"found {both}"
            )
        (time,) = self._numbers(line, row, ("time",))
        if saw:
            self._add_observation(line, row, time)
            return
        if self.time and time < self.time[-1]:
            raise LogError(f"{where}: time goes back from {self.time[-1]:g} to {time:g}")
        self.time.append(time)
        if moved:
            self.control.append(self._numbers(line, row, self.control_names))
            self.control_covariance.append(self._covariance(line, row, self.control_names))

    def log(self) -> LandmarkLog:
        if not self.time:
            raise LogError(f"{self.path}: expected a row for the first pose, found none")
        d = len(self.control_names)
        return LandmarkLog(
            name=self.path.stem,
            start=self.start,
            time=np.array(self.time),
            motion="drive" if self.motion == "drive" else "compose",
            control=np.array(self.control).reshape(-1, d),
            control_covariance=np.array(self.control_covariance).reshape(-1, d, d),
            observation_pose=np.array(self.pose, np.int64),
            observation=np.array(self.observation).reshape(-1, 2),
            observation_covariance=np.array(self.observation_covariance).reshape(-1, 2, 2),
            landmark=np.array(self.landmark, np.int64),
        )

    def _add_observation(self, line: int, row: dict[str, str], time: float) -> None:
        if time != self.time[-1]:
            raise LogError(
                f"{self.path}, line {line}: expected an observation at the time of the pose above, "
                f"{self.time[-1]:g}, found {time:g}"
            )
        identity = row.get("landmark", "-1")
        if identity != "-1" and not (identity.isascii() and identity.isdecimal()):
            raise LogError(
                f"{self.path}, line {line}: expected the number of a landmark, found {identity!r}"
            )
        if len(identity) > 18:
            raise LogError(f"{self.path}, line {line}: expected up to 18 digits, found {identity}")
        self.landmark.append(int(identity))
        self.pose.append(len(self.time) - 1)
        self.observation.append(self._numbers(line, row, _OBSERVED))
        self.observation_covariance.append(self._covariance(line, row, _OBSERVED))

    def _numbers(
        self, line: int, row: dict[str, str], names: tuple[str, ...], default: str = "nothing"
    ) -> list[float]:
        return numbers(self.path, line, [row.get(name, default) for name in names])

    def _covariance(self, line: int, row: dict[str, str], names: tuple[str, ...]) -> FloatArray:
        upper = [
            row.get(name, "nothing" if name in _variances(names) else "0")
            for name in covariance_names(names)
        ]
        matrix = np.zeros((len(names), len(names)))
        matrix[np.triu_indices(len(names))] = numbers(self.path, line, upper)
        return np.asarray(matrix + np.triu(matrix, 1).T)


def _variances(names: tuple[str, ...]) -> Iterator[str]:
    return (f"cov_{name}_{name}" for name in names)
