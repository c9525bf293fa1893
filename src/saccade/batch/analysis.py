"""Runs the algorithm of a job on one image."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from saccade import keypoints
from saccade.batch import tables
from saccade.batch.job import MAPS, POINTS, Job
from saccade.types import Float32Array, Image, Keypoints, Regions


class ImageResult(NamedTuple):
    """What was extracted from an image."""

    rows: pa.RecordBatch
    """Of the table."""
    map: Float32Array | None = None
    """(h, w) in [0, 1], if the job is for maps."""


@lru_cache(maxsize=1)
def analyzer(job: Job) -> Callable[[str, Image], ImageResult]:
    """A function from the name and pixels of an image to the result; detectors keep their memory.

    Args:
        job: what to extract.
    """
    if job.what in POINTS:
        detect = _detector(job)
        return lambda name, image: ImageResult(
            tables.point_table(name, detect(image), exact=job.exact)
        )
    if job.what in MAPS:
        model = _saliency_model(job)

        def extract_map(name: str, image: Image) -> ImageResult:
            saliency = model(image, job.settings).saliency
            values = saliency.astype(np.float16).astype(np.float32)  # as it is stored
            return ImageResult(tables.map_row(name, values, image.shape), values)

        return extract_map

    def extract_scanpath(name: str, image: Image) -> ImageResult:
        from saccade import attention

        saliency = _saliency_model(job)(image, job.settings).saliency
        path = attention.scanpath(saliency, image.shape, job.fixations, job.network)
        return ImageResult(tables.fixation_table(name, path))

    return extract_scanpath


def schema_of(job: Job) -> pa.Schema:
    """The columns of the table of a job."""
    if job.what in POINTS:
        return tables.point_schema(boxes=job.what == "symroid")
    return tables.MAP_SCHEMA if job.what in MAPS else tables.FIXATION_SCHEMA


def _detector(job: Job) -> Callable[[Image], Keypoints | Regions]:
    if job.what == "sift":
        return keypoints.Sift(job.settings, threads=1)
    if job.what == "must":
        return keypoints.Must(job.settings, threads=1)
    return keypoints.SymRoid(job.settings, threads=1)


def _saliency_model(job: Job) -> Callable[[Image, Any], Any]:
    from saccade import attention

    if isinstance(job.settings, attention.FittedModel):
        return lambda image, model: model.maps(image)
    if job.what == "contrast":
        return attention.contrast_saliency
    if job.what == "symmetry":
        return attention.symmetry_saliency
    return attention.attention_saliency
