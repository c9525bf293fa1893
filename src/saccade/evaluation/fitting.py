"""Fits a model of fixations to photographs and the people who looked at them.

The logarithm of the density of fixations is a weighted sum of features of the image. The weights
are those of a logistic regression that tells fixated cells of the map from random ones: with many
random cells it has the maximum likelihood of an inhomogeneous Poisson process (Fithian & Hastie
2013). Every image has the same weight. scikit-learn (extra `fit`) fits; prediction needs NumPy.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from saccade.attention.combined import AttentionConfig
from saccade.attention.faces import FaceDetector
from saccade.attention.features import AROUND, GEOMETRY, TIMES, feature_maps, feature_names
from saccade.attention.fitted import FittedModel
from saccade.errors import LogError, require, require_ranges, require_types
from saccade.evaluation.fixations import TINY, roc_area
from saccade.extras import import_optional
from saccade.types import BoolArray, Float32Array, FloatArray, Image, IntArray

MAPS, SURROUNDINGS, PRODUCTS = "maps", "surroundings", "products"
KINDS = ((MAPS,), (MAPS, SURROUNDINGS), (MAPS, SURROUNDINGS, PRODUCTS))
"""Sets of features among which nested cross-validation chooses."""
STRENGTHS = (0.003, 0.03, 0.3)
"""Inverse strengths of the penalty among which it chooses, with all features."""
INNER_FOLDS = 4
"""Parts of the images that are fitted to, each left out once to choose."""
PSEUDO_OBSERVATIONS = 100.0
"""Weight of the fixations of an image against the penalty, and of its random cells."""


@dataclass(frozen=True)
class FittingConfig:
    """How a model is fitted and cross-validated."""

    folds: int = 5
    """Parts of the images, or viewers, each left out once."""
    random_cells: int = 300
    """Cells of each image against which its fixated cells are told."""
    seed: int = 2020
    """Seed of the folds and of the random cells."""

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(self, folds=(2, 100), random_cells=(10, 100_000), seed=(0, 2**31))


@dataclass(frozen=True, eq=False)
class FittingData:
    """The features and fixations of images."""

    images: Sequence[str]
    """(n,) names."""
    names: Sequence[str]
    """(k,) names of the features."""
    values: Sequence[Float32Array]
    """(k, h, w) features of each image."""
    fixations: Sequence[FloatArray]
    """(m, 2) fixations of each image, x and y as fractions of its sides."""
    viewers: Sequence[IntArray]
    """(m,) their viewers."""
    attention: AttentionConfig
    """Settings of the maps."""

    @cached_property
    def cells(self) -> list[IntArray]:
        """(m,) cell of each fixation, row by row, of each image."""
        return [
            _cells(xy, values.shape[1:])
            for xy, values in zip(self.fixations, self.values, strict=True)
        ]

    def columns(self, kinds: Sequence[str]) -> IntArray:
        """The features of some kinds."""
        faces = self.names[-1] not in GEOMETRY
        kept = set(feature_names(self.attention, kinds, faces=faces))
        return np.array([i for i, name in enumerate(self.names) if name in kept])


@dataclass(frozen=True, eq=False)
class Choice:
    """What nested cross-validation has chosen."""

    columns: IntArray
    """Features, by number."""
    strength: float
    """Inverse strength of the penalty."""


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
        fixations: of each image, (m, 2) x and y in pixels, inside it.
        viewers: of each image, (m,) the number of each fixation's viewer.
        attention: settings of the maps.
        faces: finds faces, so that they are a feature; None for a model without.
    """
    attention = attention or AttentionConfig()
    kinds = KINDS[-1]
    names = feature_names(attention, kinds, faces=faces is not None)
    for name, xy, viewer in zip(images, fixations, viewers, strict=True):
        image = read(name)
        height, width = image.shape[:2]
        values = feature_maps(image, names, attention, faces).astype(np.float32)
        relative = (xy + 0.5) / (width, height)
        yield FittingData([name], names, [values], [relative], [viewer], attention)


