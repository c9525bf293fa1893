"""Fits a model of fixations to photographs and the people who looked at them.

The next fixation is one of the cells of the map. The logarithm of its probability is a weighted sum
of features of the image and of functions of the way from earlier fixations, but for a constant:
the likelihood is convex (a conditional logit, McFadden 1974). A quadratic penalty holds the
standardized weights small. Without the functions of the way it is the static density.

The fit is cross-validated: each fixation belongs to a fold, by its image or by its viewer, and is
scored by weights that were fitted to the other folds.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from itertools import count as count_from
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from saccade.attention._scanpath_model_kernels import fill_logits
from saccade.attention.combined import AttentionConfig, FaceDetector, attention_saliency
from saccade.attention.fitted import (
    EARLY,
    FittedModel,
    feature_maps,
    feature_names,
    path_terms,
    saccade_tables,
)
from saccade.errors import LogError, Settings, setting
from saccade.evaluation._fitting_kernels import add_likelihood
from saccade.evaluation.conditional import (
    FixationPrediction,
    FixationRow,
    cells_of,
    people_densities,
    score_predictions,
)
from saccade.evaluation.fixations import FixationScores
from saccade.evaluation.prediction import (
    FixationData,
    Model,
    PredictionScores,
    score_models,
    score_people,
)
from saccade.scale.pyramid import resize
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray


@dataclass(frozen=True)
class FittingConfig(Settings):
    """Settings of the fit of a model and of its cross-validation."""

    folds: int = setting(5, 2, 100)
    """Parts of the images, or viewers, each left out once."""
    penalty: float = setting(0.001, 0, 1e3)
    """Weight of half of the squared standardized weights beside the mean log-likelihood."""
    iterations: int = setting(60, 1, 10_000)
    """Most iterations of the optimization."""
    seed: int = setting(2020, 0, 2**31)
    """Seed of the folds."""


class Steps(NamedTuple):
    """The fixations of an image, each with what it depends on."""

    cells: IntArray
    """(m, 2) row and column."""
    anchors: IntArray
    """(m, T, 2) cells of the earlier fixations; see `path_terms`."""
    factors: FloatArray
    """(m, T) of the tables."""


@dataclass(frozen=True, eq=False)
class FittingData:
    """The features and fixations of n images."""

    people: FixationData
    """The fixations."""
    names: Sequence[str]
    """(k,) names of the features."""
    values: Sequence[Float32Array]
    """(k, h, w) features of each image."""
    attention: AttentionConfig
    """Settings of the maps."""

    @cached_property
    def images(self) -> list[str]:
        """(n,) names."""
        return list(self.people.sizes)

    @cached_property
    def sizes(self) -> list[tuple[int, int]]:
        """(H, W) of each image."""
        return list(self.people.sizes.values())

    @cached_property
    def fixations(self) -> list[FloatArray]:
        """(m, 2) fixations on each image in pixels, those of a viewer in their order."""
        return [self.people.on(name).xy for name in self.images]

    @cached_property
    def viewers(self) -> list[IntArray]:
        """(m,) their viewers."""
        return [self.people.on(name).viewer for name in self.images]

    @cached_property
    def steps(self) -> list[Steps]:
        """The fixations of each image, those of a viewer after a first one in the center."""
        found = []
        pairs = zip(self.fixations, self.viewers, self.values, self.sizes, strict=True)
        for xy, viewers, values, size in pairs:
            shape = values.shape[1:]
            rows = []
            for viewer in np.unique(viewers):
                own = xy[viewers == viewer]
                path = np.vstack([[(size[1] - 1) / 2, (size[0] - 1) / 2], own])
                rows += [path_terms(path[: k + 1], shape, size) for k in range(len(own))]
            anchors, factors = (np.array(column) for column in zip(*rows, strict=True))
            found.append(Steps(cells_of(xy, size, shape), anchors, factors))
        return found

    @cached_property
    def early(self) -> IntArray:
        """Numbers of the features that count more for the first fixations."""
        return np.array([i for i, name in enumerate(self.names) if name in EARLY], np.int64)

    @cached_property
    def tables(self) -> dict[tuple[int, ...], FloatArray]:
        """`saccade_tables` by (h, w, H, W)."""
        shapes = {(*v.shape[1:], *size) for v, size in zip(self.values, self.sizes, strict=True)}
        return {each: saccade_tables(each[:2], each[2:]) for each in sorted(shapes)}

    @property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """(k,) mean and standard deviation of the features."""
        flat = [values.reshape(len(self.names), -1).astype(np.float64) for values in self.values]
        mean = np.mean([each.mean(1) for each in flat], axis=0)
        square = np.mean([((each - mean[:, None]) ** 2).mean(1) for each in flat], axis=0)
        deviation = np.sqrt(square)
        return mean, np.where(deviation > 1e-9, deviation, np.inf)  # constant in these images


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of a conditional density."""

    features: FloatArray
    """(k,) of the features."""
    early: FloatArray
    """(e,) of those that are `FittingData.early`, over the number of the fixation."""
    saccade: FloatArray
    """(m,) of the functions of `saccade_tables`."""


