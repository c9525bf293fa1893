"""The text formats of g2o, iSAM, TORO and GTSAM: poses in a chain, landmarks seen from them.

    EDGE_SE2    from to forward left turn  a b c d e f      (g2o)
    EDGE2       from to forward left turn  a b c d e f      (iSAM, TORO)
    ODOMETRY    from to forward left turn  a b c d e f      (iSAM, GTSAM)
    EDGE_SE2_XY pose landmark forward left  a b c           (g2o)
    LANDMARK    pose landmark forward left  a b c           (iSAM, GTSAM)
    BR          pose landmark bearing range  sigma sigma    (GTSAM)
    VERTEX_SE2  pose x y heading                            (VERTEX2 in TORO)
    VERTEX_XY   landmark x y
    FIX         pose

The last numbers of an edge are a symmetric or a triangular matrix, and no two dialects agree
on which; `Entries` names them. Vertices are a first guess: the one of the first pose says where
the log begins, all else of them is left out.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.logs.cartesian import to_range_bearing
from saccade.datasets.text import fields, numbers, read_lines
from saccade.errors import LogError, require
from saccade.types import FloatArray, LandmarkLog

Entries: TypeAlias = Literal["auto", "covariance", "information", "root", "toro"]
"""What the matrix of a line is.

- "covariance": its upper triangle row by row, as the Victoria Park file has it
  that GTSAM distributes (`ODOMETRY` lines).
- "information": the upper triangle of the inverse of the covariance, row by row, as g2o has it.
- "root": the upper triangular square root of the information, row by row, as
  iSAM has it (`EDGE2` lines; in cityTrees10000 the entry 50 goes with a noise of
  0.02 m).
- "toro": information in TORO's order: xx, xy, yy, tt, xt, yt.
- "auto": "information" where the file has `EDGE_SE2` lines, "toro" where it has `VERTEX2`
  lines, "covariance" where its first edge is `ODOMETRY`, else "root".
