"""The study of `saccade fit`: the model, its scores, and those of people."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from saccade.attention._scanpath_model_kernels import fill_logits
from saccade.attention.combined import AttentionConfig, FaceDetector, attention_saliency
from saccade.attention.fitted import FittedModel
from saccade.errors import LogError
from saccade.evaluation.comparison import (
    Difference,
    center_model,
    paired_difference,
    score_people,
    shuffled_model,
)
from saccade.evaluation.conditional import cell_density
from saccade.evaluation.fitting import (
    FittingConfig,
    FittingData,
    Weights,
    as_model,
    collect,
    cross_validate_images,
    fit,
    log_density,
    merge,
    split,
)
from saccade.evaluation.fixations import FixationScores, fixation_density, inside, score
from saccade.evaluation.prediction import (
    Model,
    PredictionScores,
    fixations_by_image,
    other_fixations,
    score_models,
)
from saccade.io.image import read_image
from saccade.scale.pyramid import resize
from saccade.types import FixationTable, Float32Array, FloatArray, IntArray

STATIC, ORDERED, REST = "static", "with the order", "the other viewers"


def image_model(
    data: FittingData, weights: Sequence[FloatArray], sizes: Mapping[str, tuple[int, int]]
) -> Model:
    """The saliency of each image by its own weights."""
    number = {name: i for i, name in enumerate(data.images)}

    def saliency(name: str) -> Float32Array:
        return saliency_of(data, number[name], weights[number[name]], sizes[name])

    return saliency


def saliency_of(
    data: FittingData, image: int, weights: FloatArray, size: tuple[int, int]
) -> Float32Array:
    """(H, W) saliency of an image, as `FittedModel.maps` and `resize` have it."""
    log_p = log_density(data, image, weights)
    shape = data.values[image].shape[1:]
    return resize(np.exp(log_p - log_p.max()).reshape(shape).astype(np.float32), size)


def score_viewers(
    data: FittingData,
    config: FittingConfig,
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    sigma: float,
) -> Iterator[tuple[str, FixationScores]]:
    """The scores of viewers who were left out of the fit, on the images of the others.

    Yields:
        The name of an image, and the mean over the parts of its viewers.
    """
    people = np.unique(np.concatenate(list(data.viewers)))
    everything = np.arange(len(data.images))
    parts = [people[held] for held in split(len(people), config.folds, config.seed)]
    fitted = [
        fit(data, everything, config, ordered=False, viewers=np.setdiff1d(people, part)).features
        for part in parts
        if len(parts) > 1
    ]
    for i, name in enumerate(data.images):
        others = other_fixations(name, fixations, sizes)
        baseline = fixation_density(others, sizes[name], sigma)
        scored = partial(score, others=others, sigma=sigma, baseline=baseline)
        rows = []
        for part, weights in zip(parts, fitted, strict=False):
            own = data.fixations[i][np.isin(data.viewers[i], part)]
            if len(own):
                rows.append(scored(saliency_of(data, i, weights, sizes[name]), own))
        if rows:
            yield name, _mean(rows)


def _mean(rows: list[FixationScores]) -> FixationScores:
    keys = FixationScores.__dataclass_fields__
    return FixationScores(*(float(np.mean([getattr(row, key) for row in rows])) for key in keys))


def score_steps(
    data: FittingData,
    weights: Mapping[str, Sequence[Weights]],
    fixations: Mapping[str, FloatArray],
    sigma: float,
) -> dict[str, FloatArray]:
    """How each next fixation is predicted, as `saccade.evaluation.conditional` scores it.

    Args:
        data: features and fixations.
        weights: by name of a model, those for each image; of a static one, with 0 for the order.
        fixations: by image, (n, 2).
        sigma: of the density of people's fixations, in pixels.

    Returns:
        By model, and of the other viewers of the image, the ceiling: (n, 2) NSS and information
        gain in bits over the fixations on other images, means over the fixations of each image;
        NaN of the other viewers of an image with one.
    """
    found: dict[str, list[FloatArray]] = {name: [] for name in (*weights, REST)}
    sizes = dict(zip(data.images, data.sizes, strict=True))
    for i, name in enumerate(data.images):
        shape, steps, size = data.values[i].shape[1:], data.steps[i], data.sizes[i]
        others = other_fixations(name, fixations, sizes)
        baseline = cell_density(others, size, shape, sigma)
        for model, of_images in weights.items():
            densities = step_densities(data, i, of_images[i])
            found[model].append(_step_scores(densities, steps.cells, baseline))
        viewers = data.viewers[i]
        if len(np.unique(viewers)) < 2:
            found[REST].append(np.full(2, np.nan))
            continue
        rest = {v: data.fixations[i][viewers != v] for v in np.unique(viewers)}
        seen = {v: cell_density(xy, size, shape, sigma) for v, xy in rest.items()}
        found[REST].append(_step_scores((seen[v] for v in viewers), steps.cells, baseline))
    return {name: np.array(rows) for name, rows in found.items()}


def step_densities(data: FittingData, image: int, weights: Weights) -> Iterator[FloatArray]:
    """(h, w) the distribution of each fixation of an image, given those before."""
    values, steps = data.values[image], data.steps[image]
    shape = values.shape[1:]
    tables = data.tables[(*shape, *data.sizes[image])] @ weights.saccade
    fields = np.stack(
        [
            np.tensordot(weights.features, values, 1),
            np.tensordot(weights.early, values[data.early], 1),
        ]
    )
    for anchors, factors in zip(steps.anchors, steps.factors, strict=True):
        density = np.empty(shape)
        fill_logits(fields, tables, anchors, factors, density)
        density = np.exp(density - density.max())
        yield density / density.sum()


def _step_scores(densities: Iterator[FloatArray], cells: IntArray, base: FloatArray) -> FloatArray:
    """(2,) mean NSS and bits of the cells (n, 2) of fixations in their distributions."""
    rows = []
    for density, (row, column) in zip(densities, cells, strict=True):
        at = density[row, column]
        nss = (at - density.mean()) / (density.std() or 1.0)
        rows.append((nss, np.log2(at / base[row, column])))
    return np.asarray(np.mean(rows, axis=0), np.float64)


def differences(results: Mapping[str, PredictionScores], first: str) -> dict[str, Difference]:
    """Paired differences of one model from each of the others on the same images."""
    return {
        name: paired_difference(result, results[first])
        for name, result in results.items()
        if name != first
    }


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
