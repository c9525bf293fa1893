"""Reads and writes keypoints and maps in the formats of other programs."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from saccade.exchange.colmap import ColmapCamera, ColmapFeatures, read_colmap, write_colmap
from saccade.exchange.hdf5 import read_hdf5, read_hloc_matches, write_hdf5, write_hloc_matches
from saccade.exchange.maps import write_map
from saccade.exchange.opencv import Feature2D, from_opencv, to_opencv
from saccade.exchange.tables import read_csv, read_npz, write_csv, write_npz
from saccade.extras import import_optional
from saccade.io.image import read_orientation

if TYPE_CHECKING:
    from saccade.exchange.arrow import read_parquet, to_arrow, write_parquet

__all__ = [
    "ColmapCamera",
    "ColmapFeatures",
    "Feature2D",
    "from_opencv",
    "read_colmap",
    "read_csv",
    "read_hdf5",
    "read_hloc_matches",
    "read_npz",
    "read_orientation",
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


def __getattr__(name: str) -> Any:
    """Functions that need pyarrow; raises `ConfigError` where it is not installed."""
    if name not in ("read_parquet", "to_arrow", "write_parquet"):
        raise AttributeError(f"module 'saccade.exchange' has no attribute {name!r}")
    import_optional("pyarrow", "parquet")
    return getattr(import_module("saccade.exchange.arrow"), name)
