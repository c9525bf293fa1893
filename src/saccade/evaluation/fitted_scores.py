"""How good a fitted model is: cross-validated scores of its maps, and of each next fixation."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from saccade.attention._saccade_basis_kernels import fill_logits
from saccade.evaluation.comparison import Difference, paired_difference
from saccade.evaluation.conditional import cell_density
from saccade.evaluation.fitting import FittingConfig, FittingData, Weights, fit, log_density, split
from saccade.evaluation.fixations import FixationScores, fixation_density, score
from saccade.evaluation.prediction import Model, PredictionScores, other_fixations
from saccade.scale.pyramid import resize
from saccade.types import Float32Array, FloatArray, IntArray

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
