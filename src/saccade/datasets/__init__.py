"""Reads and writes recorded data, in the data types of `saccade.types` and `saccade.frames`.

A missing, broken or unexpected file raises a subclass of `SaccadeError`: `LogError` for logs,
tables and fixations, `DriveError` for drives, `ImageError` for images. The message is one line with
the file, the line or row, the expected content and the found content. All writers raise
`OutputError`, and `ConfigError` for an unknown suffix.
"""

from saccade.datasets import fixations
from saccade.datasets.drives.loading import DriveKind, load_drive
from saccade.datasets.drives.writing import save_drive
from saccade.datasets.landmark_maps import load_map
from saccade.datasets.logs.conversions import OdometryNoise
from saccade.datasets.logs.loading import Kind, load, save
from saccade.datasets.tables import symmetric_columns, write_landmarks, write_table, write_tum

__all__ = [
    "DriveKind",
    "Kind",
    "OdometryNoise",
    "fixations",
    "load",
    "load_drive",
    "load_map",
    "save",
    "save_drive",
    "symmetric_columns",
    "write_landmarks",
    "write_table",
    "write_tum",
]
