"""Text logs of the University of Freiburg's course on robot mapping.

    ODOMETRY first_turn distance second_turn    in radians and meters
    SENSOR   landmark range bearing             observed after the last ODOMETRY

The format has neither times nor covariances: poses are numbered, and errors are assumed.
"""

import warnings
from pathlib import Path

import numpy as np

from saccade.datasets.logs.conversions import (
    ASSUMED,
    ASSUMED_ODOMETRY,
    ASSUMED_SENSOR,
    OdometryNoise,
    sensor_variances,
)
from saccade.datasets.tables import read_rows
from saccade.errors import LogError, LogWarning
from saccade.landmark_names import parse_name
from saccade.types import LandmarkLog

ODOMETRY = "ODOMETRY"
SENSOR = "SENSOR"


def read_freiburg(
    path: str | Path,
    odometry_noise: OdometryNoise = ASSUMED_ODOMETRY,
    sensor_sigma: tuple[float, float] = ASSUMED_SENSOR,
) -> LandmarkLog:
    """Reads a log of `ODOMETRY` and `SENSOR` lines.

    Args:
        path: the file.
        odometry_noise: random errors of odometry.
        sensor_sigma: standard deviations: range, as a fraction of it, and bearing in radians.

    Raises:
        LogError: another line, or a number that is missing.
    """
    path = Path(path)
    steps, poses, landmarks, seen = [], [], [], []
    for row in read_rows(path):
        word = row.cells[0]
        if word not in (ODOMETRY, SENSOR):
            raise row.error(f"{ODOMETRY} or {SENSOR}", repr(word[:40]))
        row.require_cells(4, "words")
        if word == ODOMETRY:
            steps.append(row.numbers(slice(1, 4)))
            continue
        label = parse_name(row.cells[1])
        if label is None:
            raise row.error("the number or the name of a landmark", repr(row.cells[1][:40]))
        poses.append(len(steps))
        landmarks.append(label)
        seen.append(row.numbers(slice(2, 4)))
    if not steps:
        raise LogError(f"{path}: expected {ODOMETRY} lines, found none")
    warnings.warn(
        f"{path}: the format has no covariances; assumed standard deviations of {ASSUMED[0]}, and "
        f"of {ASSUMED[1]}",
        LogWarning,
        stacklevel=3,
    )
    first, distance, second = np.array(steps).T
    control = np.stack([distance * np.cos(first), distance * np.sin(first), first + second], 1)
    along, heading = odometry_noise.variances(distance, np.abs(first) + np.abs(second))
    observation = np.array(seen).reshape(-1, 2)
    sensor = sensor_variances(observation[:, 0], sensor_sigma)
    return LandmarkLog(
        name=path.stem,
        start=np.zeros(3),
        time=np.arange(len(steps) + 1.0),
        motion="compose",
        control=control,
        control_covariance=np.stack([along, along, heading], 1)[:, :, None] * np.eye(3),
        observation_pose=np.array(poses, np.int64),
        observation=observation,
        observation_covariance=sensor[:, :, None] * np.eye(2),
        landmark=np.array(landmarks, object),
    )
