"""Conditional fixation prediction given the earlier fixations: NSS, AUC and information gain.

Definitions follow pysaliency (Kummerer, Wallis & Bethge; conditional scores as in Kummerer & Bethge
2021, *State-of-the-art in human scanpath prediction*), on the cells of the saliency map.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np

from saccade.attention.maps import SaliencyMaps
from saccade.attention.scanpath_model import ScanpathModelConfig, next_fixation_density
from saccade.evaluation.fixations import fixation_density, ranks
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.prediction import FixationData
from saccade.evaluation.scanpaths import (
    OTHERS,
    PEOPLE,
    SAMPLED,
    SIMILAR,
    WALK,
    PathRow,
    walk_model,
)
from saccade.types import Float32Array, FloatArray, IntArray

STATIC = "saliency map"
DENSITY = "static density"
MODELS = (PEOPLE, OTHERS, WALK, STATIC, DENSITY, SAMPLED, SIMILAR)
"""Predictors of the next fixation. The static density is the scanpath model without kernel and
inhibition."""
UNIFORM = 0.01
"""Weight of a uniform distribution in fixation densities, which keeps them positive."""
BOOTSTRAP_SEED = 20102
"""Seed of the bootstrap, fixed so that equal scores have equal intervals."""


@dataclass(frozen=True)
class FixationPrediction:
    """Scores of the prediction of one fixation."""

    nss: float
    """Standardized prediction at the fixation."""
    auc: float
    """Fraction of the cells with a lower prediction, ties counting half."""
    information_gain: float
    """Information gain over the fixations on other images, in bits; NaN for maps that are not
    densities."""


class FixationRow(NamedTuple):
    """Scores of a model on one fixation."""

    image: str
    model: str
    """One of `MODELS`."""
    scores: FixationPrediction


def score_fixations(
    name: str, data: FixationData, saliency: Float32Array, model: ScanpathModelConfig
) -> Iterator[FixationRow]:
    """Score the prediction of every fixation on an image.

    Args:
        name: name of the image.
        data: fixations of several subjects on the image.
        saliency: (h, w) saliency of the image.
        model: the scanpath model; its first fixation starts from the center of the image.
    """
    shape, seen = data.sizes[name], data.on(name)
    center = np.array([[(shape[1] - 1) / 2, (shape[0] - 1) / 2]])
    first = np.searchsorted(seen.scanpath, seen.scanpath)  # the table is sorted by scanpath
    past = [np.vstack([center, seen.xy[start:i]]) for i, start in enumerate(first.tolist())]
    cells = np.ravel_multi_index(tuple(cells_of(seen.xy, shape, saliency.shape).T), saliency.shape)

    def density_of(xy: FloatArray) -> FloatArray:
        return _cell_density(xy, shape, saliency.shape, data.sigma_of(name))

    def sampled(values: Float32Array, config: ScanpathModelConfig) -> Iterator[FloatArray]:
        maps = SaliencyMaps(values, shape)
        return (next_fixation_density(maps, before, config) for before in past)

    still = replace(model, amplitude_exponent=0.0, horizontal=0.0, persistence=0.0, inhibition=0.0)
    baseline = density_of(data.elsewhere(name))
    rest = {each: density_of(seen.xy[seen.subject != each]) for each in {*seen.subject.tolist()}}
    predictions: dict[str, Iterable[FloatArray]] = {
        PEOPLE: (rest[subject] for subject in seen.subject.tolist()),
        OTHERS: repeat(baseline),
        WALK: sampled(np.ones_like(saliency), walk_model(model)),
        STATIC: repeat(saliency.astype(np.float64)),
        DENSITY: repeat(next_fixation_density(SaliencyMaps(saliency, shape), center, still)),
        SAMPLED: sampled(saliency, model),
        SIMILAR: sampled(saliency, ScanpathModelConfig.similar()),
    }
    for kind, densities in predictions.items():
        for cell, density in zip(cells.tolist(), densities, strict=False):
            values = density.ravel()
            with np.errstate(divide="ignore"):  # maps that are not densities may be 0 there
                gain = float(np.log2(values[cell] / baseline.ravel()[cell]))
            scores = FixationPrediction(
                nss=float((values[cell] - values.mean()) / (values.std() or 1.0)),
                auc=float(ranks(values[cell : cell + 1], values)[0]),
                information_gain=np.nan if kind == STATIC else gain,
            )
            yield FixationRow(name, kind, scores)


def _cell_density(
    xy: FloatArray, shape: tuple[int, int], cells: tuple[int, ...], sigma: float
) -> FloatArray:
    """(h, w) distribution of fixations (n, 2), with a sum of 1."""
    h, w = cells
    scale = np.array([w / shape[1], h / shape[0]])
    blurred = fixation_density(
        ((xy + 0.5) * scale - 0.5).clip(0, (w - 1, h - 1)), (h, w), sigma * float(scale.mean())
    )
    return np.asarray((1 - UNIFORM) * blurred / blurred.sum() + UNIFORM / blurred.size)


def cells_of(xy: FloatArray, shape: tuple[int, int], cells: tuple[int, ...]) -> IntArray:
    """(n, 2) row and column of the cells of (h, w) in which fixations (n, 2) in pixels lie."""
    at = np.floor((xy[:, ::-1] + 0.5) / shape * cells)
    return np.asarray(at.clip(0, np.array(cells) - 1).astype(np.int64))


class MeanScore(NamedTuple):
    """Mean of a score over images, with its 95 % bootstrap interval."""

    mean: float
    low: float
    high: float


Summary = Mapping[str, Mapping[str, MeanScore]]
"""Mean scores by source or model and by name; scores that no image has are absent."""


def summary(rows: Iterable[PathRow | FixationRow]) -> Summary:
    """Means over images of per-image means, by source or model."""
    values: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        scores = values.setdefault(row[1], {})
        for score, value in asdict(row.scores).items():
            images = scores.setdefault(score, {})
            if np.isfinite(value):
                images.setdefault(row.image, []).append(value)
    return {
        name: {score: _mean_score(images) for score, images in scores.items() if images}
        for name, scores in values.items()
    }


def _mean_score(images: Mapping[str, Sequence[float]]) -> MeanScore:
    table = np.array([np.mean(values) for values in images.values()])[:, None]
    low, high = mean_interval(table, BOOTSTRAP_SEED)
    return MeanScore(float(table.mean()), float(low[0]), float(high[0]))
