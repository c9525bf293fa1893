"""How good a fitted model is: cross-validated scores, the learning curve, and its features."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from saccade.evaluation.comparison import Difference, paired_difference
from saccade.evaluation.fitting import (
    CellScores,
    Choice,
    FittingConfig,
    FittingData,
    cell_scores,
    choose,
    fit,
    group_of,
    log_density,
    split,
)
from saccade.evaluation.fixations import FixationScores, fixation_density, score
from saccade.evaluation.prediction import Model, PredictionScores, other_fixations
from saccade.pyramid import resize
from saccade.types import Float32Array, FloatArray, IntArray

SMALLEST = 5
"""Images to which the first point of the learning curve is fitted."""


@dataclass(frozen=True)
class GroupScores:
    """What a group of features contributes."""

    group: str
    """Its name."""
    count: int
    """Its number of features."""
    without: CellScores
    """All others alone."""
    alone: CellScores
    """It and the geometry alone."""


def image_model(
    data: FittingData, weights: list[FloatArray], sizes: Mapping[str, tuple[int, int]]
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
    choice: Choice,
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
    fitted = (
        [fit(data, everything, choice, config, np.setdiff1d(people, part)) for part in parts]
        if len(parts) > 1
        else []
    )
    for i, name in enumerate(data.images):
        others = other_fixations(name, fixations, sizes)
        baseline = fixation_density(others, sizes[name], sigma)
        scored = partial(score, others=others, sigma=sigma, baseline=baseline)
        rows = []
        for part, weights in zip(parts, fitted, strict=False):
            own = fixations[name][np.isin(data.viewers[i], part)]
            if len(own):
                rows.append(scored(saliency_of(data, i, weights, sizes[name]), own))
        if rows:
            yield name, _mean(rows)


def _mean(rows: list[FixationScores]) -> FixationScores:
    keys = FixationScores.__dataclass_fields__
    return FixationScores(*(float(np.mean([getattr(row, key) for row in rows])) for key in keys))


def learning_curve(data: FittingData, config: FittingConfig) -> Iterator[tuple[int, CellScores]]:
    """Scores of images left out, by the number of images that are fitted to.

    Features and penalty are chosen anew for each number, on the images of the first part.
    """
    count = len(data.images)
    parts = split(count, min(config.folds, 5), config.seed)
    largest = count - max(len(part) for part in parts)
    sizes = [*_doubling(SMALLEST, largest), largest]
    for size in sizes:
        rng = np.random.default_rng([config.seed, size])
        weights: dict[int, FloatArray] = {}
        choice = None
        for held in parts:
            others = np.sort(rng.permutation(np.delete(np.arange(count), held))[:size])
            choice = choice or choose(data, others, config)
            fitted = fit(data, others, choice, config)
            weights |= dict.fromkeys(held.tolist(), fitted)
        yield size, cell_scores(data, [*weights], [*weights.values()], _center(data, config))


def group_scores(
    data: FittingData, choice: Choice, config: FittingConfig
) -> Iterator[tuple[GroupScores, CellScores]]:
    """What each group of features contributes, and the scores with all, cross-validated.

    A product or a surrounding belongs to its own group, not to that of its maps.
    """
    groups = np.array([group_of(name) for name in data.names])
    chosen = np.isin(np.arange(len(groups)), choice.columns)
    geometry = chosen & (groups == group_of("border"))
    center = _center(data, config)

    def scored(kept: IntArray) -> CellScores:
        parts = split(len(data.images), min(config.folds, 5), config.seed)
        weights: dict[int, FloatArray] = {}
        for held in parts:
            others = np.delete(np.arange(len(data.images)), held)
            fitted = fit(data, others, Choice(kept, choice.strength), config)
            weights |= dict.fromkeys(held.tolist(), fitted)
        return cell_scores(data, [*weights], [*weights.values()], center)

    full = scored(np.flatnonzero(chosen))
    for group in dict.fromkeys(groups[chosen].tolist()):
        own = chosen & (groups == group)
        without, alone = (scored(np.flatnonzero(kept)) for kept in (chosen & ~own, own | geometry))
        yield GroupScores(group, int(own.sum()), without, alone), full


def differences(results: Mapping[str, PredictionScores], first: str) -> dict[str, Difference]:
    """Paired differences of one model from each of the others on the same images."""
    return {
        name: paired_difference(result, results[first])
        for name, result in results.items()
        if name != first
    }


def _center(data: FittingData, config: FittingConfig) -> FloatArray:
    """Weights of the geometry alone: the center that sees nothing of an image."""
    groups = np.array([group_of(name) for name in data.names])
    columns = np.flatnonzero(groups == group_of("border"))
    return fit(data, np.arange(len(data.images)), Choice(columns, 1.0), config)


def _doubling(first: int, limit: int) -> Iterator[int]:
    while first < limit:
        yield first
        first *= 2
