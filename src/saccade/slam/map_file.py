"""Map files: a filter's map and its landmark table, for another day or another robot.

One .npz of plain arrays. Nothing in the file is executed when it is read.
"""

import hashlib
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import LogError
from saccade.io.files import FORMATS, atomic_write, check_format, reading
from saccade.io.npz import read_arrays, save_arrays
from saccade.landmark_names import parse_labels
from saccade.slam.config import EkfConfig
from saccade.slam.landmarks import CullingPolicy, LabelRecord, LandmarkRows, LandmarkTable
from saccade.types import FloatArray

Arrays: TypeAlias = dict[str, npt.NDArray[Any]]
KIND = "landmark map of saccade slam"
"""Name of the kind of file, in the file and in messages."""
ARRAYS = ("mean", "covariance", "heading_lever")
"""Arrays of a `SavedMap` that are saved as they are."""
TABLE_NUMBERS = (
    *("scans", "ambiguous", "forgotten", "culled", "session"),
    *("has_unlabeled", "max_range", "log_likelihood", "detections"),
)
"""Attributes of a `LandmarkTable` that are saved as they are."""


@dataclass(frozen=True, eq=False)
class SavedMap:
    """The content of a map file."""

    settings: dict[str, Any]
    """Settings of the filter that made the map, see `config`."""
    odometry_bias: tuple[float, float, float]
    """Standard deviations, as in `Slam`."""
    range_errors: tuple[float, float]
    """Standard deviations, as in `Slam`."""
    warning: str
    """Reason why the map may be wrong; empty without one."""
    num_steps: int
    """Number of steps so far."""
    time: float
    """Time of the last step, in the unit of its clock; minus infinity before the first."""
    mean: FloatArray
    """(n,) the robot's numbers, then the landmarks (C.3)."""
    covariance: FloatArray
    """(n, n) of the mean (C.4)."""
    heading_lever: FloatArray
    """(n,) see `filter._kernels`."""
    table: LandmarkTable
    """Its landmarks."""

    @property
    def config(self) -> EkfConfig:
        """The settings.

        Raises:
            ConfigError: the association rule is an own function, which is not in the file.
        """
        return EkfConfig(**self.settings)


def write_map(path: str | Path, saved: SavedMap) -> None:
    """Writes a map file, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    table = saved.table
    settings = {
        "config": saved.settings,
        "odometry_bias": saved.odometry_bias,
        "range_errors": saved.range_errors,
        "warning": saved.warning,
    }
    arrays: Arrays = {
        "kind": np.array(KIND),
        "format": np.array(FORMATS["slam_map"]),
        "settings": np.array(json.dumps(settings)),
        "num_steps": np.array(saved.num_steps),
        "time": np.array(saved.time),
        **{name: getattr(saved, name) for name in ARRAYS},
        **{f"landmark.{name}": each for name, each in vars(table.counts).items()},
        **{f"table.{name}": np.array(getattr(table, name)) for name in TABLE_NUMBERS},
        "labels": np.array([str(label) for label in table.labels], np.str_),
        "descriptor.id": np.array(list(table.descriptors), np.int64),
        "descriptor.value": np.array(list(table.descriptors.values())),
    }
    for field in fields(LabelRecord):
        column = [getattr(record, field.name) for record in table.labels.values()]
        arrays[f"label.{field.name}"] = np.array(column)
    arrays["checksum"] = np.array(_checksum(arrays))
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        save_arrays(file, arrays, compressed=False)


def read_map(path: str | Path) -> SavedMap:
    """Reads what `write_map` wrote.

    Raises:
        LogError: the file is unreadable, damaged, not a map, or has a different format version.
    """
    path = Path(path)
    with reading(path, LogError, f"a {KIND}, found no .npz or a damaged file", ValueError):
        arrays = read_arrays(path)
    if str(arrays.get("kind")) != KIND:
        raise LogError(f"{path}: expected a {KIND}, found another .npz")
    check_format("slam_map", int(arrays["format"]), path, LogError)
    if int(arrays["format"]) < FORMATS["slam_map"]:
        raise LogError(
            f"{path}: expected a {KIND} of format {FORMATS['slam_map']}, found "
            f"{int(arrays['format'])}, an earlier format; run the log again"
        )
    if str(arrays.pop("checksum", "")) != _checksum(arrays):  # kernels trust the shapes of arrays
        raise LogError(f"{path}: expected a {KIND}, found a damaged file")
    settings = json.loads(str(arrays["settings"]))
    settings["config"]["start_sigma"] = tuple(settings["config"]["start_sigma"])
    return SavedMap(
        settings=settings["config"],
        odometry_bias=tuple(settings["odometry_bias"]),
        range_errors=tuple(settings["range_errors"]),
        warning=settings["warning"],
        num_steps=int(arrays["num_steps"]),
        time=float(arrays["time"]),
        **{name: arrays[name] for name in ARRAYS},
        table=_table(arrays),
    )


def _table(arrays: Arrays) -> LandmarkTable:
    """The landmark table of a map file."""
    table = LandmarkTable(CullingPolicy(False, 1, 1))
    table.counts = LandmarkRows(**_columns(arrays, "landmark."))
    for name in TABLE_NUMBERS:
        value = arrays[f"table.{name}"]
        setattr(table, name, value if value.ndim > 0 else value.item())
    columns = _columns(arrays, "label.")
    lists = [list(each) if each.ndim > 1 else each.tolist() for each in columns.values()]
    labels = parse_labels(arrays["labels"])
    for label, values in zip(labels, zip(*lists, strict=True), strict=True):
        assert label is not None
        table.labels[label] = LabelRecord(**dict(zip(columns, values, strict=True)))
    ids = arrays["descriptor.id"].tolist()
    table.descriptors = dict(zip(ids, arrays["descriptor.value"], strict=True))
    return table


def _columns(arrays: Arrays, prefix: str) -> Arrays:
    found = {name: array for name, array in arrays.items() if name.startswith(prefix)}
    return {name.removeprefix(prefix): array for name, array in found.items()}


def _checksum(arrays: Arrays) -> str:
    """A hash of names, types, shapes and contents."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape} ".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
