"""The whole study of `saccade fit`: the model, how good it is, and on how many images."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention.combined import AttentionConfig, attention_saliency
from saccade.attention.faces import FaceDetector
from saccade.attention.fitted import FittedModel
from saccade.errors import LogError
from saccade.evaluation.fitted_scores import (
    GroupScores,
    group_scores,
    image_model,
    learning_curve,
    score_viewers,
)
from saccade.evaluation.fitting import (
    CellScores,
    Choice,
    FittingConfig,
    FittingData,
    choose,
    collect,
    cross_validate_images,
    fit_all,
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
from saccade.image import read_image
from saccade.pyramid import resize
from saccade.types import FixationTable, Float32Array

FITTED, BY_VIEWER, UNFITTED = "fitted, by image", "fitted, by viewer", "unfitted"
CENTER, SHUFFLED, PEOPLE = "center", "shuffled", "people"

Progress = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Passes items on, with a description and their number."""


@dataclass(frozen=True, eq=False)
class FitStudy:
    """A fitted model and its cross-validated scores."""

    model: FittedModel
    """Fitted to all images."""
    results: dict[str, PredictionScores]
    """By name: the model on images that it was not fitted to, then on viewers that it was not
    fitted to, and what it is compared with."""
    curve: Sequence[tuple[int, CellScores]]
    """Learning curve: number of images, and the scores on others."""
    groups: Sequence[GroupScores]
    """What each group of features contributes."""
    full: CellScores
    """The scores with all groups."""
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

    Raises:
        ConfigError: scikit-learn is not installed.
        LogError: there are too few images.
        ImageError: an image cannot be read or used.
    """
    points, sizes, outside = fixations_by_image(table, images, skip)
    if len(points) < 4:
        raise LogError(f"fixations: expected at least four images, found {len(points)}")
    names = list(points)
    read = partial(_read, images)
    viewers = [_viewers(table, name, sizes[name], skip) for name in names]
    parts = collect(names, read, [*points.values()], viewers, attention, faces)
    data = merge([*progress(parts, "features", len(names))])
    weights, _ = cross_validate_images(data, config)
    choice = choose(data, np.arange(len(names)), config)
    models: dict[str, Model] = {
        FITTED: image_model(data, weights, sizes),
        UNFITTED: partial(_unfitted, read, attention, faces),
        CENTER: center_model(sizes),
        SHUFFLED: shuffled_model(points, sizes, sigma),
    }
    scored = [*progress(score_models(models, points, sizes, sigma), "scoring", len(names))]
    results = {
        name: PredictionScores([i for i, _ in scored], [of[name] for _, of in scored])
        for name in models
    }
    by_viewer = score_viewers(data, choice, config, points, sizes, sigma)
    results |= _scores(BY_VIEWER, progress(by_viewer, "viewers", len(names)))
    if people:
        ceiling = score_people(table, points, sizes, skip, sigma)
        results |= _scores(PEOPLE, progress(ceiling, "people", len(names)))
    order = (FITTED, BY_VIEWER, UNFITTED, CENTER, SHUFFLED, PEOPLE)
    groups, full = _groups(data, choice, config)
    return FitStudy(
        fit_all(data, choice, config),
        {name: results[name] for name in order if name in results},
        [*learning_curve(data, config)],
        groups,
        full,
        outside,
    )


def _read(images: Path, name: str) -> Float32Array:
    return read_image(images / name)


def _viewers(table: FixationTable, name: str, size: tuple[int, int], skip: int) -> Any:
    """(n,) the viewers of the fixations that `fixations_by_image` keeps."""
    own = (table.index >= skip) & (table.image == name)
    numbers = np.flatnonzero(own)
    kept = [i for i in numbers if len(inside(table.xy[i : i + 1], size))]
    return table.viewer[kept]


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


def _groups(
    data: FittingData, choice: Choice, config: FittingConfig
) -> tuple[list[GroupScores], CellScores]:
    pairs = [*group_scores(data, choice, config)]
    return [group for group, _ in pairs], pairs[0][1]