def fit(
    data: FittingData,
    config: FittingConfig,
    *,
    ordered: bool = True,
    kept: Sequence[BoolArray] | None = None,
    progress: Callable[[int], None] = lambda _iterations: None,
) -> Weights:
    """The weights of highest penalized likelihood.

    Args:
        data: features and fixations.
        config: the penalty.
        ordered: whether a fixation depends on those before; otherwise on the image alone.
        kept: of each image, (m,) which of its fixations count; None for all.
        progress: called after each iteration of the optimization, with their number.
    """
    k, e = len(data.names), len(data.early)
    mean, deviation = data.moments
    basis = next(iter(data.tables.values()))
    spread = basis.reshape(len(basis), -1, basis.shape[-1]).std(1).max(0)  # of its own table
    scale = np.concatenate([deviation, deviation[data.early], spread])
    parts = []
    for i, steps in enumerate(data.steps):
        counted = np.ones(len(steps.cells), np.bool_) if kept is None else kept[i]
        if counted.any():
            of_image = steps.cells[counted], steps.anchors[counted], steps.factors[counted]
            parts.append((i, Steps(*of_image)))
    count = max(1, sum(len(steps.cells) for _, steps in parts))
    flat = {i: (data.values[i].reshape(k, -1) - mean[:, None]) for i, _ in parts}

    def objective(scaled: FloatArray) -> tuple[float, FloatArray]:
        weights = scaled / scale
        total, gradient = 0.0, np.zeros_like(weights)
        tables = {n: np.ascontiguousarray(t @ weights[k + e :]) for n, t in data.tables.items()}
        slopes = {n: np.zeros_like(t) for n, t in tables.items()}
        for i, steps in parts:
            shape = data.values[i].shape[1:]
            size, x = (*shape, *data.sizes[i]), flat[i]
            fields = np.stack([weights[:k] @ x, weights[k : k + e] @ x[data.early]])
            slope = np.zeros((2, *shape))
            factors = steps.factors if ordered else np.zeros_like(steps.factors)
            total += add_likelihood(
                *(fields.reshape(2, *shape), tables[size], steps.anchors, factors, steps.cells),
                *(slope, slopes[size]),
            )
            first, second = slope.reshape(2, -1)
            gradient[:k] += x @ first
            gradient[k : k + e] += x[data.early] @ second
        for name, of_table in slopes.items():
            gradient[k + e :] += np.tensordot(of_table, data.tables[name], 3)
        value = total / count + config.penalty / 2 * scaled @ scaled
        return float(value), gradient / scale / count + config.penalty * scaled

    number = count_from(1)
    found = minimize(
        *(objective, np.zeros(len(scale))),
        jac=True,
        method="L-BFGS-B",
        callback=lambda _weights: progress(next(number)),
        options={"maxiter": config.iterations},
    )
    weights = found.x / scale
    return Weights(weights[:k], weights[k : k + e], weights[k + e :])


def split(count: int, folds: int, seed: int) -> IntArray:
    """(count,) random folds from 0 of about equal size; no more than there are numbers."""
    fold = np.empty(count, np.int64)
    fold[np.random.default_rng(seed).permutation(count)] = np.arange(count) % min(folds, count)
    return fold