"""
TORO_ORDER = (0, 1, 4, 2, 5, 3)
"""Where TORO keeps each of xx, xy, xt, yy, yt, tt."""

_EDGES = {"EDGE_SE2": 12, "EDGE2": 12, "ODOMETRY": 12}
_OBSERVATIONS = {"EDGE_SE2_XY": 8, "LANDMARK": 8, "BR": 7}
_POSES = {"VERTEX_SE2": 5, "VERTEX2": 5}
_FIELDS = {**_EDGES, **_OBSERVATIONS, **_POSES, "VERTEX_XY": 4, "FIX": 2}
"""How many words a line of each kind has."""


@dataclass(frozen=True)
class _Line:
    """What stands in a line that begins with `tag`."""

    number: int
    tag: str
    first: int
    second: int
    values: list[float]


@dataclass
class _Lines:
    """What stands in the file, kind by kind."""

    edges: list[_Line] = field(default_factory=list)
    observations: list[_Line] = field(default_factory=list)
    vertex: dict[int, list[float]] = field(default_factory=dict)
    tags: set[str] = field(default_factory=set)


def read_isam(path: str | Path, entries: Entries = "auto") -> LandmarkLog:
    """Read a g2o, iSAM, TORO or GTSAM text log.

    Args:
        path: the file.
        entries: what the matrices in the file are.

    Returns:
        A log of relative poses; its times are the file's numbers of the poses, and it begins
        where the vertex of the first pose is, or at the origin.

    Raises:
        LogError: no such file, an unknown or broken line, poses that are not a
            chain, or a matrix that is no covariance; names the line.
        ConfigError: `entries` is none of the known ones.
    """
    require(entries in get_args(Entries), "entries", f"one of {get_args(Entries)}", entries)
    path = Path(path)
    found = _parse(path)
    kind = _dialect(found) if entries == "auto" else entries
    edges = _chain(path, found.edges)
    pose = [edges[0].first, *(edge.second for edge in edges)]
    sightings = sorted(found.observations, key=lambda line: line.first)
    seen_from = np.array([line.first for line in sightings], np.int64)
    number = np.searchsorted(pose, seen_from)
    for k in np.flatnonzero(np.append(pose, -1)[number] != seen_from)[:1].tolist():
        line = sightings[k]
        raise LogError(
            f"{path}, line {line.number}: expected a pose of the log, found {line.first}"
        )
    control = np.array([edge.values for edge in edges])  # (t, 9)
    order = TORO_ORDER if kind == "toro" else range(6)
    upper = control[:, 3:][:, list(order)]
    observation, covariance = _observations(path, sightings, kind)
    return LandmarkLog(
        name=path.stem,
        start=np.array(found.vertex.get(pose[0], [0.0, 0.0, 0.0])),
        time=np.array(pose, np.float64),
        motion="compose",
        control=control[:, :3],
        control_covariance=_covariances(path, [edge.number for edge in edges], upper, kind),
        observation_pose=number.astype(np.int64),
        observation=observation,
        observation_covariance=covariance,
        landmark=np.array([line.second for line in sightings], np.int64),
    )


def _parse(path: Path) -> _Lines:
    found = _Lines()
    for number, words in fields(read_lines(path)):
        tag = words[0]
        if tag not in _FIELDS:
            raise LogError(
                f"{path}, line {number}: expected {', '.join(_FIELDS)}, found {tag[:40]!r}"
            )
        if len(words) != _FIELDS[tag]:
            raise LogError(
                f"{path}, line {number}: expected {_FIELDS[tag]} fields in a line of {tag}, "
                f"found {len(words)}"
            )
        found.tags.add(tag)
        first = _identity(path, number, words[1])
        if tag in _POSES:
            found.vertex[first] = numbers(path, number, words[2:])
        if tag not in _EDGES and tag not in _OBSERVATIONS:
            continue
        second = _identity(path, number, words[2])
        line = _Line(number, tag, first, second, numbers(path, number, words[3:]))
        (found.edges if tag in _EDGES else found.observations).append(line)
    if not found.edges:
        raise LogError(f"{path}: expected lines of {', '.join(_EDGES)}, found none")
    return found


def _dialect(found: _Lines) -> Entries:
    if found.tags & {"EDGE_SE2", "EDGE_SE2_XY"}:
        return "information"
    if "VERTEX2" in found.tags:
        return "toro"
    return "covariance" if found.edges[0].tag == "ODOMETRY" else "root"


def _chain(path: Path, edges: list[_Line]) -> list[_Line]:
    """The edges in the order of the drive."""
    edges = sorted(edges, key=lambda line: line.first)
    last = edges[0].first
    for edge in edges:
        if edge.first != last or edge.second <= edge.first:
            raise LogError(
                f"{path}, line {edge.number}: expected an edge from pose {last} to a later one, "
                f"found {edge.first} to {edge.second}; a log is one chain of poses, without loop "
                "closures"
            )
        last = edge.second
    return edges


def _observations(
    path: Path, sightings: list[_Line], kind: Entries
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing (k, 2) and their covariance (k, 2, 2)."""
    observation, covariance = np.empty((len(sightings), 2)), np.empty((len(sightings), 2, 2))
    polar = np.array([line.tag == "BR" for line in sightings], bool)
    lines = [line for line in sightings if line.tag != "BR"]
    values = np.array([line.values for line in lines]).reshape(-1, 5)
    observation[~polar], covariance[~polar] = to_range_bearing(
        values[:, :2],
        _covariances(path, [line.number for line in lines], values[:, 2:], kind),
        [f"{path}, line {line.number}" for line in lines],
    )
    for k in np.flatnonzero(polar).tolist():
        bearing, distance, bearing_sigma, range_sigma = sightings[k].values
        if distance < 0 or min(bearing_sigma, range_sigma) < 0:
            raise LogError(
                f"{path}, line {sightings[k].number}: expected a range and deviations of 0 or "
                f"more, found {sightings[k].values}"
            )
        observation[k] = distance, bearing
        covariance[k] = np.diag([range_sigma**2, bearing_sigma**2])
    return observation, covariance


def _identity(path: Path, line: int, word: str) -> int:
    if not (word.isascii() and word.isdecimal()) or len(word) > 18:  # more do not fit into 64 bits
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
