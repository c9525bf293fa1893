"""Pose-graph text of g2o, iSAM, TORO and GTSAM: a chain of poses, and landmarks observed from them.

    EDGE_SE2    from to forward left turn  a b c d e f      (g2o)
    EDGE2       from to forward left turn  a b c d e f      (iSAM, TORO)
    ODOMETRY    from to forward left turn  a b c d e f      (iSAM, GTSAM)
    EDGE_SE2_XY pose landmark forward left  a b c           (g2o)
    LANDMARK    pose landmark forward left  a b c           (iSAM, GTSAM)
    BR          pose landmark bearing range  sigma sigma    (GTSAM)
    VERTEX_SE2  pose x y heading                            (VERTEX2 in TORO)
    VERTEX_XY   landmark x y
    FIX         pose ...
    PARAMS_...  not used

The last numbers of an edge are a symmetric or triangular matrix, see `MatrixForm`. Vertices are
initial estimates; only the vertex of the first pose is read, as the start of the log.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from saccade.datasets.logs.conversions import require_numbered
from saccade.datasets.tables import Row, from_upper_triangle, read_rows, upper_triangle
from saccade.errors import LogError
from saccade.io.files import atomic_write
from saccade.plane import (
    path_of,
    point_covariance,
    relative_poses_of,
    rotated,
    to_points,
    to_range_bearing,
)
from saccade.types import FloatArray, IntArray, LandmarkLog

MatrixForm: TypeAlias = Literal["covariance", "information", "root", "toro"]
"""Form of the matrix of an edge.

- "covariance": its upper triangle row by row, as in the Victoria Park file that GTSAM
  distributes (`ODOMETRY` lines).
- "information": the upper triangle of the inverse of the covariance, row by row, as in g2o.
- "root": the upper triangular square root of the information, row by row, as in iSAM (`EDGE2`
  lines; in cityTrees10000 the entry 50 goes with a noise of 0.02 m).
- "toro": information in TORO's order: xx, xy, yy, tt, xt, yt.
"""
TORO_ORDER = (0, 1, 4, 2, 5, 3)
"""Indices of xx, xy, xt, yy, yt, tt in TORO's order."""
MIN_SIGMA = 1e-4
"""Standard deviation (m, rad) added to a singular covariance to make it invertible."""

LARGEST_ID = 1 << 63
"""Exclusive upper bound of vertex numbers."""
INDEX = 1 << 56
"""Exclusive upper bound of the index in a GTSAM symbol, whose highest byte is a letter."""

_EDGES = {"EDGE_SE2": 12, "EDGE2": 12, "ODOMETRY": 12}
_OBSERVATIONS = {"EDGE_SE2_XY": 8, "LANDMARK": 8, "BR": 7}
_POSES = {"VERTEX_SE2": 5, "VERTEX2": 5}
FIELDS = {**_EDGES, **_OBSERVATIONS, **_POSES, "VERTEX_XY": 4}
"""Number of fields in a line of each tag."""


class _Edge(NamedTuple):
    """A line that joins two vertices."""

    row: Row
    tag: str
    first: int
    second: int
    values: list[float]