def folds_by_image(data: FittingData, config: FittingConfig) -> list[IntArray]:
    """Of each image, (m,) the fold of its fixations: that of the image."""
    folds = split(len(data.images), config.folds, config.seed)
    return [np.full(len(xy), fold) for xy, fold in zip(data.fixations, folds, strict=True)]


def folds_by_viewer(data: FittingData, config: FittingConfig) -> list[IntArray]:
    """Of each image, (m,) the fold of its fixations: that of the viewer."""
    people = np.unique(data.people.table.viewer)
    folds = split(len(people), config.folds, config.seed)
    return [folds[np.searchsorted(people, viewers)] for viewers in data.viewers]


def cross_validate(
    data: FittingData,
    folds: Sequence[IntArray],
    config: FittingConfig,
    *,
    ordered: bool = True,
    progress: Callable[[int], None] = lambda _iterations: None,
) -> list[Weights]:
    """The weights of each fold, fitted to the others; `progress` counts the iterations of all."""
    found = []
    for fold in range(1 + max(each.max() for each in folds)):

        def iterated(count: int, before: int = fold * config.iterations) -> None:
            progress(before + count)

        kept = [each != fold for each in folds]
        found.append(fit(data, config, ordered=ordered, kept=kept, progress=iterated))
    return found


def score_held_out(
    data: FittingData, folds: Sequence[IntArray], weights: Sequence[Weights]
) -> Iterator[tuple[str, FixationScores]]:
    """The scores of the static densities of cross-validation, each on the fixations of its fold.

    Yields:
        The name of an image, and the mean over the folds of its fixations.
    """
    for i, (name, of_image) in enumerate(zip(data.images, folds, strict=True)):
        rows = [
            data.people.score(
                name,
                saliency_of(data, i, weights[fold].features),
                data.fixations[i][of_image == fold],
            )
            for fold in np.unique(of_image)
        ]
        yield name, PredictionScores([name] * len(rows), rows).mean()


def saliency_of(data: FittingData, image: int, weights: FloatArray) -> Float32Array:
    """(H, W) saliency of an image, as `FittedModel.maps` and `resize` have it."""
    values = data.values[image]
    logits = np.tensordot(weights, values, 1)
    return resize(np.exp(logits - logits.max()).astype(np.float32), data.sizes[image])


STATIC, ORDERED, ORDER, REST = "static", "with the order", "order", "the other viewers"


def score_steps(
    data: FittingData, folds: Sequence[IntArray], weights: Mapping[str, Sequence[Weights]]
) -> Iterator[FixationRow]:
    """How each next fixation is predicted, also by the other viewers of the image, the ceiling.

    Args:
        data: features and fixations.
        folds: of the images, see `folds_by_image`.
        weights: `STATIC` with 0 for the order, and `ORDERED`: those of each fold.

    Yields:
        The fixations scored by each, and what the order adds, the difference of their scores.
    """
    for i, name in enumerate(data.images):
        seen, shape = data.people.on(name), data.values[i].shape[1:]
        baseline, rest = people_densities(name, data.people, shape)
        predictions: dict[str, Iterable[FloatArray]] = {
            model: step_densities(data, i, of_folds[folds[i][0]])
            for model, of_folds in weights.items()
        }
        if len(rest) > 1:
            predictions[REST] = (rest[viewer] for viewer in seen.viewer.tolist())
        rows = [*score_predictions(name, seen, data.sizes[i], predictions, baseline)]
        yield from rows
        static, ordered = ([row for row in rows if row.model == of] for of in (STATIC, ORDERED))
        for before, row in zip(static, ordered, strict=True):
            gain = (getattr(row.scores, key) - getattr(before.scores, key) for key in STEP_SCORES)
            yield row._replace(model=ORDER, scores=FixationPrediction(*gain))


STEP_SCORES = tuple(FixationPrediction.__dataclass_fields__)


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


def as_model(
    data: FittingData, static: FloatArray, ordered: Weights | None = None, fitted_to: str = ""
) -> FittedModel:
    """The model of the weights of the static density, and of those of the next fixation."""
    scanpath = () if ordered is None else (*ordered.features, *ordered.early, *ordered.saccade)
    return FittedModel(
        tuple(data.names),
        _rounded(static),
        fitted_to,
        data.attention,
        _rounded(scanpath),
    )


