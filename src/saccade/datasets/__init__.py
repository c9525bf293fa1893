"""Reads and writes recorded data, in the data types of `saccade.types` and `saccade.frames`."""

from saccade.datasets.drives.kitti import save_drive
from saccade.datasets.drives.loading import DriveKind, load_drive
from saccade.datasets.logs.conversions import OdometryNoise, integrate
from saccade.datasets.logs.dlr import read_dlr
from saccade.datasets.logs.loading import Format, Kind, detect_format, load, save
from saccade.datasets.logs.log_csv import read_log_csv, write_log_csv
from saccade.datasets.logs.mrclam import read_mrclam, write_mrclam
from saccade.datasets.logs.pose_graph import (
    Dialect,
    MatrixForm,
    read_pose_graph,
    write_pose_graph,
)
from saccade.datasets.logs.victoria_park import read_victoria_park
from saccade.datasets.tables import symmetric_columns, write_landmarks, write_table, write_tum

__all__ = [
    "Dialect",
    "DriveKind",
    "Format",
    "Kind",
    "MatrixForm",
    "OdometryNoise",
    "detect_format",
    "integrate",
    "load",
    "load_drive",
    "read_dlr",
    "read_log_csv",
    "read_mrclam",
    "read_pose_graph",
    "read_victoria_park",
    "save",
    "save_drive",
    "symmetric_columns",
    "write_landmarks",
    "write_log_csv",
    "write_mrclam",
    "write_pose_graph",
    "write_table",
    "write_tum",
]
