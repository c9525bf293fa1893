"""Reads and writes keypoints and maps in the formats of other programs."""

from saccade.exchange.colmap import ColmapFeatures, read_colmap, write_colmap
from saccade.exchange.csv import read_csv, write_csv
from saccade.exchange.feature2d import Feature2D
from saccade.exchange.hdf5 import read_hdf5, write_hdf5
from saccade.exchange.hloc import read_hloc_matches, write_hloc_matches
from saccade.exchange.maps import write_map
from saccade.exchange.npz import read_npz, write_npz
from saccade.exchange.opencv import from_opencv, to_opencv
from saccade.exchange.parquet import read_parquet, to_arrow, write_parquet

__all__ = [
    "ColmapFeatures",
    "Feature2D",
    "from_opencv",
    "read_colmap",
    "read_csv",
    "read_hdf5",
    "read_hloc_matches",
    "read_npz",
    "read_parquet",
    "to_arrow",
    "to_opencv",
    "write_colmap",
    "write_csv",
    "write_hdf5",
    "write_hloc_matches",
    "write_map",
    "write_npz",
    "write_parquet",
]
