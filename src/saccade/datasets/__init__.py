"""Recorded data, each source read into the data types of `saccade.types` and `saccade.frames`."""

from saccade.datasets.drives.loading import DriveKind, load_drive
from saccade.datasets.drives.writing import save_drive
from saccade.datasets.logs.dlr import read_dlr
from saccade.datasets.logs.isam import Entries, read_isam
from saccade.datasets.logs.isam_writer import Dialect, write_isam
from saccade.datasets.logs.landmark_csv import write_landmarks
from saccade.datasets.logs.loading import Format, Kind, detect_format, load, save
from saccade.datasets.logs.log_csv import read_log_csv, write_log_csv
from saccade.datasets.logs.mrclam import read_mrclam
from saccade.datasets.logs.mrclam_writer import write_mrclam
from saccade.datasets.logs.victoria_park import read_victoria_park
from saccade.datasets.odometry import OdometryNoise, integrate
from saccade.datasets.table import symmetric_columns, write_table
from saccade.datasets.tum import write_tum

__all__ = [
    "Dialect",
    "DriveKind",
    "Entries",
    "Format",
    "Kind",
    "OdometryNoise",
    "detect_format",
    "integrate",
    "load",
    "load_drive",
    "read_dlr",
    "read_isam",
    "read_log_csv",
    "read_mrclam",
    "read_victoria_park",
    "save",
    "save_drive",
    "symmetric_columns",
    "write_isam",
    "write_landmarks",
    "write_log_csv",
    "write_mrclam",
    "write_table",
    "write_tum",
]
