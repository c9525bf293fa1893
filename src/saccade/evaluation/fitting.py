"""Fits a model of fixations to photographs and the people who looked at them.

The next fixation is one of the cells of the map. The logarithm of its probability is a weighted sum
of features of the image and of functions of the way from earlier fixations, but for a constant:
the likelihood is convex (a conditional logit, McFadden 1974). A quadratic penalty holds the
standardized weights small. Without the functions of the way it is the static density.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count as count_from
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from saccade.attention.combined import AttentionConfig, FaceDetector
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
from saccade.types import Float32Array, FloatArray, Image, IntArray


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
    """The features and fixations of images."""

    images: Sequence[str]
    """(n,) names."""
    names: Sequence[str]
    """(k,) names of the features."""
    values: Sequence[Float32Array]
    """(k, h, w) features of each image."""
    sizes: Sequence[tuple[int, int]]
    """(H, W) of each image."""
    fixations: Sequence[FloatArray]
    """(m, 2) fixations of each image in pixels, those of a viewer in their order."""
    viewers: Sequence[IntArray]
    """(m,) their viewers."""
    attention: AttentionConfig
    """Settings of the maps."""

    @cached_property
    def steps(self) -> list[Steps]:
        """The fixations of each image, those of a viewer after a first one in the center."""
        found = []
        pairs = zip(self.fixations, self.viewers, self.values, self.sizes, strict=True)
        for xy, viewers, values, size in pairs:
            rows: list[Steps | None] = [None] * len(xy)
            for viewer in np.unique(viewers):
                path = [((size[1] - 1) / 2, (size[0] - 1) / 2)]
                for k in np.flatnonzero(viewers == viewer):
                    anchors, factors = path_terms(np.array(path), values.shape[1:], size)
                    path.append((xy[k, 0], xy[k, 1]))
                    cell = np.floor((xy[k, ::-1] + 0.5) / size * values.shape[1:])
                    cell = cell.clip(0, np.array(values.shape[1:]) - 1).astype(np.int64)
                    rows[k] = Steps(cell, anchors, factors)
            known = [row for row in rows if row is not None]
            found.append(Steps(*(np.array(column) for column in zip(*known, strict=True))))
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


def collect(
    images: Sequence[str],
    read: Callable[[str], Image],
    fixations: Sequence[FloatArray],
    viewers: Sequence[IntArray],
    attention: AttentionConfig | None = None,
    faces: FaceDetector | None = None,
) -> Iterator[FittingData]:
    """The data of images one by one; `merge` joins them.

    Args:
        images: (n,) names.
        read: from a name to its pixels.
        fixations: of each image, (m, 2) x and y in pixels, inside it, in the order of each viewer.
        viewers: of each image, (m,) the number of each fixation's viewer.
        attention: settings of the maps.
        faces: finds faces, so that they are a feature; None for a model without.
    """
    attention = attention or AttentionConfig()
    names = feature_names(attention, faces=faces is not None)
    for name, xy, viewer in zip(images, fixations, viewers, strict=True):
        image = read(name)
        size = (image.shape[0], image.shape[1])
        values = feature_maps(image, names, attention, faces).astype(np.float32)
        yield FittingData([name], names, [values], [size], [xy], [viewer], attention)


def merge(parts: Sequence[FittingData]) -> FittingData:
    """The data of images as one.

    Raises:
        LogError: there are fewer than four images, which is too few to cross-validate.
    """
    if len(parts) < 4:
        raise LogError(f"fixations: expected at least four images to fit to, found {len(parts)}")
    first = parts[0]
    return FittingData(
        [part.images[0] for part in parts],
        first.names,
        [part.values[0] for part in parts],
        [part.sizes[0] for part in parts],
        [part.fixations[0] for part in parts],
        [part.viewers[0] for part in parts],
        first.attention,
    )


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
    images: IntArray,
    config: FittingConfig,
    *,
    ordered: bool = True,
    viewers: IntArray | None = None,
    progress: Callable[[int], None] = lambda _iterations: None,
) -> Weights:
    """The weights of highest penalized likelihood.

    Args:
        data: features and fixations.
        images: numbers of those that are fitted to.
        config: the penalty.
        ordered: whether a fixation depends on those before; otherwise on the image alone.
        viewers: whose fixations count; None for all.
        progress: called after each iteration of the optimization, with their number.
    """
    k, e = len(data.names), len(data.early)
    mean, deviation = data.moments
    basis = next(iter(data.tables.values()))
    spread = basis.reshape(len(basis), -1, basis.shape[-1]).std(1).max(0)  # of its own table
    scale = np.concatenate([deviation, deviation[data.early], spread])
    parts = []
    for i in images:
        kept = slice(None) if viewers is None else np.isin(data.viewers[i], viewers)
        parts.append((int(i), Steps(*(column[kept] for column in data.steps[i]))))
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


def split(count: int, folds: int, seed: int) -> list[IntArray]:
    """Numbers from 0 in random parts of about equal size; no more parts than numbers."""
    order = np.random.default_rng(seed).permutation(count)
    folds = min(folds, count)
    return [np.sort(order[part::folds]) for part in range(folds)]


def cross_validate_images(
    data: FittingData,
    config: FittingConfig,
    *,
    ordered: bool = True,
    progress: Callable[[int], None] = lambda _iterations: None,
) -> list[Weights]:
    """Weights for each image, fitted to others; `progress` counts the iterations of all fits."""
    weights: dict[int, Weights] = {}
    for number, held in enumerate(split(len(data.images), config.folds, config.seed)):
        others = np.delete(np.arange(len(data.images)), held)

        def iterated(count: int, before: int = number * config.iterations) -> None:
            progress(before + count)

        found = fit(data, others, config, ordered=ordered, progress=iterated)
        weights |= dict.fromkeys(held.tolist(), found)
    return [weights[i] for i in range(len(data.images))]


def log_density(data: FittingData, image: int, weights: FloatArray) -> FloatArray:
    """(h * w,) natural logarithm of the probability of each cell of an image, whatever the path."""
    logits = weights @ data.values[image].reshape(len(data.names), -1)
    shifted = logits - logits.max()
    return np.asarray(shifted - np.log(np.exp(shifted).sum()), np.float64)


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
