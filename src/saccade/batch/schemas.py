"""Rows of the tables of a data set as Arrow record batches."""

import numpy as np
import pyarrow as pa

from saccade.batch.job import MAPS, SCANPATH, Job
from saccade.exchange.arrow import POINT_SCHEMA, descriptor_type, point_schema, rows_of_image
from saccade.io.keypoint_fields import columns_of
from saccade.keypoints.detectors import DETECTORS, keypoints_of
from saccade.types import Float32Array, Keypoints, Regions, Scanpath

BOX = tuple((name, pa.float32()) for name in ("left", "top", "right", "bottom"))
"""Columns of the box of a region in image pixels."""
FIXATION_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("fixation", pa.int16()),
        *((name, pa.float32()) for name in ("x", "y", "time", "saliency")),
    ]
)
"""x and y in image pixels, time in seconds; the first fixation is 1."""
MAP_SCHEMA = pa.schema(
    [
        ("image", pa.string()),
        ("rows", pa.int32()),
        ("columns", pa.int32()),
        *((name, pa.float32()) for name in ("x", "y", "maximum", "mean")),
    ]
)
"""Shape of the map of an image, and its maximum at x and y in image pixels."""


def empty_schema(job: Job) -> pa.Schema:
    """The columns of a table without rows."""
    if job.what in MAPS:
        return MAP_SCHEMA
    if job.what in DETECTORS and DETECTORS[str(job.what)].gives_regions:
        return pa.schema([*POINT_SCHEMA, *BOX])
    return FIXATION_SCHEMA if job.what == SCANPATH else POINT_SCHEMA


def feature_rows(
    name: str,
    shape: tuple[int, ...],
    found: Keypoints | Regions | Scanpath | Float32Array,
) -> pa.RecordBatch:
    """The rows of the features of an image of a shape (H, W, ...); a map is an (h, w) array."""
    if isinstance(found, Scanpath):
        numbers = np.arange(1, len(found) + 1)
        fixations = [numbers, *found.xy.T, found.time, found.saliency]
        return rows_of_image(name, fixations, FIXATION_SCHEMA)
    if isinstance(found, np.ndarray):
        return _map_row(name, shape, found)
    points, schema, boxes = keypoints_of(found), POINT_SCHEMA, []
    if points.descriptors is not None:
        schema = point_schema(descriptor_type(points.descriptors))
    if isinstance(found, Regions):
        schema, boxes = pa.schema([*schema, *BOX]), list(found.boxes.T)
    columns = [*columns_of(points).values(), points.descriptors, *boxes]
    return rows_of_image(name, columns, schema)


def _map_row(name: str, shape: tuple[int, ...], values: Float32Array) -> pa.RecordBatch:
    row, column = np.unravel_index(int(values.argmax()), values.shape)
    cells = (
        *values.shape,
        (column + 0.5) * shape[1] / values.shape[1] - 0.5,
        (row + 0.5) * shape[0] / values.shape[0] - 0.5,
        values.max(),
        values.mean(),
    )
    return rows_of_image(name, [np.array([cell]) for cell in cells], MAP_SCHEMA)
