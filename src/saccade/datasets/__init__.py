"""Recorded data, each source read into the nouns of `saccade.types`."""

from saccade.datasets.dlr import read_dlr
from saccade.datasets.isam import Entries, read_isam
from saccade.datasets.landmark_csv import write_landmarks
from saccade.datasets.loading import Kind, load, recognize
from saccade.datasets.mrclam import read_mrclam
from saccade.datasets.odometry import OdometryNoise, integrate
from saccade.datasets.table import symmetric_columns, write_table
from saccade.datasets.tum import write_tum
from saccade.datasets.victoria_park import read_victoria_park

__all__ = [
    "Entries",
    "Kind",
    "OdometryNoise",
    "integrate",
    "load",
    "read_dlr",
    "read_isam",
    "read_mrclam",
    "read_victoria_park",
    "recognize",
    "symmetric_columns",
    "write_landmarks",
    "write_table",
    "write_tum",
]
