"""Reads and writes landmark logs of every format."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from saccade.datasets.logs.conversions import OdometryNoise
from saccade.datasets.logs.log_csv import LOG_FILE, read_log_csv, write_log_csv
from saccade.datasets.logs.mrclam import read_mrclam
from saccade.datasets.logs.pose_graph import read_pose_graph, write_g2o
from saccade.datasets.ros.bags import BAG_SUFFIXES, bag_files
from saccade.datasets.ros.logs import read_rosbag_log
from saccade.errors import ConfigError, LogError, require
from saccade.plane import in_robot_frame
from saccade.types import LandmarkLog, invalid_range_bearing

Kind: TypeAlias = Literal["auto", "csv", "g2o", "isam", "mrclam", "rosbag"]
"""Formats to read; "auto" detects the format from the path and the content."""
Format: TypeAlias = Literal["auto", "csv", "g2o"]
"""Formats to write; "auto" chooses by the suffix of the file."""
_READERS: dict[str, Callable[..., LandmarkLog]] = {
    "csv": read_log_csv,
    "g2o": read_pose_graph,
    "isam": read_pose_graph,
    "mrclam": read_mrclam,
    "rosbag": read_rosbag_log,
}
_WRITERS: dict[str, Callable[[Path, LandmarkLog], None]] = {
    "csv": write_log_csv,
    "g2o": write_g2o,
}
_FOLDERS: dict[str, Kind] = {"Barcodes.dat": "mrclam", LOG_FILE: "csv", "metadata.yaml": "rosbag"}
"""Formats by a file in a folder."""
_FILES: dict[str, Kind] = {
    ".csv": "csv",
    **dict.fromkeys(BAG_SUFFIXES, "rosbag"),
    ".npz": "mrclam",
}
"""Formats by the suffix of a file."""


def load(
    kind: Kind,
    path: str | Path,
    *,
    robot: int | None = None,
    odometry_noise: OdometryNoise | None = None,
    sensor_sigma: tuple[float, float] | None = None,
    topic: Sequence[str] | None = None,
    sensor: tuple[float, float, float] | None = None,
) -> LandmarkLog:
    """Read a landmark log. Each format has its own defaults for options left at None.

    Args:
        kind: "csv" (a file, or a folder with log.csv), "g2o" or "isam" (both read g2o, iSAM, TORO
            and GTSAM text), "mrclam" (folder or .npz), "rosbag" (ROS 1 and 2), or "auto".
        path: the file or folder.
        robot: mrclam: number of the robot, 1 to 5; default 1.
        odometry_noise: mrclam: random odometry errors; rosbag: errors of odometry without
            covariance.
        sensor_sigma: mrclam: standard deviations of range (m) and bearing (rad); rosbag: for
            observations without covariance, with the range sigma as a fraction of the range.
        topic: rosbag: landmark topics; by default the first topic of a known type.
        sensor: pose of the sensor in the robot frame, see `LandmarkLog.sensor`; by default from
            the CSV. Observations of a bag are already transformed by tf.

    Raises:
        LogError: the file is missing, broken, or of a different format; the message names it.
        ConfigError: unknown kind, an option that does not apply to this kind, or a standard
            deviation that is not positive.
    """
    require(kind in get_args(Kind), "kind", f"one of {', '.join(get_args(Kind))}", kind)
    path = Path(path)
    if not path.exists():
        raise LogError(f"{path}: expected a landmark log, found no such file or folder")
    if kind == "auto":
        kind = detect_format(path)
    reader = _READERS[kind]
    given: dict[str, Any] = {
        "robot": robot,
        "odometry_noise": odometry_noise,
        "sensor_sigma": sensor_sigma,
        "topic": topic,
    }
    options = {name: value for name, value in given.items() if value is not None}
    for name in options.keys() - signature(reader).parameters.keys():
        raise ConfigError(f"{name}: {path} read as {kind} has no such option; leave it out")
    if sensor_sigma is not None:
        require(min(sensor_sigma) > 0, "sensor_sigma", "two positive numbers", sensor_sigma)
    log = reader(path, **options)
    invalid = invalid_range_bearing(log.observation)
    if invalid is not None:
        number, expected, found = invalid
        raise LogError(f"{path}, observation {number}: expected {expected}, found {found}")
    return log if sensor is None else replace(log, sensor=sensor)


def save(path: str | Path, log: LandmarkLog, kind: Format = "auto") -> None:
    """Write a landmark log.

    Args:
        path: the file.
        log: the log.
        kind: "csv", which keeps everything except the true landmarks; "g2o", text without time
            stamps; or "auto", by the suffix of the file.

    Raises:
        LogError: the format cannot represent the log.
        OutputError: it cannot be written.
        ConfigError: unknown format.
    """
    require(kind in get_args(Format), "kind", f"one of {', '.join(get_args(Format))}", kind)
    path = Path(path)
    name = path.suffix.lower().removeprefix(".") if kind == "auto" else kind
    require(name in _WRITERS, "path", "a file that ends in .csv or .g2o", str(path))
    if name != "csv":
        log = in_robot_frame(log)
        for k in np.flatnonzero(np.isnan(log.observation).any(1))[:1].tolist():
            raise LogError(
                f"{log.name}, observation {k}: expected range and bearing, which {name} needs, "
                "found only one; write it as CSV"
            )
    _WRITERS[name](path, log)


def detect_format(path: Path) -> Kind:
    """Format of a file or folder."""
    if path.is_dir():
        for name, kind in _FOLDERS.items():
            if (path / name).exists():
                return kind
        if bag_files(path):
            return "rosbag"
        names = ", ".join(f"{name} ({kind})" for name, kind in _FOLDERS.items())
        raise LogError(f"{path}: expected a folder with any of {names}, found none")
    return _FILES.get(path.suffix.lower(), "isam")
