"""Feature extraction from many images, on one machine or a cluster.

`extract` cuts a source into blocks, and processes or Dask run `extract_block` on each. The result
is a data set, a folder of Parquet files:

    manifest.json        settings
    sift/*.parquet       the table, in a folder with the name of the features
    maps/*.png           saliency maps, 16 bits
    images.parquet       a row for every image: hash of its content, size, number of rows, error

`match_images` matches pairs of the images of a source, for hloc and COLMAP.
"""

from saccade.extras import import_optional

import_optional("pyarrow", "parquet")

from saccade.batch.dataset import read_points  # noqa: E402
from saccade.batch.extraction import Extraction, extract  # noqa: E402
from saccade.batch.job import Job  # noqa: E402
from saccade.batch.matching import MatchConfig, MatchRun, match_images  # noqa: E402
from saccade.batch.sources import open_source  # noqa: E402

__all__ = [
    "Extraction",
    "Job",
    "MatchConfig",
    "MatchRun",
    "extract",
    "match_images",
    "open_source",
    "read_points",
]
