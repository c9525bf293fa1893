"""Feature extraction from many images, on one machine or a cluster.

`extract` cuts a source into blocks, and processes or Dask run `extract_block` on each. The result
is a data set, a folder of Parquet files:

    manifest.json        settings
    sift/*.parquet       the table, in a folder with the name of the features
    maps/*.png           saliency maps, 16 bits
    images.parquet       a row for every image: hash of its content, size, number of rows, error

`match_images` matches pairs of the images of a source, for hloc and COLMAP.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from saccade.batch.dataset import read_points as read_points
    from saccade.batch.extraction import Extraction as Extraction
    from saccade.batch.extraction import extract as extract
    from saccade.batch.job import Job as Job
    from saccade.batch.matching import MatchConfig as MatchConfig
    from saccade.batch.matching import MatchRun as MatchRun
    from saccade.batch.matching import match_images as match_images
    from saccade.batch.sources import open_source as open_source

_HOME_OF = {
    "Extraction": "extraction",
    "Job": "job",
    "MatchConfig": "matching",
    "MatchRun": "matching",
    "extract": "extraction",
    "match_images": "matching",
    "open_source": "sources",
    "read_points": "dataset",
}


def __getattr__(name: str) -> Any:
    """Load a name when it is first used: workers load beside the process that starts them."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'saccade.batch' has no attribute {name!r}")
    value = getattr(import_module(f"saccade.batch.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value
