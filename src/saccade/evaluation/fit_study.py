"""The whole study of `saccade fit`: the model, and how good it is."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.combined import AttentionConfig, FaceDetector, attention_saliency
from saccade.attention.fitted import FittedModel
from saccade.errors import LogError
from saccade.evaluation.fitted_scores import (
    ORDERED,
    STATIC,
    image_model,
    score_steps,
    score_viewers,
)
from saccade.evaluation.fitting import (
    FittingConfig,
    FittingData,
    Weights,
    as_model,
    collect,
    cross_validate_images,
    fit,
    merge,
)
from saccade.evaluation.fixation_references import center_model, score_people, shuffled_model
from saccade.evaluation.fixations import inside
from saccade.evaluation.prediction import (
    Model,
    PredictionScores,
    fixations_by_image,
    score_models,
)
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from saccade.types import FixationTable, Float32Array, FloatArray, IntArray

FITTED, BY_VIEWER, UNFITTED = "fitted, by image", "fitted, by viewer", "unfitted"
CENTER, SHUFFLED, PEOPLE = "center", "shuffled", "people"

Progress = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Passes items on, with a description and their number."""
Bar = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Shows how far something is: from a description and a total to a function of what is done."""


@contextmanager
def no_bar(_description: str, _total: int) -> Iterator[Callable[[int], None]]:
    """Shows nothing."""
    yield lambda _done: None


@dataclass(frozen=True, eq=False)
class FitStudy:
    """A fitted model and its cross-validated scores."""

    model: FittedModel
    """Fitted to all images."""
    results: dict[str, PredictionScores]
    """By name: the model on images that it was not fitted to, then on viewers that it was not
    fitted to, and what it is compared with."""
    steps: dict[str, FloatArray]
    """By name, (n, 2) NSS and bits of each next fixation, of the n images; see `score_steps`."""
    outside: int
    """Fixations outside their images, which are left out."""


def study(
    table: FixationTable,
    images: Path,
    attention: AttentionConfig,
    config: FittingConfig,
    faces: FaceDetector | None = None,
    *,
    skip: int = 1,
    sigma: float = 24.0,
    people: bool = True,
    progress: Progress = lambda items, _description, _count: items,
    bar: Bar = no_bar,
) -> FitStudy:
    """Fit a model to all images, and score it by cross-validation.

    Args:
        table: fixations of several viewers and images.
        images: folder of the images.
        attention: settings of the maps, and of the unfitted model.
        config: of the cross-validation.
        faces: finds faces, so that they are a feature; None for a model without.
        skip: number of first fixations of each viewer that are left out.
        sigma: standard deviation of the fixation density, in pixels.
        people: whether people are scored, each against the others.
        progress: shows how far it is.
        bar: shows the iterations of the fits.

    Raises:
        LogError: there are too few images.
        ImageError: an image cannot be read or used.
    """
    points, sizes, outside = fixations_by_image(table, images, skip)
    if len(points) < 4:
        raise LogError(f"fixations: expected at least four images, found {len(points)}")
    names = list(points)
    read = partial(_read, images)
    looked = [_paths(table, name, sizes[name], skip) for name in names]
    paths, viewers = zip(*looked, strict=True)
    parts = collect(names, read, paths, viewers, attention, faces)
    data = merge([*progress(parts, "features", len(names))])
    (static, static_of_all), (ordered, ordered_of_all) = (
        _fits(data, config, each, bar) for each in (False, True)
    )
    models: dict[str, Model] = {
        FITTED: image_model(data, [each.features for each in static], sizes),
        UNFITTED: partial(_unfitted, read, attention, faces),
        CENTER: center_model(sizes),
        SHUFFLED: shuffled_model(points, sizes, sigma),
    }
    scored = [*progress(score_models(models, points, sizes, sigma), "scoring", len(names))]
    results = {
        name: PredictionScores([i for i, _ in scored], [of[name] for _, of in scored])
        for name in models
    }
    by_viewer = score_viewers(data, config, points, sizes, sigma)
    results |= _scores(BY_VIEWER, progress(by_viewer, "viewers", len(names)))
    if people:
        ceiling = score_people(table, points, sizes, skip, sigma)
        results |= _scores(PEOPLE, progress(ceiling, "people", len(names)))
    order = (FITTED, BY_VIEWER, UNFITTED, CENTER, SHUFFLED, PEOPLE)
    people_count = len(np.unique(np.concatenate(viewers)))
    return FitStudy(
        as_model(
            *(data, static_of_all.features, ordered_of_all),
            f"{len(names)} images, viewers: {people_count}",
        ),
        {name: results[name] for name in order if name in results},
        score_steps(data, {STATIC: static, ORDERED: ordered}, points, sigma),
        outside,
    )


def _fits(
    data: FittingData, config: FittingConfig, ordered: bool, bar: Bar
) -> tuple[list[Weights], Weights]:
    """Weights for each image, fitted to others, and those fitted to all."""
    before = min(config.folds, len(data.images)) * config.iterations
    description = "fitting scanpaths" if ordered else "fitting maps"
    with bar(description, before + config.iterations) as update:
        of_others = cross_validate_images(data, config, ordered=ordered, progress=update)
        everything = np.arange(len(data.images))
        of_all = fit(
            data, everything, config, ordered=ordered, progress=lambda n: update(before + n)
        )
        update(before + config.iterations)
    return of_others, of_all


def _read(images: Path, name: str) -> Float32Array:
    return read_image(images / name)


def _paths(
    table: FixationTable, name: str, size: tuple[int, int], skip: int
) -> tuple[FloatArray, IntArray]:
    """(n, 2) the fixations that `fixations_by_image` keeps, in order, and (n,) their viewers."""
    here = np.flatnonzero((table.index >= skip) & (table.image == name))
    here = here[np.lexsort((table.index[here], table.viewer[here]))]
    kept = [i for i in here if len(inside(table.xy[i : i + 1], size))]
    return table.xy[kept], table.viewer[kept]


def _unfitted(
    read: Callable[[str], Float32Array],
    attention: AttentionConfig,
    faces: FaceDetector | None,
    name: str,
) -> Float32Array:
    image = read(name)
    return resize(attention_saliency(image, attention, faces=faces).saliency, image.shape[:2])


def _scores(name: str, pairs: Iterable[Any]) -> dict[str, PredictionScores]:
    found = [*pairs]
    return {name: PredictionScores(*zip(*found, strict=True))} if found else {}
