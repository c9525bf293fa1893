"""Rows of the tables of a data set as Arrow record batches."""

from dataclasses import replace
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt
import pyarrow as pa

from saccade.batch.job import MAPS, Job
from saccade.exchange.arrow import DESCRIPTOR_SIZE, POINT_SCHEMA, rows_of_image
from saccade.exchange.fields import columns_of
from saccade.types import Float32Array, Keypoints, Regions, Scanpath

DESCRIPTOR_STEP = 3
"""The entries of a descriptor are rounded to its multiples: none is off by more than 1, and a
descriptor takes 79 bytes instead of 103."""
STEPS_PER_PIXEL = 256
"""Resolution of positions: a hundredth of the localization error of the best detectors."""
STEPS_PER_RADIAN = 4096
"""Resolution of angles."""
MANTISSA_BITS = 12
"""Kept of sizes, responses and boxes."""

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
    if not job.exact:
        points, boxes = round_points(points), [_round_mantissa(values) for values in boxes]
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


def round_points(points: Keypoints) -> Keypoints:
    """Points without the bits that are below the precision of a detector: they do not compress.

    Positions are rounded to 1/256 px, angles to 1/4096 rad, sizes and responses to 12 bits, and the
    entries of descriptors to multiples of 3.
    """
    descriptors = cast("npt.NDArray[np.uint8]", points.descriptors)
    return replace(
        points,
        xy=_round_to_fraction(points.xy, STEPS_PER_PIXEL),
        angle=_round_to_fraction(points.angle, STEPS_PER_RADIAN),
        size=_round_mantissa(points.size),
        response=_round_mantissa(points.response),
        descriptors=quantize_descriptors(descriptors),
    )


def quantize_descriptors(descriptors: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Rounds each entry to the nearest multiple of `DESCRIPTOR_STEP`."""
    if not len(descriptors):
        return descriptors
    return np.asarray(cv2.LUT(descriptors, _MULTIPLES), np.uint8)


_MULTIPLES = np.minimum(
    (np.arange(256) + DESCRIPTOR_STEP // 2) // DESCRIPTOR_STEP * DESCRIPTOR_STEP, 255
).astype(np.uint8)
"""The nearest multiple of `DESCRIPTOR_STEP` to each byte."""


def _round_to_fraction(values: Float32Array, parts: int) -> Float32Array:
    """Rounds to the nearest multiple of 1 / parts."""
    rounded: Float32Array = np.rint(values * np.float32(parts)) / np.float32(parts)
    return rounded


def _round_mantissa(values: Float32Array) -> Float32Array:
    """Rounds to `MANTISSA_BITS` bits of mantissa."""
    dropped = 23 - MANTISSA_BITS
    bits: npt.NDArray[np.uint32] = np.ascontiguousarray(values, np.float32).view(np.uint32)
    kept = (bits + np.uint32(1 << (dropped - 1))) >> np.uint32(dropped) << np.uint32(dropped)
    rounded: Float32Array = kept.view(np.float32)
    return rounded
