"""Rows of the tables of a data set as Arrow record batches."""

from dataclasses import replace

import numpy as np
import pyarrow as pa

from saccade.batch.job import MAPS, Job
from saccade.exchange.arrow import DESCRIPTOR_SIZE, POINT_SCHEMA, rows_of_image
from saccade.exchange.fields import columns_of
from saccade.types import Float32Array, Keypoints, Regions, Scanpath

REGION_SCHEMA = pa.schema(
    [*POINT_SCHEMA, *((name, pa.float32()) for name in ("left", "top", "right", "bottom"))]
)
"""The columns of points, and the box of each region in image pixels."""
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


def schema_of(what: str) -> pa.Schema:
    """The columns of the table of a kind of features."""
    if what in MAPS:
        return MAP_SCHEMA
    others = {"symroid": REGION_SCHEMA, "scanpath": FIXATION_SCHEMA}
    return others.get(what, POINT_SCHEMA)


def feature_rows(
    job: Job,
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
    boxes = list(found.boxes.T) if isinstance(found, Regions) else []
    points = found.keypoints if isinstance(found, Regions) else found
    if points.descriptors is None:
        points = replace(points, descriptors=np.zeros((len(points), DESCRIPTOR_SIZE), np.uint8))
    columns = [*columns_of(points).values(), points.descriptors, *boxes]
    return rows_of_image(name, columns, schema_of(job.what))


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