def read_pose_graph(path: str | Path) -> LandmarkLog:
    """Reads a g2o, iSAM, TORO or GTSAM text log.

    The form of the matrices is "information" for files with `EDGE_SE2` lines, "toro" for files with
    `VERTEX2` lines, "covariance" if the first edge is `ODOMETRY`, else "root".

    Returns:
        A log of relative poses that starts at the vertex of the first pose, or at the origin. Pose
        numbers serve as times.
    """
    path = Path(path)
    edges, observations, vertices, tags = _parse(path)
    form: MatrixForm = "root"
    if tags & {"EDGE_SE2", "EDGE_SE2_XY"}:
        form = "information"
    elif "VERTEX2" in tags:
        form = "toro"
    elif edges[0].tag == "ODOMETRY":
        form = "covariance"
    edges = _chain(edges)
    poses = [edges[0].first, *(edge.second for edge in edges)]
    observations.sort(key=lambda edge: edge.first)
    observed_from = np.array([edge.first for edge in observations], np.int64)
    pose_index = np.searchsorted(poses, observed_from)
    for k in np.flatnonzero(np.append(poses, -1)[pose_index] != observed_from)[:1].tolist():
        raise observations[k].row.error("a pose of the log", str(observations[k].first))
    values = np.array([edge.values for edge in edges])  # (t, 9)
    observation, observation_covariance = _read_observations(observations, form)
    return LandmarkLog(
        name=path.stem,
        start=np.array(vertices.get(poses[0], [0.0, 0.0, 0.0])),
        time=np.array([pose % INDEX for pose in poses], np.float64),
        control=values[:, :3],
        control_covariance=_covariances(edges, values[:, 3:], form),
        observation_pose=pose_index.astype(np.int64),
        observation=observation,
        observation_covariance=observation_covariance,
        landmark=np.array([edge.second for edge in observations], object),
    )


def _parse(path: Path) -> tuple[list[_Edge], list[_Edge], dict[int, list[float]], set[str]]:
    """Edges, observations, poses by number, and all tags."""
    edges: list[_Edge] = []
    observations: list[_Edge] = []
    vertices, tags = {}, set()
    for row in read_rows(path):
        tag = row.cells[0]
        if tag == "FIX":
            [row.integer(i, "the number of a pose", LARGEST_ID) for i in range(1, len(row.cells))]
        if tag == "FIX" or tag.startswith("PARAMS_"):
            continue
        if tag not in FIELDS:
            raise row.error(", ".join(FIELDS), repr(tag[:40]))
        row.require_cells(FIELDS[tag], f"fields in a line of {tag}")
        tags.add(tag)
        first = row.integer(1, "the number of a pose or landmark", LARGEST_ID)
        if tag in _POSES:
            vertices[first] = row.numbers(slice(2, None))
        if tag not in _EDGES and tag not in _OBSERVATIONS:
            continue
        second = row.integer(2, "the number of a pose or landmark", LARGEST_ID)
        edge = _Edge(row, tag, first, second, row.numbers(slice(3, None)))
        (edges if tag in _EDGES else observations).append(edge)
    if not edges:
        raise LogError(f"{path}: expected lines of {', '.join(_EDGES)}, found none")
    return edges, observations, vertices, tags


def _chain(edges: list[_Edge]) -> list[_Edge]:
    """The edges in the order of the poses."""
    edges = sorted(edges, key=lambda edge: edge.first)
    last = edges[0].first
    for edge in edges:
        if edge.first != last or edge.second <= edge.first:
            raise edge.row.error(
                f"an edge from pose {last} to a later one",
                f"{edge.first} to {edge.second}; a log is one chain of poses, without loop "
                "closures",
            )
        last = edge.second
    return edges