def _rounded(weights: Sequence[float] | FloatArray) -> tuple[float, ...]:
    return tuple(float(f"{weight:.6g}") for weight in weights)


FITTED, BY_VIEWER, UNFITTED = "fitted, by image", "fitted, by viewer", "unfitted"
CENTER, SHUFFLED, PEOPLE = "center", "shuffled", "people"

Progress = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Passes items on, with a description and their number."""
Bar = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""Shows how far something is: from a description and a total to a function of what is done."""


@dataclass(frozen=True, eq=False)
class FitStudy:
    """A fitted model and its cross-validated scores."""

    model: FittedModel
    """Fitted to all images."""
    results: dict[str, PredictionScores]
    """By name: the model on images that it was not fitted to, then on viewers that it was not
    fitted to, and what it is compared with."""
    steps: list[FixationRow]
    """Each next fixation, see `score_steps`."""


def study(
    people: FixationData,
    attention: AttentionConfig,
    config: FittingConfig,
    faces: FaceDetector | None = None,
    *,
    ceiling: bool = True,
    progress: Progress = lambda items, _description, _count: items,
    bar: Bar = lambda _description, _total: nullcontext(lambda _done: None),
) -> FitStudy:
    """Fit a model to all images, and score it by cross-validation.

    Args:
        people: their fixations.
        attention: settings of the maps, and of the unfitted model.
        config: of the cross-validation.
        faces: finds faces, so that they are a feature; None for a model without.
        ceiling: whether people are scored, each against the others.
        progress: shows how far it is.
        bar: shows the iterations of the fits.

    Raises:
        LogError: there are too few images.
        ImageError: an image cannot be read or used.
    """
    count = len(people.sizes)
    if count < 4:
        raise LogError(f"fixations: expected at least four images to fit to, found {count}")
    names = feature_names(attention, faces=faces is not None)
    values = (
        feature_maps(people.read(name), names, attention, faces).astype(np.float32)
        for name in people.sizes
    )
    data = FittingData(people, names, [*progress(values, "features", count)], attention)
    images, viewers = folds_by_image(data, config), folds_by_viewer(data, config)
    (static, static_of_all), (ordered, ordered_of_all) = (
        _fits(data, images, config, each, bar) for each in (False, True)
    )

    def unfitted(name: str) -> Float32Array:
        saliency = attention_saliency(people.read(name), attention, faces=faces).saliency
        return resize(saliency, people.sizes[name])

    results: dict[str, PredictionScores] = {}

    def add(name: str, scored: Iterator[tuple[str, FixationScores]]) -> None:
        found = [*progress(scored, name, count)]
        if found:
            results[name] = PredictionScores(*zip(*found, strict=True))

    add(FITTED, score_held_out(data, images, static))
    if len(np.unique(people.table.viewer)) > 1:
        of_viewers = cross_validate(data, viewers, config, ordered=False)
        add(BY_VIEWER, score_held_out(data, viewers, of_viewers))
    references: dict[str, Model] = {
        UNFITTED: unfitted,
        CENTER: people.center,
        SHUFFLED: people.shuffled,
    }
    for name, model in references.items():
        add(name, ((image, of[name]) for image, of in score_models({name: model}, people)))
    if ceiling:
        add(PEOPLE, score_people(people))
    seen = len(np.unique(people.table.viewer))
    return FitStudy(
        as_model(data, static_of_all.features, ordered_of_all, f"{count} images, viewers: {seen}"),
        results,
        [*score_steps(data, images, {STATIC: static, ORDERED: ordered})],
    )


def _fits(
    data: FittingData, folds: Sequence[IntArray], config: FittingConfig, ordered: bool, bar: Bar
) -> tuple[list[Weights], Weights]:
    """Weights of each fold, fitted to the others, and those fitted to all."""
    before = min(config.folds, len(data.images)) * config.iterations
    description = "fitting scanpaths" if ordered else "fitting maps"
    with bar(description, before + config.iterations) as update:
        of_others = cross_validate(data, folds, config, ordered=ordered, progress=update)
        of_all = fit(data, config, ordered=ordered, progress=lambda n: update(before + n))
        update(before + config.iterations)
    return of_others, of_all
