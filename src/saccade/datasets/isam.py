"""The text formats of iSAM, TORO and GTSAM: poses in a chain, landmarks seen from them.

    ODOMETRY from to forward left turn  a b c d e f
    EDGE2    from to forward left turn  a b c d e f
    LANDMARK pose landmark forward left  a b c
    VERTEX2  pose x y heading                        (a first guess: left out)

The last numbers of a line are a symmetric or a triangular matrix, and no two
dialects agree on which; `Entries` names them.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.cartesian import to_range_bearing
from saccade.datasets.text import fields, numbers, read_lines
from saccade.errors import LogError, require
from saccade.types import FloatArray, LandmarkLog

Entries: TypeAlias = Literal["auto", "covariance", "information", "root", "toro"]
"""What the matrix of a line is.

- "covariance": its upper triangle row by row, as the Victoria Park file has it
  that GTSAM distributes (`ODOMETRY` lines).
- "information": the upper triangle of the inverse of the covariance, row by row.
- "root": the upper triangular square root of the information, row by row, as
  iSAM has it (`EDGE2` lines; in cityTrees10000 the entry 50 goes with a noise of
  0.02 m).
- "toro": information in TORO's order: xx, xy, yy, tt, xt, yt.
- "auto": "toro" where the file has `VERTEX2` lines, else "covariance" where its
  first line is `ODOMETRY`, else "root".
"""

_FIELDS = {"ODOMETRY": 12, "EDGE2": 12, "LANDMARK": 8, "VERTEX2": 5}
_ROW_ORDER = (0, 1, 2, 3, 4, 5)
_TORO_ORDER = (0, 1, 4, 2, 5, 3)


@dataclass
class _Lines:
    """What stands in the file, line by line."""

    pose: list[int] = field(default_factory=list)
    control: list[list[float]] = field(default_factory=list)
    control_line: list[int] = field(default_factory=list)
    seen_from: list[int] = field(default_factory=list)
    landmark: list[int] = field(default_factory=list)
    sighting: list[list[float]] = field(default_factory=list)
    sighting_line: list[int] = field(default_factory=list)
    dialect: Entries = "root"


def read_isam(path: str | Path, entries: Entries = "auto") -> LandmarkLog:
    """Read an iSAM, TORO or GTSAM text log.

    Args:
        path: the file.
        entries: what the matrices in the file are.

    Returns:
        A log of relative poses from the origin; its times are the file's numbers of the poses.

    Raises:
        LogError: no such file, an unknown or broken line, poses that are not a
            chain, or a matrix that is no covariance; names the line.
        ConfigError: `entries` is none of the known ones.
    """
    require(entries in get_args(Entries), "entries", f"one of {get_args(Entries)}", entries)
    path = Path(path)
    lines = _parse(path)
    kind = lines.dialect if entries == "auto" else entries
    control = np.array(lines.control, np.float64)  # (t, 9)
    sighting = np.array(lines.sighting, np.float64).reshape(-1, 5)  # (k, 5)
    order = _TORO_ORDER if kind == "toro" else _ROW_ORDER
    places = [f"{path}, line {line}" for line in lines.sighting_line]
    observation, observation_covariance = to_range_bearing(
        sighting[:, :2],
        _covariances(path, lines.sighting_line, sighting[:, 2:], kind),
        places,
    )
    seen_from = np.array(lines.seen_from, np.int64)
    number = np.searchsorted(lines.pose, seen_from)
    for k in np.flatnonzero(np.append(lines.pose, -1)[number] != seen_from)[:1]:
        raise LogError(f"{places[k]}: expected a pose of the log, found {seen_from[k]}")
    sort = np.argsort(number, kind="stable")
    return LandmarkLog(
        name=path.stem,
        start=np.zeros(3),
        time=np.array(lines.pose, np.float64),
        motion="compose",
        control=control[:, :3],
        control_covariance=_covariances(path, lines.control_line, control[:, 3:][:, order], kind),
        observation_pose=number[sort],
        observation=observation[sort],
        observation_covariance=observation_covariance[sort],
        landmark=np.array(lines.landmark, np.int64)[sort],
    )


def _parse(path: Path) -> _Lines:
    found = _Lines()
    tags: list[str] = []
    for line, words in fields(read_lines(path)):
        tag = words[0]
        if tag not in _FIELDS:
            raise LogError(
                f"{path}, line {line}: expected ODOMETRY, EDGE2, LANDMARK or VERTEX2, "
                f"found {tag[:40]!r}"
            )
        if len(words) != _FIELDS[tag]:
            raise LogError(
                f"{path}, line {line}: expected {_FIELDS[tag]} fields in a line of {tag}, "
                f"found {len(words)}"
            )
        if tag == "VERTEX2":
            tags.append(tag)
            continue
        first, second = _identity(path, line, words[1]), _identity(path, line, words[2])
        values = numbers(path, line, words[3:])
        if tag == "LANDMARK":
            found.seen_from.append(first)
            found.landmark.append(second)
            found.sighting.append(values)
            found.sighting_line.append(line)
            continue
        tags.append(tag)
        if not found.pose:
            found.pose.append(first)
        if first != found.pose[-1] or second <= first:
            raise LogError(
                f"{path}, line {line}: expected an edge from pose {found.pose[-1]} to a later one, "
                f"found {first} to {second}; a log is one chain of poses, without loop closures"
            )
        found.pose.append(second)
        found.control.append(values)
        found.control_line.append(line)
    if not found.pose:
        raise LogError(f"{path}: expected ODOMETRY or EDGE2 lines, found none")
    if "VERTEX2" in tags:
        found.dialect = "toro"
    elif tags[0] == "ODOMETRY":
        found.dialect = "covariance"
    return found


def _identity(path: Path, line: int, word: str) -> int:
    if not word.isdecimal() or len(word) > 18:  # more digits do not fit into 64 bits
        raise LogError(
            f"{path}, line {line}: expected the number of a pose or landmark, found {word!r}"
        )
    return int(word)


def _covariances(path: Path, lines: list[int], upper: FloatArray, kind: Entries) -> FloatArray:
    """Covariances (n, d, d) from the upper triangles of what the file has, row by row."""
    d = 2 if upper.shape[1] == 3 else 3
    triangle = np.zeros((len(upper), d, d))
    triangle[:, *np.triu_indices(d)] = upper
    full = triangle + np.triu(triangle, 1).transpose(0, 2, 1)
    if kind == "root":
        full = triangle.transpose(0, 2, 1) @ triangle
    values = np.linalg.eigvalsh(full)
    bad = values[:, 0] < -1e-12 * np.abs(values[:, -1])
    if kind != "covariance":
        bad = values[:, 0] <= 1e-12 * np.abs(values[:, -1])
    if bad.any():
        i = int(np.argmax(bad))
        raise LogError(
            f"{path}, line {lines[i]}: expected the {kind} entries of a covariance, "
            f"found {upper[i].tolist()}"
        )
    return full if kind == "covariance" else np.asarray(np.linalg.inv(full), np.float64)