def _read_observations(
    observations: list[_Edge], form: MatrixForm
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing (k, 2) and their covariance (k, 2, 2)."""
    k = len(observations)
    observation, covariance = np.empty((k, 2)), np.empty((k, 2, 2))
    polar = np.array([edge.tag == "BR" for edge in observations], bool)
    edges = [edge for edge in observations if edge.tag != "BR"]
    values = np.array([edge.values for edge in edges]).reshape(-1, 5)
    observation[~polar], covariance[~polar] = to_range_bearing(
        values[:, :2],
        _covariances(edges, values[:, 2:], form),
        lambda i: f"{edges[i].row.path}, line {edges[i].row.line}",
    )
    for i in np.flatnonzero(polar).tolist():
        edge = observations[i]
        bearing, distance, bearing_sigma, range_sigma = edge.values
        if min(distance, bearing_sigma, range_sigma) < 0:
            raise edge.row.error("a range and standard deviations of 0 or more", str(edge.values))
        observation[i] = distance, bearing
        covariance[i] = np.diag([range_sigma**2, bearing_sigma**2])
    return observation, covariance


def _covariances(edges: list[_Edge], entries: FloatArray, form: MatrixForm) -> FloatArray:
    """Covariances (n, d, d) from the entries (n, d (d + 1) / 2) of the file."""
    if form == "toro" and entries.shape[1] == 6:
        entries = entries[:, list(TORO_ORDER)]
    matrices = from_upper_triangle(entries)
    if form == "root":
        root = np.triu(matrices)
        matrices = root.transpose(0, 2, 1) @ root
    eigenvalues = np.linalg.eigvalsh(matrices)
    threshold = 1e-12 * np.abs(eigenvalues[:, -1])
    smallest = eigenvalues[:, 0]
    invalid = smallest < -threshold if form == "covariance" else smallest <= threshold
    for i in np.flatnonzero(invalid)[:1].tolist():
        raise edges[i].row.error(f"the {form} entries of a covariance", str(entries[i].tolist()))
    return matrices if form == "covariance" else np.asarray(np.linalg.inv(matrices), np.float64)


def write_g2o(path: str | Path, log: LandmarkLog) -> None:
    """Write a log as g2o, with every digit.

    The format has no times: poses are numbered from 0, and landmarks follow the t + 1 poses. The
    vertices are initial estimates: poses from dead reckoning, landmarks from their first
    observation. Observations become Cartesian, to first order.

    Args:
        path: the file; replaced if it exists.
        log: log with an integer label for every landmark.
    """
    require_numbered(log, "g2o")
    for k in np.flatnonzero(log.observation[:, 0] < 1e-9)[:1].tolist():
        raise LogError(
            f"{log.name}, observation {k}: expected a landmark away from the robot, found range "
            f"{log.observation[k, 0]:g}"
        )
    control, control_covariance = relative_poses_of(log)
    covariance = point_covariance(log.observation, log.observation_covariance)
    points, number = to_points(log.observation), np.arange(len(log.time))
    pose = path_of(control)
    pose[:, :2] = log.start[:2] + rotated(pose[:, :2], log.start[2:])
    pose[:, 2] = np.angle(np.exp(1j * (log.start[2] + pose[:, 2])))
    landmarks, first = np.unique(log.landmark, return_index=True)
    before = pose[log.observation_pose[first]]
    xy = before[:, :2] + rotated(points[first], before[:, 2])
    observed = np.stack([log.observation_pose, len(pose) + log.landmark], 1)
    edges = np.hstack([control, _information(control_covariance)])
    sights = np.hstack([points, _information(covariance)])
    lines = [
        *_lines("VERTEX_SE2", number[:, None], pose),
        *_lines("VERTEX_XY", len(pose) + landmarks[:, None], xy),
        *_lines("EDGE_SE2", np.stack([number[:-1], number[1:]], 1), edges),
        *_lines("EDGE_SE2_XY", observed, sights),
        "FIX 0",  # last line, since GTSAM stops reading here
    ]
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _information(covariance: FloatArray) -> FloatArray:
    """The upper triangles (n, d (d + 1) / 2) of the inverses of covariances (n, d, d)."""
    singular = np.linalg.eigvalsh(covariance)[:, 0] < MIN_SIGMA**2
    added = MIN_SIGMA**2 * singular[:, None, None] * np.eye(covariance.shape[1])
    matrices = np.linalg.inv(covariance + added)
    return upper_triangle((matrices + matrices.transpose(0, 2, 1)) / 2)


def _lines(tag: str, vertices: IntArray, values: FloatArray) -> Iterator[str]:
    """Lines with a tag, vertex numbers (n, 1) or (n, 2), and values (n, k)."""
    for numbers, row in zip(vertices.tolist(), values.tolist(), strict=True):
        yield " ".join([tag, *map(str, numbers), *map(repr, row)])
