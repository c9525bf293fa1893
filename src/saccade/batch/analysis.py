"""What is computed of one image."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from saccade.batch import tables
from saccade.batch.job import MAPS, POINTS, Job
from saccade.types import Float32Array, Image


class Product(NamedTuple):
    """What was made of an image."""

    rows: pa.RecordBatch
    """Of the table."""
    map: Float32Array | None = None
    """(h, w) in [0, 1], where a map was asked for; its row is made when its place is known."""


@lru_cache(maxsize=1)
def analysis(job: Job) -> Callable[[str, Image], Product]:
    """From the name of an image and its pixels to its `Product`; it keeps its memory."""
    if job.what in POINTS:
        find = _detector(job)

        def points(name: str, image: Image) -> Product:
            return Product(tables.point_table(name, find(image), exact=job.exact))

        return points
    if job.what in MAPS:
        saliency = _saliency(job)

        def maps(name: str, image: Image) -> Product:
            found = saliency(image).astype(np.float16).astype(np.float32)
            return Product(tables.map_row(name, "", "", found, image.shape), found)

        return maps

    def fixations(name: str, image: Image) -> Product:
        from saccade.attention import attention_saliency, scanpath

        found = attention_saliency(image, job.settings).saliency
        path = scanpath(found, image.shape, job.fixations, job.network)
        return Product(tables.fixation_table(name, path))

    return fixations


def schema_of(job: Job) -> pa.Schema:
    """The columns of the table of a job."""
    if job.what in POINTS:
        return tables.point_schema(boxes=job.what == "symroid")
    return tables.MAP_ROWS if job.what in MAPS else tables.FIXATIONS


def _detector(job: Job) -> Callable[[Image], Any]:
    if job.what == "sift":
        from saccade.keypoints.sift import Sift

        return Sift(job.settings, threads=1)
    if job.what == "must":
        from saccade.keypoints.must import Must

        return Must(job.settings, threads=1)
    from saccade.keypoints.symroid import SymRoid

    return SymRoid(job.settings)


def _saliency(job: Job) -> Callable[[Image], Float32Array]:
    from saccade import attention

    models: dict[str, Callable[[Image, Any], Any]] = {
        "saliency": attention.attention_saliency,
        "contrast": attention.contrast_saliency,
        "symmetry": attention.symmetry_saliency,
    }
    return lambda image: np.asarray(models[job.what](image, job.settings).saliency, np.float32)