def merge(parts: Sequence[FittingData]) -> FittingData:
    """The data of images as one.

    Raises:
        LogError: there are fewer than four images, which is too few to cross-validate.
    """
    if len(parts) < 4:
        raise LogError(f"fixations: expected at least four images to fit to, found {len(parts)}")
    return FittingData(
        [name for part in parts for name in part.images],
        parts[0].names,
        [values for part in parts for values in part.values],
        [xy for part in parts for xy in part.fixations],
        [viewer for part in parts for viewer in part.viewers],
        parts[0].attention,
    )


def fit(
    data: FittingData,
    images: IntArray,
    choice: Choice,
    config: FittingConfig,
    viewers: IntArray | None = None,
) -> FloatArray:
    """The weights (k,) of all features, 0 of those not chosen.

    Args:
        data: features and fixations.
        images: numbers of those that are fitted to.
        choice: features and penalty.
        config: number of random cells, and seed.
        viewers: whose fixations count; None for all.

    Raises:
        ConfigError: scikit-learn is not installed.
    """
    linear_model = import_optional("sklearn.linear_model", "fit")
    samples, weights, fixated = [], [], []
    for i in images:
        flat = data.values[i].reshape(len(data.names), -1)[choice.columns]  # (c, cells)
        cells = data.cells[i]
        if viewers is not None:
            cells = cells[np.isin(data.viewers[i], viewers)]
        if len(cells) == 0:
            continue
        at, counts = np.unique(cells, return_counts=True)
        rng = np.random.default_rng([config.seed, int(i)])
        random = rng.permutation(flat.shape[1])[: config.random_cells]
        samples += [flat[:, at].T, flat[:, random].T]
        weights += [counts / counts.sum(), np.full(len(random), 1 / len(random))]
        fixated += [np.ones(len(at)), np.zeros(len(random))]
    x = np.vstack(samples).astype(np.float64)
    mean, deviation = x.mean(axis=0), x.std(axis=0)
    deviation[deviation < 1e-9] = np.inf  # constant in these images
    regression = linear_model.LogisticRegression(
        C=choice.strength, solver="newton-cholesky", max_iter=200
    )
    regression.fit(
        (x - mean) / deviation,
        np.concatenate(fixated),
        sample_weight=PSEUDO_OBSERVATIONS * np.concatenate(weights),
    )
    found = np.zeros(len(data.names))
    found[choice.columns] = regression.coef_[0] / deviation
    return found


def choose(
    data: FittingData,
    images: IntArray,
    config: FittingConfig,
    only: BoolArray | None = None,
) -> Choice:
    """The features and penalty of highest likelihood on images that are left out of the fit.

    Args:
        data: features and fixations.
        images: numbers of those that may be used.
        config: seed of the parts.
        only: (k,) the features that may be used; None for all.
    """
    allowed = np.ones(len(data.names), np.bool_) if only is None else only
    sets = [columns[allowed[columns]] for columns in map(data.columns, KINDS)]
    require(len(sets[-1]) > 0, "features", "at least one", 0)
    gain = partial(_held_out_gain, data, images, config)
    best = max((Choice(sets[-1], strength) for strength in STRENGTHS), key=gain)
    fewer = [Choice(columns, best.strength) for columns in sets[:-1] if len(columns)]
    return max([best, *fewer], key=gain)


def _held_out_gain(
    data: FittingData, images: IntArray, config: FittingConfig, choice: Choice
) -> float:
    """Mean logarithm of the probability of the fixations on images left out of the fit."""
    gains = []
    for held in split(len(images), INNER_FOLDS, config.seed):
        weights = fit(data, np.delete(images, held), choice, config)
        gains += [log_density(data, i, weights)[data.cells[i]].mean() for i in images[held]]
    return float(np.mean(gains))


