"""Writes estimates: trajectories as TUM text, which evo reads, and landmark maps as CSV."""

from pathlib import Path

import numpy as np

from saccade.datasets.table import write_table
from saccade.files import atomic_write
from saccade.types import LandmarkMap, Trajectory


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write `time x y z qx qy qz qw` per pose; the ground is z = 0, headings turn about z.

    Args:
        path: the file; replaced if it exists.
        trajectory: poses with headings; covariances are not part of the format.

    Raises:
        OutputError: the file cannot be written.
    """
    x, y, theta = trajectory.pose.T
    zero = np.zeros(len(trajectory))
    rows = np.stack(
        [trajectory.time, x, y, zero, zero, zero, np.sin(theta / 2), np.cos(theta / 2)], 1
    )
    with atomic_write(path) as temporary:
        np.savetxt(temporary, rows, fmt="%.9f")


def write_landmarks(path: str | Path, landmarks: LandmarkMap) -> None:
    """Write one row per landmark: id, x, y, cov_xx, cov_xy, cov_yy, sightings.

    Metres and square metres; "sightings" counts the observations. Cells are empty where the
    covariance or the count is not known.

    Args:
        path: the file; replaced if it exists.
        landmarks: the map.

    Raises:
        OutputError: the file cannot be written.
    """
    unknown = np.full(len(landmarks), np.nan)
    covariance = landmarks.covariance
    if covariance is None:
        covariance = np.full((len(landmarks), 2, 2), np.nan)
    write_table(
        path,
        {
            "id": landmarks.id,
            "x": landmarks.xy[:, 0],
            "y": landmarks.xy[:, 1],
            "cov_xx": covariance[:, 0, 0],
            "cov_xy": covariance[:, 0, 1],
            "cov_yy": covariance[:, 1, 1],
            "sightings": unknown if landmarks.observations is None else landmarks.observations,
        },
    )
