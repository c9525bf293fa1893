"""Prediction of each next fixation, given those before it: NSS, AUC and information gain.

Definitions are those of pysaliency (Kummerer, Wallis & Bethge; conditional scores as in Kummerer &
Bethge 2021, *State-of-the-art in human scanpath prediction*), on the cells of the saliency map.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from saccade.attention.scanpath_model import ScanpathModelConfig, next_fixation_density
from saccade.evaluation.fixations import fixation_density
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.scanpaths import (
    OTHERS,
    PEOPLE,
    SAMPLED,
    SIMILAR,
    WALK,
    PathRow,
    Viewing,
    walk_model,
)
from saccade.types import Float32Array, FloatArray

STATIC, DENSITY = "saliency map", "static density"
MODELS = (PEOPLE, OTHERS, WALK, STATIC, DENSITY, SAMPLED, SIMILAR)
"""What predicts the next fixation: of these the walk and the sampled ones depend on those before;
the static density is the model without its kernel and inhibition."""
UNIFORM = 0.01
"""Fraction of a uniform distribution in the densities of fixations, so that none is 0."""
Density = Callable[[int, int], FloatArray]
"""Function from a viewer and the number of a fixation to the (h, w) prediction of it."""


@dataclass(frozen=True)
class FixationPrediction:
    """Scores of the prediction of one fixation."""

    nss: float
    """The prediction at the fixation, in standard deviations above its mean."""
    auc: float
    """Fraction of the cells that it exceeds there, ties counting half."""
    information_gain: float
    """Information gain over the fixations on other images, in bits; NaN of a map that is no
    density."""


class FixationRow(NamedTuple):
    """A fixation with the scores of a model."""

    image: str
    model: str
    """One of `MODELS`."""
    viewer: int
    fixation: int
    """Number of the fixation among those of the viewer that are scored."""
    scores: FixationPrediction


def score_fixations(
    name: str,
    people: Mapping[str, Viewing],
    saliency: Float32Array,
    model: ScanpathModelConfig,
    sigma: float,
) -> Iterator[FixationRow]:
    """Score the prediction of every fixation on an image.

    Args:
        name: of the image.
        people: scanpaths of the viewers by image.
        saliency: (h, w) of the image.
        model: the scanpath model; its first fixation starts from the center of the image.
        sigma: of the density of people's fixations, in pixels.
    """
    shape = people[name].shape
    center = np.array([[(shape[1] - 1) / 2, (shape[0] - 1) / 2]])
    paths = {viewer: path.xy for viewer, path in people[name].paths.items()}
    past = {viewer: np.vstack([center, xy]) for viewer, xy in paths.items()}
    still = replace(model, amplitude_exponent=0.0, horizontal=0.0, persistence=0.0, inhibition=0.0)
    static = next_fixation_density(saliency, shape, center, still)
    everywhere = np.ones_like(saliency)
    baseline = cell_density(_elsewhere(name, people), shape, saliency.shape, sigma)
    rest = {
        viewer: cell_density(
            np.vstack([xy for other, xy in paths.items() if other != viewer]),
            *(shape, saliency.shape, sigma),
        )
        for viewer in paths
    }
    walk, similar = walk_model(model), ScanpathModelConfig.similar()
    predictions: dict[str, Density] = {
        PEOPLE: lambda viewer, _: rest[viewer],
        OTHERS: lambda _, __: baseline,
        WALK: lambda viewer, k: next_fixation_density(
            everywhere, shape, past[viewer][: k + 1], walk
        ),
        STATIC: lambda _, __: saliency.astype(np.float64),
        DENSITY: lambda _, __: static,
        SAMPLED: lambda viewer, k: next_fixation_density(
            saliency, shape, past[viewer][: k + 1], model
        ),
        SIMILAR: lambda viewer, k: next_fixation_density(
            saliency, shape, past[viewer][: k + 1], similar
        ),
    }
    for viewer, xy in paths.items():
        cells = _cells(xy, shape, saliency.shape)
        for kind, predict in predictions.items():
            for k, cell in enumerate(cells):
                values = predict(viewer, k).ravel()
                gain = np.log2(values[cell] / baseline.ravel()[cell]) if kind != STATIC else np.nan
                scores = FixationPrediction(
                    nss=float((values[cell] - values.mean()) / (values.std() or 1.0)),
                    auc=_exceeded(values, int(cell)),
                    information_gain=float(gain),
                )
                yield FixationRow(name, kind, viewer, k, scores)


def _exceeded(values: FloatArray, cell: int) -> float:
    """Fraction of the cells that are below one of them, ties counting half."""
    below, equal = values < values[cell], values == values[cell]
    return float((below.sum() + 0.5 * equal.sum()) / len(values))


def _elsewhere(name: str, people: Mapping[str, Viewing]) -> FloatArray:
    """(n, 2) fixations on the other images, scaled to this one."""
    scaled = [
        (path.xy + 0.5) * (np.array(people[name].shape[::-1]) / viewing.shape[::-1]) - 0.5
        for other, viewing in people.items()
        if other != name
        for path in viewing.paths.values()
    ]
    return np.vstack(scaled)


def cell_density(
    xy: FloatArray, shape: tuple[int, int], cells: tuple[int, ...], sigma: float
) -> FloatArray:
    """(h, w) distribution of fixations (n, 2), of sum 1."""
    h, w = cells
    scale = np.array([w / shape[1], h / shape[0]])
    blurred = fixation_density(
        ((xy + 0.5) * scale - 0.5).clip(0, (w - 1, h - 1)), (h, w), sigma * float(scale.mean())
    )
    return np.asarray((1 - UNIFORM) * blurred / blurred.sum() + UNIFORM / blurred.size)


def _cells(xy: FloatArray, shape: tuple[int, int], cells: tuple[int, ...]) -> FloatArray:
    """(n,) number of the cell, row by row, of each fixation (n, 2) in pixels."""
    h, w = cells
    columns, rows = np.floor((xy + 0.5) / shape[::-1] * (w, h)).astype(np.int64).T
    return np.asarray(rows.clip(0, h - 1) * w + columns.clip(0, w - 1))


SEED = 20102
"""Seed of the bootstrap: equal scores always have equal intervals."""


class MeanScore(NamedTuple):
    """A mean over images."""

    mean: float
    low: float
    """Lower end of the 95 % bootstrap interval."""
    high: float
    """Upper end of it."""


Summary = Mapping[str, Mapping[str, MeanScore]]
"""By source or model, and by the name of the score; without scores that no image has."""


def summary(rows: Iterable[PathRow | FixationRow]) -> Summary:
    """Means over images of the means of their paths or fixations, by source or model."""
    values: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        group = values.setdefault(row[1], {})
        for score, value in asdict(row.scores).items():
            group.setdefault(score, {}).setdefault(row.image, []).append(value)
    return {
        name: {score: _mean_score(images) for score, images in scores.items() if _known(images)}
        for name, scores in values.items()
    }


def tidy(rows: Sequence[PathRow | FixationRow]) -> list[list[str]]:
    """Rows of a table with a heading, one for each path or fixation; what is unknown is empty."""
    keys = [name for name in rows[0]._fields if name not in ("path", "scores")]
    table = [[*keys, *asdict(rows[0].scores)]]
    for row in rows:
        scores = asdict(row.scores).values()
        cells = ["" if np.isnan(value) else f"{value:.6g}" for value in scores]
        table.append([*(str(getattr(row, key)) for key in keys), *cells])
    return table


def _known(images: Mapping[str, Sequence[float]]) -> list[float]:
    """Means of the images that have a score."""
    arrays = (np.array(values) for values in images.values())
    known = (values[np.isfinite(values)] for values in arrays)
    return [float(values.mean()) for values in known if len(values)]


def _mean_score(images: Mapping[str, Sequence[float]]) -> MeanScore:
    table = np.array(_known(images))[:, None]
    low, high = mean_interval(table, 0.95, SEED)
    return MeanScore(float(table.mean()), float(low[0]), float(high[0]))