def split(count: int, folds: int, seed: int) -> list[IntArray]:
    """Numbers from 0 in random parts of about equal size; no more parts than numbers."""
    order = np.random.default_rng(seed).permutation(count)
    folds = min(folds, count)
    return [np.sort(order[part::folds]) for part in range(folds)]


def log_density(data: FittingData, image: int, weights: FloatArray) -> FloatArray:
    """(h * w,) natural logarithm of the probability of each cell of an image."""
    used = np.flatnonzero(weights)
    values = data.values[image].reshape(len(data.names), -1)
    logits = weights[used] @ values[used]
    shifted = logits - logits.max()
    return np.asarray(shifted - np.log(np.exp(shifted).sum()), np.float64)


def cross_validate_images(
    data: FittingData, config: FittingConfig
) -> tuple[list[FloatArray], list[Choice]]:
    """Weights for each image, fitted to others; features and penalty are chosen among these."""
    weights: list[FloatArray] = [np.zeros(0)] * len(data.images)
    choices = []
    for held in split(len(data.images), config.folds, config.seed):
        others = np.delete(np.arange(len(data.images)), held)
        choice = choose(data, others, config)
        choices.append(choice)
        fitted = fit(data, others, choice, config)
        for i in held:
            weights[i] = fitted
    return weights, choices


def fit_all(data: FittingData, choice: Choice, config: FittingConfig) -> FittedModel:
    """The model fitted to all images."""
    weights = fit(data, np.arange(len(data.images)), choice, config)
    viewers = len(np.unique(np.concatenate(list(data.viewers))))
    return as_model(data, weights, f"{len(data.images)} images, viewers: {viewers}")


def as_model(data: FittingData, weights: FloatArray, fitted_to: str = "") -> FittedModel:
    """The model of some weights (k,)."""
    used = np.flatnonzero(weights).tolist()
    return FittedModel(
        tuple(data.names[i] for i in used),
        tuple(float(f"{weights[i]:.6g}") for i in used),
        fitted_to,
        data.attention,
    )


@dataclass(frozen=True)
class CellScores:
    """Scores on the cells of the map, mean over images: coarse, and quick to compute."""

    auc: float
    """As the AUC of pixels."""
    nss: float
    """As the NSS of pixels."""
    information_gain: float
    """Bits per fixation over the geometry of the images that are fitted to."""


def cell_scores(
    data: FittingData, images: Sequence[int], weights: Sequence[FloatArray], center: FloatArray
) -> CellScores:
    """The scores of weights for each of some images.

    Args:
        data: features and fixations.
        images: (n,) numbers.
        weights: (k,) for each.
        center: (k,) weights of the geometry alone.
    """
    rows = []
    for i, of_image in zip(images, weights, strict=True):
        cells = data.cells[i]
        log_p = log_density(data, i, of_image)
        p = np.exp(log_p)
        gain = (log_p[cells] - log_density(data, i, center)[cells]).mean() / np.log(2)
        deviation = (p[cells].mean() - p.mean()) / (p.std() + TINY)
        rows.append((roc_area(p[cells], p), deviation, gain))
    return CellScores(*np.mean(rows, axis=0).tolist())


def group_of(name: str) -> str:
    """The group to which a feature belongs, for the question which features carry a model."""
    if TIMES in name:
        return PRODUCTS
    if AROUND in name:
        return SURROUNDINGS
    if name in GEOMETRY:
        return "center and border"
    first = name.split()[0]
    if name in ("color distance", "skin"):
        return "color distance and skin"
    own = ("attention", "symmetry", "boolean", "faces")
    return first if first in own else "contrast"


def _cells(xy: FloatArray, shape: tuple[int, ...]) -> IntArray:
    rows, columns = shape
    x = np.clip((xy[:, 0] * columns).astype(np.intp), 0, columns - 1)
    y = np.clip((xy[:, 1] * rows).astype(np.intp), 0, rows - 1)
    return np.asarray(y * columns + x, np.intp)
