"""Landmark logs as the text formats of g2o, iSAM, TORO and GTSAM; see `isam` for their lines."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.logs.cartesian import to_cartesian, to_relative_poses
from saccade.datasets.logs.isam import TORO_ORDER
from saccade.errors import LogError, require
from saccade.files import atomic_write
from saccade.types import FloatArray, LandmarkLog

Dialect: TypeAlias = Literal["g2o", "isam", "toro", "gtsam"]
"""Which lines and matrices: `EDGE_SE2` with information, `EDGE2` with its root, `EDGE2` with
information in TORO's order, or `ODOMETRY` with covariances."""
THINNEST = 1e-4
"""Metres and radians: what a singular covariance gets in every direction, since its inverse
could not be written."""

_EDGE = {"g2o": "EDGE_SE2", "isam": "EDGE2", "toro": "EDGE2", "gtsam": "ODOMETRY"}
_VERTEX = {"g2o": "VERTEX_SE2", "toro": "VERTEX2"}


def write_isam(
    path: str | Path, log: LandmarkLog, dialect: Dialect, range_bearing: bool = False
) -> None:
    """Write a log as text, every digit of it.

    The formats have no clock: poses are numbered from 0. In g2o poses and landmarks share one
    numbering, in which the landmarks come after the t + 1 poses. Where the log begins is kept by
    g2o and TORO alone. Observations become places in the frame of the robot, to first order.

    Args:
        path: the file; replaced if it exists.
        log: with the identity of every landmark.
        dialect: which lines.
        range_bearing: write observations as ranges and bearings, as GTSAM reads them (`BR`).

    Raises:
        LogError: an observation has no identity, or cannot be written as it is.
        OutputError: the file cannot be written.
        ConfigError: no such dialect.
    """
    require(dialect in get_args(Dialect), "dialect", f"one of {get_args(Dialect)}", dialect)
    if (log.landmark < 0).any():
        raise LogError(
            f"{log.name}: expected the identity of every landmark, which {dialect} needs, found "
            f"none for {int((log.landmark < 0).sum())} observations; write it as CSV"
        )
    lines = [
        *_vertices(log, dialect),
        *_edges(log, dialect),
        *(_polar(log, dialect) if range_bearing else _observations(log, dialect)),
        *(["FIX 0"] if dialect == "g2o" else []),  # at the end: GTSAM reads no farther
    ]
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _vertices(log: LandmarkLog, dialect: Dialect) -> Iterator[str]:
    """A first guess: poses from odometry, landmarks where they were first seen."""
    if dialect not in _VERTEX:
        return
    control, _ = to_relative_poses(log)
    x, y, theta = log.start.tolist()
    pose = [(x, y, theta)]
    for forward, left, turn in control.tolist():
        c, s = np.cos(theta), np.sin(theta)
        x, y, theta = x + c * forward - s * left, y + s * forward + c * left, theta + turn
        pose.append((float(x), float(y), float(np.arctan2(np.sin(theta), np.cos(theta)))))
    for number, here in enumerate(pose):
        yield _line(_VERTEX[dialect], [number], here)
    if dialect != "g2o":
        return
    identity, first = np.unique(log.landmark, return_index=True)
    for name, k in zip(identity.tolist(), first.tolist(), strict=True):
        x, y, theta = pose[int(log.observation_pose[k])]
        distance, bearing = log.observation[k].tolist()
        place = x + distance * np.cos(theta + bearing), y + distance * np.sin(theta + bearing)
        yield _line("VERTEX_XY", [len(pose) + name], map(float, place))


def _edges(log: LandmarkLog, dialect: Dialect) -> Iterator[str]:
    control, covariance = to_relative_poses(log)
    for step, (u, entries) in enumerate(zip(control, _entries(covariance, dialect), strict=True)):
        yield _line(_EDGE[dialect], [step, step + 1], [*u.tolist(), *entries])


def _observations(log: LandmarkLog, dialect: Dialect) -> Iterator[str]:
    xy, covariance = to_cartesian(log.observation, log.observation_covariance)
    near = log.observation[:, 0] < 1e-9
    if near.any():
        raise LogError(
            f"{log.name}, observation {int(np.argmax(near))}: expected a landmark away from the "
            "robot, found range 0"
        )
    tag = "EDGE_SE2_XY" if dialect == "g2o" else "LANDMARK"
    for k, entries in enumerate(_entries(covariance, dialect)):
        yield _line(tag, _ends(log, dialect, k), [*xy[k].tolist(), *entries])


def _polar(log: LandmarkLog, dialect: Dialect) -> Iterator[str]:
    covariance = log.observation_covariance
    if covariance[:, 0, 1].any():
        k = int(np.argmax(covariance[:, 0, 1] != 0))
        raise LogError(
            f"{log.name}, observation {k}: expected range and bearing without correlation, which "
            f"a line of BR has no place for, found {float(covariance[k, 0, 1]):g}"
        )
    sigma = np.sqrt(covariance.diagonal(axis1=1, axis2=2))
    for k, (distance, bearing) in enumerate(log.observation.tolist()):
        values = [bearing, distance, float(sigma[k, 1]), float(sigma[k, 0])]
        yield _line("BR", _ends(log, dialect, k), values)


def _ends(log: LandmarkLog, dialect: Dialect, k: int) -> list[int]:
    after = len(log.time) if dialect == "g2o" else 0
    return [int(log.observation_pose[k]), after + int(log.landmark[k])]


def _entries(covariance: FloatArray, dialect: Dialect) -> list[list[float]]:
    """What a line has of each covariance (n, d, d)."""
    d = covariance.shape[1]
    matrix: FloatArray = covariance
    if dialect != "gtsam":
        thin = np.linalg.eigvalsh(covariance)[:, 0] < THINNEST**2
        matrix = np.asarray(
            np.linalg.inv(covariance + THINNEST**2 * thin[:, None, None] * np.eye(d))
        )
        matrix = (matrix + matrix.transpose(0, 2, 1)) / 2
    if dialect == "isam":
        matrix = np.asarray(np.linalg.cholesky(matrix).transpose(0, 2, 1), np.float64)
    upper = matrix[:, *np.triu_indices(d)]  # (n, 3) or (n, 6)
    if dialect == "toro" and d == 3:
        upper = upper[:, np.argsort(TORO_ORDER)]
    return list(upper.tolist())


def _line(tag: str, ends: list[int], values: Iterable[float]) -> str:
    return " ".join([tag, *map(str, ends), *map(repr, values)])
