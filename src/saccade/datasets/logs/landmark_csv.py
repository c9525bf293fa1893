"""Landmarks with their covariance as CSV."""

import csv
from pathlib import Path

from saccade.files import atomic_write
from saccade.types import LandmarkMap

HEADER = ("id", "x", "y", "cov_xx", "cov_xy", "cov_yy", "sightings")
"""Identity; metres; square metres (empty where unknown); observations (empty where unknown)."""


def write_landmarks(path: str | Path, landmarks: LandmarkMap) -> None:
    """Write one line per landmark, under `HEADER`.

    Args:
        path: the file; replaced if it exists.
        landmarks: the map.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for i in range(len(landmarks)):
            spread: list[float | str] = ["", "", ""]
            if landmarks.covariance is not None:
                C = landmarks.covariance[i]
                spread = [float(C[0, 0]), float(C[0, 1]), float(C[1, 1])]
            count = "" if landmarks.observations is None else int(landmarks.observations[i])
            x, y = landmarks.xy[i].tolist()
            writer.writerow([int(landmarks.id[i]), x, y, *spread, count])
