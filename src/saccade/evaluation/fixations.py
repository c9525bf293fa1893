"""How well a saliency map predicts where people look.

Every metric takes a map of any scale and offset that has the size of its image, and places in
pixels. Names and definitions follow Bylinskii, Judd, Oliva, Torralba & Durand, *What do different
evaluation metrics tell us about saliency models?* (TPAMI 2019).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from saccade.errors import ImageError
from saccade.types import FloatArray

Map = npt.NDArray[np.floating]

TINY = 2.2204e-16
"""Keeps quotients and logarithms finite, as in the MIT saliency benchmark."""


@dataclass(frozen=True)
class FixationScores:
    """The scores of one map, or their means over images."""

    auc: float
    """Area under the ROC curve, fixated places against all pixels; chance 0.5."""
    shuffled_auc: float
    """The same against places fixated in other images: a bias to the center earns nothing."""
    nss: float
    """Mean of the standardized map at the fixations; chance 0."""
    cc: float
    """Correlation with the blurred fixations; chance 0."""
    sim: float
    """Overlap of the map and the blurred fixations as distributions, 0 to 1."""
    kl: float
    """Divergence of the map's distribution from that of the blurred fixations, in nats; best 0."""
    information_gain: float
    """Bits a fixation that the map, as a distribution, tells beyond the baseline."""


def score(
    saliency: Map, fixations: FloatArray, others: FloatArray, sigma: float = 24.0
) -> FixationScores:
    """Every metric of one map.

    Args:
        saliency: (H, W) of the size of the image.
        fixations: (n, 2) x and y in pixels, in this image.
        others: (m, 2) fixations of the other images, scaled to this one; the negatives of the
            shuffled AUC and, blurred, the baseline of the information gain.
        sigma: of the blur, in pixels; about one degree of visual angle.

    Raises:
        ImageError: the map is not finite, or a place lies outside it.
    """
    if saliency.ndim != 2:
        raise ImageError(f"saliency map: expected shape (H, W), found {saliency.shape}")
    if not np.isfinite(saliency).all():
        raise ImageError("saliency map: expected finite values, found NaN or infinity")
    height, width = saliency.shape
    density = fixation_density(fixations, (height, width), sigma)
    baseline = fixation_density(others, (height, width), sigma)
    return FixationScores(
        auc=auc(saliency, fixations),
        shuffled_auc=shuffled_auc(saliency, fixations, others),
        nss=nss(saliency, fixations),
        cc=correlation(saliency, density),
        sim=similarity(saliency, density),
        kl=divergence(saliency, density),
        information_gain=information_gain(saliency, baseline, fixations),
    )


def auc(saliency: Map, fixations: FloatArray) -> float:
    """Chance that a fixated place is more salient than a pixel (AUC-Judd).

    Args:
        saliency: (H, W).
        fixations: (n, 2) x and y in pixels.
    """
    return roc_area(values_at(saliency, fixations), saliency.ravel())


def shuffled_auc(saliency: Map, fixations: FloatArray, others: FloatArray) -> float:
    """Chance that a fixated place is more salient than one fixated in another image.

    Args:
        saliency: (H, W).
        fixations: (n, 2) x and y in pixels.
        others: (m, 2) fixations of the other images, scaled to this one.
    """
    return roc_area(values_at(saliency, fixations), values_at(saliency, others))


def nss(saliency: Map, fixations: FloatArray) -> float:
    """Normalized scanpath saliency: how many deviations above its mean the map is at fixations."""
    deviation = float(saliency.std())
    if deviation == 0:
        return 0.0
    return float((values_at(saliency, fixations).mean() - saliency.mean()) / deviation)


def correlation(first: Map, second: Map) -> float:
    """Pearson's correlation of two maps; 0 where one is flat."""
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt((first * first).sum() * (second * second).sum()))
    return float((first * second).sum()) / norm if norm > 0 else 0.0


def similarity(first: Map, second: Map) -> float:
    """Overlap of two maps as distributions: the sum of the smaller at each pixel."""
    return float(np.minimum(distribution(first), distribution(second)).sum())


def divergence(saliency: Map, density: Map) -> float:
    """Kullback-Leibler divergence of the map from the density of fixations, in nats."""
    predicted, observed = distribution(saliency), distribution(density)
    return float((observed * np.log(TINY + observed / (TINY + predicted))).sum())


def information_gain(saliency: Map, baseline: Map, fixations: FloatArray) -> float:
    """Bits per fixation that the map, as a distribution, tells beyond a baseline.

    Args:
        saliency: (H, W).
        baseline: (H, W) what one knows without the image, such as the density of all fixations.
        fixations: (n, 2) x and y in pixels.
    """
    gain = np.log2(TINY + values_at(distribution(saliency), fixations))
    gain -= np.log2(TINY + values_at(distribution(baseline), fixations))
    return float(gain.mean())


def fixation_density(fixations: FloatArray, shape: tuple[int, int], sigma: float) -> FloatArray:
    """Fixations counted per pixel and blurred by a Gaussian.

    Args:
        fixations: (n, 2) x and y in pixels.
        shape: (H, W).
        sigma: of the Gaussian, in pixels; about one degree of visual angle.

    Returns:
        (H, W) counts per pixel.
    """
    counts = np.zeros(shape)
    rows, columns = _cells(fixations, shape)
    np.add.at(counts, (rows, columns), 1.0)
    return np.asarray(gaussian_filter(counts, sigma, mode="constant", truncate=4.0))


def distribution(saliency: Map) -> FloatArray:
    """A map shifted to be nowhere negative and scaled to the sum 1; even where it is flat."""
    positive = np.asarray(saliency, np.float64) - min(0.0, float(saliency.min()))
    total = float(positive.sum())
    if total == 0:
        return np.full(positive.shape, 1 / positive.size)
    return np.asarray(positive / total)


def values_at(saliency: Map, fixations: FloatArray) -> Map:
    """The map at the pixel that each fixation falls into."""
    rows, columns = _cells(fixations, saliency.shape)
    return saliency[rows, columns]


def roc_area(positives: Map, negatives: Map) -> float:
    """Chance that a positive exceeds a negative, ties counting half (Mann & Whitney 1947)."""
    ordered = np.sort(negatives)
    below = np.searchsorted(ordered, positives, side="left")
    not_above = np.searchsorted(ordered, positives, side="right")
    return float((below + not_above).mean() / (2 * len(ordered)))


def inside(fixations: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """The fixations that fall into an image of (H, W) pixels, (m, 2) of (n, 2)."""
    cells = np.floor(fixations + 0.5)
    return fixations[((cells >= 0) & (cells < (shape[1], shape[0]))).all(axis=1)]


def _cells(
    fixations: FloatArray, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    if len(fixations) == 0:
        raise ImageError("fixations: expected at least one, found none")
    if len(inside(fixations, shape)) < len(fixations):
        height, width = shape
        raise ImageError(f"fixations: expected places inside {width} x {height}; some lie outside")
    columns, rows = np.floor(fixations + 0.5).astype(np.intp).T
    return rows, columns
