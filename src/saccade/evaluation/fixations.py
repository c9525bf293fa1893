"""Metrics of fixation prediction by saliency maps.

Every metric takes a map at the size of the image, with any scale and offset, and fixations in
pixels. Names and definitions follow Bylinskii et al., TPAMI 2019 (doi:10.1109/TPAMI.2018.2815601).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.types import BoolArray, FloatArray, IntArray

Map = npt.NDArray[np.floating]

TINY = 2.2204e-16
"""Constant that keeps quotients and logarithms finite, as in the MIT saliency benchmark."""


BASELINE_FLOOR = 0.1
"""Weight of the uniform distribution in the baseline by which a density is divided for shuffled
AUC; the rest is the density of fixations on other images."""


@dataclass(frozen=True)
class FixationScores:
    """Scores of a map, or means over images."""

    auc: float
    """Area under the ROC curve, fixations against all pixels (AUC-Judd); chance 0.5."""
    shuffled_auc: float
    """AUC against fixations on other images, which removes the center bias; chance 0.5."""
    nss: float
    """Normalized scanpath saliency: mean of the standardized map at the fixations; chance 0."""
    cc: float
    """Pearson correlation with the fixation density; chance 0."""
    sim: float
    """Similarity: histogram intersection of map and fixation density, 0 to 1."""
    kl: float
    """Kullback-Leibler divergence of the map from the fixation density, in nats; best 0."""
    information_gain: float
    """Information gain over the baseline, in bits per fixation."""


def score(
    saliency: Map,
    fixations: FloatArray,
    others: FloatArray,
    sigma: float = 24.0,
    baseline: Map | None = None,
    *,
    density: bool = False,
) -> FixationScores:
    """Score one saliency map by every metric.

    A density is converted to the optimal map for each metric: unchanged for AUC, NSS and
    information gain; divided by the density of fixations on other images for shuffled AUC; blurred
    like the fixation density for CC, SIM and KL (nearly optimal for SIM).

    Args:
        saliency: (H, W) map at the size of the image.
        fixations: (n, 2) x and y in pixels of this image.
        others: (m, 2) fixations on other images, scaled to this image: the negatives of the
            shuffled AUC and, blurred, the baseline of the information gain; both are NaN without.
        sigma: standard deviation of the blur in pixels; about one degree of visual angle.
        baseline: (H, W) precomputed fixation density of `others`, for scoring many maps.
        density: whether the map is a nonnegative density, of any scale.

    Raises:
        ImageError: the map is not finite, or a fixation lies outside it.

    Source: for densities, Kummerer, Wallis & Bethge, *Saliency benchmarking made easy: separating
    models, maps and metrics* (ECCV 2018).
    """
    if saliency.ndim != 2:
        raise ImageError(f"saliency map: expected shape (H, W), found {saliency.shape}")
    if not np.isfinite(saliency).all():
        raise ImageError("saliency map: expected finite values, found NaN or infinity")
    height, width = saliency.shape
    if baseline is None:
        baseline = np.zeros((0, 0))
        if len(others):
            baseline = fixation_density(others, (height, width), sigma)
    observed = fixation_density(fixations, (height, width), sigma)
    relative: Map = saliency
    blurred: Map = saliency
    if density:
        from scipy.ndimage import gaussian_filter  # slow to import

        p = distribution(saliency)
        if len(others):
            relative = p / (distribution(baseline) + BASELINE_FLOOR / p.size)
        blurred = gaussian_filter(p, sigma, mode="constant", truncate=4.0)
    return FixationScores(
        auc=auc(saliency, fixations),
        shuffled_auc=shuffled_auc(relative, fixations, others) if len(others) else np.nan,
        nss=nss(saliency, fixations),
        cc=correlation(blurred, observed),
        sim=similarity(blurred, observed),
        kl=divergence(blurred, observed),
        information_gain=(
            information_gain(saliency, baseline, fixations) if len(others) else np.nan
        ),
    )


def auc(saliency: Map, fixations: FloatArray) -> float:
    """AUC-Judd: probability that a fixation is more salient than a pixel of the image."""
    return roc_area(values_at(saliency, fixations), saliency.ravel())


def shuffled_auc(saliency: Map, fixations: FloatArray, others: FloatArray) -> float:
    """Shuffled AUC: probability that a fixation is more salient than a fixation from elsewhere."""
    return roc_area(values_at(saliency, fixations), values_at(saliency, others))


def nss(saliency: Map, fixations: FloatArray) -> float:
    """Normalized scanpath saliency: mean of the standardized map at the fixations."""
    deviation = float(saliency.std())
    if deviation == 0:
        return 0.0
    return float((values_at(saliency, fixations).mean() - saliency.mean()) / deviation)


def correlation(first: Map, second: Map) -> float:
    """Pearson correlation of two maps; 0 if either is constant."""
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt((first * first).sum() * (second * second).sum()))
    return float((first * second).sum()) / norm if norm > 0 else 0.0


def similarity(first: Map, second: Map) -> float:
    """Histogram intersection of two maps as distributions."""
    return float(np.minimum(distribution(first), distribution(second)).sum())


def divergence(saliency: Map, density: Map) -> float:
    """Kullback-Leibler divergence of a map from the fixation density, in nats."""
    predicted, observed = distribution(saliency), distribution(density)
    return float((observed * np.log(TINY + observed / (TINY + predicted))).sum())


def information_gain(saliency: Map, baseline: Map, fixations: FloatArray) -> float:
    """Information gain of a map over a baseline, such as the density of all fixations, in bits."""
    gain = np.log2(TINY + values_at(distribution(saliency), fixations))
    gain -= np.log2(TINY + values_at(distribution(baseline), fixations))
    return float(gain.mean())


def fixation_density(fixations: FloatArray, shape: tuple[int, int], sigma: float) -> FloatArray:
    """Fixation density: fixations per pixel, blurred by a Gaussian.

    Args:
        fixations: (n, 2) x and y in pixels.
        shape: (H, W).
        sigma: standard deviation of the Gaussian in pixels.

    Returns:
        (H, W) counts per pixel.
    """
    rows, columns = _pixels(fixations, shape)
    along_y, along_x = (_gaussian_at_all(side, sigma) for side in shape)
    if len(rows) < max(shape):
        return np.asarray(along_y[:, rows] @ along_x[columns])
    counts = np.zeros(shape)
    np.add.at(counts, (rows, columns), 1.0)
    return np.asarray(along_y @ counts @ along_x)


@lru_cache(maxsize=8)
def _gaussian_at_all(side: int, sigma: float) -> FloatArray:
    """(side, side) matrix whose rows are Gaussians around each sample, truncated at 4 sigma."""
    from scipy.ndimage import gaussian_filter1d  # slow to import

    return np.asarray(gaussian_filter1d(np.eye(side), sigma, mode="constant", truncate=4.0))


def distribution(saliency: Map) -> FloatArray:
    """A map as a distribution, with a minimum of 0 and a sum of 1; uniform if constant."""
    positive = np.asarray(saliency, np.float64) - min(0.0, float(saliency.min()))
    total = float(positive.sum())
    if total == 0:
        return np.full(positive.shape, 1 / positive.size)
    return np.asarray(positive / total)


def values_at(saliency: Map, fixations: FloatArray) -> Map:
    """The map at the pixel of each fixation."""
    rows, columns = _pixels(fixations, saliency.shape)
    return saliency[rows, columns]


def roc_area(positives: Map, negatives: Map) -> float:
    """Probability that a positive exceeds a negative, ties counting half (Mann & Whitney 1947)."""
    return float(ranks(positives, negatives).mean())


def ranks(positives: Map, negatives: Map) -> FloatArray:
    """(n,) fraction of the negatives (m,) that each positive exceeds, ties counting half."""
    ordered = np.sort(negatives)
    below = np.searchsorted(ordered, positives, side="left")
    not_above = np.searchsorted(ordered, positives, side="right")
    return np.asarray((below + not_above) / (2 * len(ordered)), np.float64)


def inside(fixations: FloatArray, shape: tuple[int, ...] | IntArray) -> BoolArray:
    """(n,) True for fixations (n, 2) inside an image of (H, W) pixels, or images (n, 2)."""
    pixels = np.floor(fixations + 0.5)
    size = np.asarray(shape)[..., 1::-1]
    return np.asarray(((pixels >= 0) & (pixels < size)).all(axis=1))


def _pixels(
    fixations: FloatArray, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    if len(fixations) == 0:
        raise ImageError("fixations: expected at least one, found none")
    if not inside(fixations, shape).all():
        height, width = shape
        raise ImageError(f"fixations: expected points inside {width} x {height}; some lie outside")
    columns, rows = np.floor(fixations + 0.5).astype(np.intp).T
    return rows, columns
