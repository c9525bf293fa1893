"""Models of fixations side by side: paired differences, references, scores of each fixation."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from saccade.errors import ConfigError, ImageError
from saccade.evaluation.fixations import (
    TINY,
    FixationScores,
    Map,
    distribution,
    fixation_density,
    inside,
    ranks,
    score,
    values_at,
)
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.prediction import Model, PredictionScores, other_fixations
from saccade.io.files import one_line
from saccade.types import FixationTable, Float32Array, FloatArray, Image

CENTER_WIDTH = 0.25
"""Standard deviation of the Gaussian in the center, as a fraction of each side."""


def center_model(sizes: Mapping[str, tuple[int, int]]) -> Model:
    """A Gaussian in the center, which sees nothing of the image."""

    def centered(name: str) -> Float32Array:
        y, x = (
            np.exp(-((((np.arange(side) + 0.5) / side - 0.5) / CENTER_WIDTH) ** 2) / 2)
            for side in sizes[name]
        )
        return np.outer(y, x).astype(np.float32)

    return centered


def shuffled_model(
    fixations: Mapping[str, FloatArray], sizes: Mapping[str, tuple[int, int]], sigma: float
) -> Model:
    """The density of the fixations of all other images: the baseline of the information gain."""

    def density(name: str) -> Float32Array:
        others = other_fixations(name, fixations, sizes)
        return fixation_density(others, sizes[name], sigma).astype(np.float32)

    return density


def score_people(
    table: FixationTable,
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    skip: int,
    sigma: float,
) -> Iterator[tuple[str, FixationScores]]:
    """Each viewer of an image against the fixation density of the others: the ceiling of models.

    Args:
        table: fixations of several viewers and images.
        fixations: by image, (n, 2), as `fixations_by_image` has them.
        sizes: by image, (H, W).
        skip: number of first fixations of each viewer that are left out.
        sigma: standard deviation of the blur in pixels.

    Yields:
        The name of each image with two viewers or more, and the mean over its viewers.
    """
    counted = table.index >= skip
    for name in fixations:
        size = sizes[name]
        others = other_fixations(name, fixations, sizes)
        baseline = fixation_density(others, size, sigma)
        scored = partial(score, others=others, sigma=sigma, baseline=baseline)
        here = counted & (table.image == name)
        rows = []
        for viewer in np.unique(table.viewer[here]):
            own = inside(table.xy[here & (table.viewer == viewer)], size)
            rest = inside(table.xy[here & (table.viewer != viewer)], size)
            if len(own) and len(rest):
                rows.append(astuple(scored(fixation_density(rest, size, sigma), own)))
        if rows:
            yield name, FixationScores(*np.mean(rows, axis=0).tolist())


class Difference(NamedTuple):
    """Mean of the paired differences of two models over the images, with its interval."""

    mean: FixationScores
    low: FixationScores
    high: FixationScores


class FixationRow(NamedTuple):
    """The scores of one fixation; their means over an image are those of its map."""

    image: str
    model: str
    viewer: int
    fixation: int
    """Its index."""
    x: float
    y: float
    auc: float
    """Fraction of the pixels that are less salient, ties counting half."""
    shuffled_auc: float
    """Shuffled AUC: AUC against the other images' fixations."""
    nss: float
    """Saliency in standard deviations above the mean of the map."""
    information_gain: float
    """Bits over the density of the other images' fixations."""


def paired_difference(
    first: PredictionScores, second: PredictionScores, confidence: float = 0.95
) -> Difference:
    """Bootstrap interval of `second` minus `first` over the images that both scored."""
    scored = dict(zip(first.name, first.scores, strict=True))
    both = [(scored[n], s) for n, s in zip(second.name, second.scores, strict=True) if n in scored]
    if not both:
        raise ImageError("models: expected images that both scored, found none")
    names = FixationScores.__dataclass_fields__
    table = np.array([[getattr(b, key) - getattr(a, key) for key in names] for a, b in both])
    low, high = mean_interval(table, confidence, PredictionScores.seed)
    return Difference(*(FixationScores(*row.tolist()) for row in (table.mean(axis=0), low, high)))


def fixation_rows(
    name: str,
    maps: Mapping[str, Map],
    table: FixationTable,
    fixations: Mapping[str, FloatArray],
    sizes: Mapping[str, tuple[int, int]],
    skip: int,
    sigma: float,
) -> Iterator[FixationRow]:
    """The scores of each fixation on an image by each model.

    Args:
        name: of the image.
        maps: by model, (H, W).
        table: fixations of several viewers and images.
        fixations: by image, as `fixations_by_image` has them.
        sizes: by image, (H, W).
        skip: number of first fixations of each viewer that are left out.
        sigma: standard deviation of the blur in pixels.
    """
    here = np.flatnonzero((table.index >= skip) & (table.image == name))
    visible = [i for i in here if len(inside(table.xy[i : i + 1], sizes[name]))]
    xy = table.xy[visible]
    others = other_fixations(name, fixations, sizes)
    baseline = distribution(fixation_density(others, sizes[name], sigma))
    for model, saliency in maps.items():
        at = values_at(saliency, xy)
        scores = zip(
            ranks(at, saliency.ravel()).tolist(),
            ranks(at, values_at(saliency, others)).tolist(),
            _standardized(at, saliency).tolist(),
            _bits(values_at(distribution(saliency), xy), values_at(baseline, xy)).tolist(),
            strict=True,
        )
        for i, values in zip(visible, scores, strict=True):
            x, y = table.xy[i].tolist()
            yield FixationRow(name, model, int(table.viewer[i]), int(table.index[i]), x, y, *values)


def _standardized(at: Map, saliency: Map) -> FloatArray:
    deviation = float(saliency.std())
    scale = 1 / deviation if deviation > 0 else 0.0
    return np.asarray((at - saliency.mean()) * scale, np.float64)


def _bits(predicted: Map, baseline: Map) -> FloatArray:
    return np.asarray(np.log2(TINY + predicted) - np.log2(TINY + baseline), np.float64)


def imported_model(name: str) -> Callable[[Image], Any]:
    """The function at module:function, from an image to its (h, w) saliency.

    Raises:
        ConfigError: there is no such function.
    """
    module, _, path = name.partition(":")
    try:
        found: Any = import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
    except Exception as error:  # whatever the module raises
        raise ConfigError(f"model: {name}: cannot be imported: {one_line(error)}") from error
    if not callable(found):
        raise ConfigError(f"model: {name}: expected a function, found {type(found).__name__}")
    result: Callable[[Image], Any] = found
    return result


def checked_map(values: Any, name: str) -> Map:
    """The map of a model of the user's, checked.

    Raises:
        ImageError: not finite numbers of shape (h, w).
    """
    try:
        array = np.asarray(values, np.float32)
    except (TypeError, ValueError) as error:
        raise ImageError(f"{name}: expected a map of numbers: {one_line(error)}") from error
    if array.ndim != 2 or array.size == 0 or not np.isfinite(array).all():
        raise ImageError(f"{name}: expected finite numbers of shape (h, w), found {array.shape}")
    return array
