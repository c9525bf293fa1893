"""Reads and writes keypoints and maps in the formats of other programs."""

from saccade.exchange.colmap import ColmapFeatures, read_colmap, write_colmap
from saccade.exchange.colmap_cameras import ColmapCamera, read_cameras
from saccade.exchange.csv_npz import read_npz, write_csv, write_npz
from saccade.exchange.hdf5 import read_hdf5, read_hloc_matches, write_hdf5, write_hloc_matches
from saccade.exchange.maps import write_map
from saccade.exchange.opencv import from_opencv, to_opencv
from saccade.io.image import read_orientation

__all__ = [
    "ColmapCamera",
    "ColmapFeatures",
    "from_opencv",
    "read_cameras",
    "read_colmap",
    "read_hdf5",
    "read_hloc_matches",
    "read_npz",
    "read_orientation",
    "to_opencv",
    "write_colmap",
    "write_csv",
    "write_hdf5",
    "write_hloc_matches",
    "write_map",
    "write_npz",
]
