"""Fits a fixation model to photographs with recorded fixations.

The next fixation falls in a cell of the map. Up to a constant, the log-probability is a weighted
sum of image features and of functions of the displacement from earlier fixations, so that the
negative log-likelihood is convex (a conditional logit, McFadden 1974). A quadratic penalty shrinks
the standardized weights. Without the functions of the displacement, the model is the static
density.

The fit is cross-validated: each fixation belongs to a fold, by image or by subject, and is scored
with weights fitted to the other folds. The weights form one array: the k features, the e features
with extra weight for early fixations, and the functions of `saccade_tables`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from saccade.attention._fitting_kernels import add_likelihood
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
from saccade.evaluation.conditional import cells_of
from saccade.evaluation.fixations import FixationScores
from saccade.evaluation.prediction import (
    FixationData,
    Model,
    PredictionScores,
    score_models,
    score_people,
)
from saccade.scale.pyramid import resize
from saccade.threads import SERIAL_BLAS
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray


@dataclass(frozen=True)
class FittingConfig(Settings):
    """Settings of the fit of a model and of its cross-validation."""

    folds: int = setting(5, 2, 100)
    """Number of folds of the images, or subjects."""
    penalty: float = setting(0.001, 0, 1e3)
    """Weight of the penalty, half of the squared standardized weights, relative to the mean
    log-likelihood."""
    iterations: int = setting(60, 1, 10_000)
    """Maximum number of iterations of the optimization."""
    seed: int = setting(2020, 0, 2**31)
    """Seed of the folds."""


class Steps(NamedTuple):
    """The fixations of an image, with the earlier fixations that they depend on."""

    cells: IntArray
    """(m, 2) row and column of the fixations."""
    anchors: IntArray
    """(m, T, 2) cells of the earlier fixations; see `path_terms`."""
    factors: FloatArray
    """(m, T) factors of the tables."""


@dataclass(frozen=True, eq=False)
class FittingData:
    """The features and fixations of n images."""

    people: FixationData
    """The fixations."""
    names: Sequence[str]
    """(k,) names of the features."""
    values: Sequence[Float32Array]
    """(k, h, w) features of each image, in the order of `people.sizes`."""
    attention: AttentionConfig
    """Settings of the maps."""

    @cached_property
    def steps(self) -> list[Steps]:
        """The fixations of each image; each scanpath starts from the center."""
        found = []
        for (name, size), values in zip(self.people.sizes.items(), self.values, strict=True):
            seen, shape = self.people.on(name), values.shape[1:]
            rows = []
            for number in np.unique(seen.scanpath):
                own = seen.xy[seen.scanpath == number]
                path = np.vstack([[(size[1] - 1) / 2, (size[0] - 1) / 2], own])
                rows += [path_terms(path[: k + 1], shape, size) for k in range(len(own))]
            anchors, factors = (np.array(column) for column in zip(*rows, strict=True))
            found.append(Steps(cells_of(seen.xy, size, shape), anchors, factors))
        return found

    @cached_property
    def early(self) -> IntArray:
        """(e,) indices of the features with extra weight for early fixations."""
        return np.array([i for i, name in enumerate(self.names) if name in EARLY], np.int64)

    @cached_property
    def shapes(self) -> list[tuple[int, int, int, int]]:
        """(h, w, H, W) of each image."""
        cells = [values.shape for values in self.values]
        pairs = zip(cells, self.people.sizes.values(), strict=True)
        return [(h, w, *size) for (_, h, w), size in pairs]

    @cached_property
    def tables(self) -> dict[tuple[int, int, int, int], FloatArray]:
        """`saccade_tables` by (h, w, H, W)."""
        return {each: saccade_tables(each[:2], each[2:]) for each in sorted({*self.shapes})}

    @property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """(k,) mean and standard deviation of the features."""
        flat = [values.reshape(len(self.names), -1).astype(np.float64) for values in self.values]
        mean = np.mean([each.mean(1) for each in flat], axis=0)
        square = np.mean([((each - mean[:, None]) ** 2).mean(1) for each in flat], axis=0)
        deviation = np.sqrt(square)
        return mean, np.where(deviation > 1e-9, deviation, np.inf)  # infinite for constant features


def fit(
    data: FittingData,
    config: FittingConfig,
    kept: Sequence[BoolArray] | None = None,
    *,
    ordered: bool = True,
) -> FloatArray:
    """Weights that maximize the penalized likelihood.

    Args:
        data: features and fixations.
        config: settings with the penalty.
        kept: for each image, an (m,) mask of the fixations to use; None for all.
        ordered: whether a fixation depends on earlier fixations; otherwise only on the image.
    """
    k, e = len(data.names), len(data.early)
    mean, deviation = data.moments
    basis = next(iter(data.tables.values()))
    spread = basis.reshape(len(basis), -1, basis.shape[-1]).std(1).max(0)  # within each table
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
            size, x = data.shapes[i], flat[i]
            fields = np.stack([weights[:k] @ x, weights[k : k + e] @ x[data.early]])
            slope = np.zeros((2, *size[:2]))
            factors = steps.factors if ordered else np.zeros_like(steps.factors)
            total += add_likelihood(
                *(fields.reshape(slope.shape), tables[size], steps.anchors, factors, steps.cells),
                *(slope, slopes[size]),
            )
            first, second = slope.reshape(2, -1)
            gradient[:k] += x @ first
            gradient[k : k + e] += x[data.early] @ second
        for size, of_table in slopes.items():
            gradient[k + e :] += np.tensordot(of_table, data.tables[size], 3)
        value = total / count + config.penalty / 2 * scaled @ scaled
        return float(value), gradient / scale / count + config.penalty * scaled

    from scipy.optimize import minimize  # slow to import

    with SERIAL_BLAS:
        found = minimize(
            *(objective, np.zeros(len(scale))),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": config.iterations},
        )
    return np.asarray(found.x / scale)


def split(count: int, folds: int, seed: int) -> IntArray:
    """(count,) random folds of about equal size, numbered from 0; at most `count` folds."""
    fold = np.empty(count, np.int64)
    fold[np.random.default_rng(seed).permutation(count)] = np.arange(count) % min(folds, count)
    return fold


def folds_by_image(data: FittingData, config: FittingConfig) -> list[IntArray]:
    """Folds (m,) of the fixations of each image, assigned by image."""
    folds = split(len(data.values), config.folds, config.seed)
    return [np.full(len(each.cells), fold) for each, fold in zip(data.steps, folds, strict=True)]


def folds_by_subject(data: FittingData, config: FittingConfig) -> list[IntArray]:
    """Folds (m,) of the fixations of each image, assigned by subject."""
    subjects = np.unique(data.people.table.subject)
    folds = split(len(subjects), config.folds, config.seed)
    seen = (data.people.on(name).subject for name in data.people.sizes)
    return [folds[np.searchsorted(subjects, each)] for each in seen]


def cross_validate(
    data: FittingData, folds: Sequence[IntArray], config: FittingConfig
) -> Iterator[FloatArray]:
    """Weights of the static density for each fold, fitted to the other folds."""
    for fold in range(1 + max(each.max() for each in folds)):
        yield fit(data, config, [each != fold for each in folds], ordered=False)


def score_held_out(
    data: FittingData, folds: Sequence[IntArray], weights: Sequence[FloatArray]
) -> Iterator[tuple[str, FixationScores]]:
    """Scores of the cross-validated static densities on the held-out fixations.

    Yields:
        The name of an image, and the mean score over its folds.
    """
    for i, (name, of_image) in enumerate(zip(data.people.sizes, folds, strict=True)):
        xy, rows = data.people.on(name).xy, []
        for fold in np.unique(of_image):
            saliency = saliency_of(data, i, weights[fold])
            rows.append(data.people.score(name, saliency, xy[of_image == fold]))
        yield name, PredictionScores([name] * len(rows), rows).mean()


def saliency_of(data: FittingData, image: int, weights: FloatArray) -> Float32Array:
    """(H, W) saliency of an image, equal to the resized result of `FittedModel.maps`."""
    logits = np.tensordot(weights[: len(data.names)], data.values[image], 1)
    return resize(np.exp(logits - logits.max()).astype(np.float32), data.shapes[image][2:])


def as_model(
    data: FittingData, static: FloatArray, ordered: Sequence[float] = (), fitted_to: str = ""
) -> FittedModel:
    """The fitted model, from static weights and from weights for the next fixation."""
    rounded = (
        tuple(float(f"{weight:.6g}") for weight in weights)
        for weights in (static[: len(data.names)], ordered)
    )
    features, scanpath = rounded
    return FittedModel(tuple(data.names), features, fitted_to, data.attention, scanpath)


FITTED = "fitted, by image"
BY_SUBJECT = "fitted, by subject"
UNFITTED = "unfitted"
CENTER = "center"
SHUFFLED = "shuffled"
PEOPLE = "people"


@dataclass(frozen=True, eq=False)
class FitStudy:
    """A fitted model and its cross-validated scores."""

    model: FittedModel
    """Model fitted to all images."""
    results: dict[str, PredictionScores]
    """Scores by name: the model on held-out images, on held-out subjects, and references."""


def study(
    people: FixationData,
    attention: AttentionConfig,
    config: FittingConfig,
    faces: FaceDetector | None = None,
    *,
    progress: Callable[[Iterable[Any], str, int], Iterable[Any]] = lambda items, *_: items,
) -> FitStudy:
    """Fit a model to all images, and score it by cross-validation.

    Args:
        people: recorded fixations.
        attention: settings of the maps, and of the unfitted model.
        config: settings of the fit and the cross-validation.
        faces: face detector, for a model with faces; None for a model without faces.
        progress: function that passes items through; it receives a description and their number.

    Raises:
        LogError: fewer than four images.
        ImageError: an image cannot be read or used.
    """
    count, subjects = len(people.sizes), len(np.unique(people.table.subject))
    if count < 4:
        raise LogError(f"fixations: expected at least four images to fit to, found {count}")
    names = feature_names(attention, faces=faces is not None)
    values = (
        feature_maps(people.read(name), names, attention, faces).astype(np.float32)
        for name in people.sizes
    )
    data = FittingData(people, names, [*progress(values, "features", count)], attention)
    by_image, by_viewer = folds_by_image(data, config), folds_by_subject(data, config)
    folds = min(config.folds, count)
    found = [*progress(cross_validate(data, by_image, config), "fitting", folds)]
    fits = (fit(data, config, ordered=ordered) for ordered in (False, True))
    static, ordered = progress(fits, "fitting to all images", 2)

    def unfitted(name: str) -> Float32Array:
        saliency = attention_saliency(people.read(name), attention, faces=faces).saliency
        return resize(saliency, people.sizes[name])

    def scores_of(model: Model) -> Iterator[tuple[str, FixationScores]]:
        return ((image, of["model"]) for image, of in score_models({"model": model}, people))

    scored = {FITTED: score_held_out(data, by_image, found)}
    if subjects > 1:
        of_viewers = [*cross_validate(data, by_viewer, config)]
        scored[BY_SUBJECT] = score_held_out(data, by_viewer, of_viewers)
    scored |= {
        UNFITTED: scores_of(unfitted),
        CENTER: scores_of(people.center),
        SHUFFLED: scores_of(people.shuffled),
    }
    if subjects > 1:
        scored[PEOPLE] = score_people(people)
    results = {name: [*progress(each, name, count)] for name, each in scored.items()}
    return FitStudy(
        as_model(data, static, ordered, f"{count} images, subjects: {subjects}"),
        {
            name: PredictionScores(*zip(*rows, strict=True))
            for name, rows in results.items()
            if rows
        },
    )
