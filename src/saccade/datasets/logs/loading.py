"""Reads and writes landmark logs of every format."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from saccade.datasets.formats import AUTO, find_reader
from saccade.datasets.logs.conversions import OdometryNoise
from saccade.datasets.logs.formats import LOG_FORMATS
from saccade.errors import ConfigError, LogError, require
from saccade.plane import in_robot_frame
from saccade.types import LandmarkLog, invalid_range_bearing

Kind: TypeAlias = str | Callable[..., LandmarkLog]
"""A format: a name in `LOG_FORMATS`, "auto" to detect it, module:function, or a function of the
path."""
WHAT = "a landmark log"
"""What a path should be, for messages."""


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
        kind: format of the log, such as "csv"; see `Kind`.
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
    path = Path(path)
    kind, reader = find_reader(kind, path, LOG_FORMATS, WHAT, LogError)
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
    log: LandmarkLog = reader(path, **options)
    invalid = invalid_range_bearing(log.observation)
    if invalid is not None:
        number, expected, found = invalid
        raise LogError(f"{path}, observation {number}: expected {expected}, found {found}")
    return log if sensor is None else replace(log, sensor=sensor)


def save(path: str | Path, log: LandmarkLog, kind: str = AUTO) -> None:
    """Write a landmark log.

    Args:
        path: the file.
        log: the log.
        kind: "csv", which keeps everything except the true landmarks; "g2o", text without time
            stamps; another format of `LOG_FORMATS` that can be written; or "auto", by the suffix.

    Raises:
        LogError: the format cannot represent the log.
        OutputError: it cannot be written.
        ConfigError: unknown format.
    """
    path = Path(path)
    written = {name: form for name, form in LOG_FORMATS.items() if form.write is not None}
    name = kind
    if kind == AUTO:
        name = next((n for n, f in written.items() if path.suffix.lower() in f.suffixes), "")
        suffixes = " or ".join(suffix for form in written.values() for suffix in form.suffixes)
        require(name in written, "path", f"a file that ends in {suffixes}", str(path))
    require(name in written, "kind", f"one of {', '.join((AUTO, *written))}", kind)
    if name != "csv":
        log = in_robot_frame(log)
        for k in np.flatnonzero(np.isnan(log.observation).any(1))[:1].tolist():
            raise LogError(
                f"{log.name}, observation {k}: expected range and bearing, which {name} needs, "
                "found only one; write it as CSV"
            )
    write = written[name].write
    assert write is not None
    write(path, log)
