"""A model of fixations whose weights were fitted to people's, by `saccade fit`.

The logarithm of the density of the next fixation is a weighted sum of features of the image and of
functions of the way from earlier fixations, so that its likelihood is convex (a conditional logit,
McFadden 1974). Lengths are fractions of the longer side of the image.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from saccade.attention._saccade_basis_kernels import fill_logits
from saccade.attention.combined import AttentionConfig, FaceDetector
from saccade.attention.features import AROUND, EARLY, FACES, GEOMETRY, feature_maps, map_names
from saccade.attention.models import SaliencyMaps
from saccade.errors import require, require_valid
from saccade.types import FloatArray, Image, IntArray

SCALES = (0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
"""Standard deviations of the Gaussians about an earlier fixation."""
NEAR = (0.03, 0.1)
"""Distances from which a direction counts."""
LAGS = (1, 1, 1, 1, 1, 1, 1, 1, 2, 3, 4, 5, 6, 7, 8)
"""The earlier fixation to which each table belongs, counted back from the next."""
FUNCTIONS = 53
"""Their number."""


@dataclass(frozen=True, eq=False, repr=False)
class FittedMaps(SaliencyMaps):
    """Saliency of a fitted model: (h, w) float32, in proportion to the density of fixations.

    Its maximum is 1.
    """


@dataclass(frozen=True)
class FittedModel:
    """Weights of the features of an image: the logarithm of the density of fixations.

    The default is the attention map itself. `saccade.load_model` reads a file of `saccade fit`.
    """

    features: tuple[str, ...] = ("attention",)
    """Their names; see `saccade.attention.features`."""
    weights: tuple[float, ...] = (1.0,)
    """Weight of each."""
    fitted_to: str = ""
    """Data that it was fitted to, for the reader."""
    attention: AttentionConfig = field(default_factory=AttentionConfig)
    """Settings of the maps."""
    scanpath_weights: tuple[float, ...] = ()
    """Weights of `next_fixation_density`: of the features; of those in `features.EARLY`, over the
    number of the fixation; of the functions of `saccade_tables`. None for a static model."""

    @property
    def _early(self) -> list[int]:
        return [i for i, name in enumerate(self.features) if name in EARLY]

    def __post_init__(self) -> None:
        require_valid(self)
        known = {*map_names(self.attention), *GEOMETRY, FACES}
        for name in self.features:
            base, around, cells = str(name).partition(AROUND)
            holds = base in known and (not around or _is_size(cells))
            require(holds, "features", "names of features of its attention settings", name)
        finite = all(isinstance(w, float) and np.isfinite(w) for w in self.weights)
        matching = len(self.weights) == len(self.features) > 0
        expected = f"a finite number for each of the {len(self.features)} features"
        require(finite and matching, "weights", expected, len(self.weights))
        count = len(self.features) + len(self._early) + FUNCTIONS
        finite = all(isinstance(w, float) and np.isfinite(w) for w in self.scanpath_weights)
        matching = len(self.scanpath_weights) in (0, count)
        expected = f"{count} finite numbers, or none"
        require(finite and matching, "scanpath_weights", expected, len(self.scanpath_weights))

    def maps(self, image: Image, faces: FaceDetector | None = None) -> FittedMaps:
        """The saliency of an image.

        Args:
            image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
            faces: finds (n, 4) boxes of faces, for a model with faces; None for none in sight.

        Raises:
            ImageError: as `attention_saliency`.
        """
        values = feature_maps(image, self.features, self.attention, faces)  # (k, h, w)
        log_density = np.tensordot(np.array(self.weights), values, 1)  # (h, w)
        saliency = np.exp(log_density - log_density.max()).astype(np.float32)
        height, width = np.shape(image)[:2]
        return FittedMaps(saliency, (height, width))

    def next_fixation_density(
        self, image: Image, xy: npt.ArrayLike, faces: FaceDetector | None = None
    ) -> FloatArray:
        """The probability of each cell of the map to hold the next fixation.

        Args:
            image: as for `maps`.
            xy: (n, 2) fixations so far in pixels; the first is the center, or where it began.
            faces: as for `maps`.

        Returns:
            (h, w), of sum 1.

        Raises:
            ConfigError: the model is static.
            ImageError: as `attention_saliency`.
        """
        require(len(self.scanpath_weights) > 0, "scanpath_weights", "a model of scanpaths", "none")
        values = feature_maps(image, self.features, self.attention, faces)  # (k, h, w)
        height, width = np.shape(image)[:2]
        weights = np.array(self.scanpath_weights)
        splits = np.cumsum([len(self.features), len(self._early)])
        of_features, of_early, of_saccade = np.split(weights, splits)
        fields = np.stack(
            [
                np.tensordot(of_features, values, 1),
                np.tensordot(of_early, values[self._early], 1),
            ]
        )
        tables = saccade_tables(values.shape[1:], (height, width)) @ of_saccade
        path = np.asarray(xy, np.float64).reshape(-1, 2)
        anchors, factors = path_terms(path, values.shape[1:], (height, width))
        density = np.empty(values.shape[1:])
        fill_logits(fields, tables, anchors, factors, density)
        density = np.exp(density - density.max())
        return np.asarray(density / density.sum())


def _is_size(cells: str) -> bool:
    return cells.isdecimal() and 0 < int(cells) <= 100


def saccade_tables(shape: tuple[int, int], image_shape: tuple[int, int]) -> FloatArray:
    """(T, 2 h - 1, 2 w - 1, m) the functions by table and offset in cells; the middle is 0, 0.

    Args:
        shape: (h, w) of the map.
        image_shape: (H, W) of the image.
    """
    (h, w), side = shape, max(image_shape)
    x = np.arange(1 - w, w) * image_shape[1] / side / w
    y = np.arange(1 - h, h)[:, None] * image_shape[0] / side / h
    x, y = np.broadcast_arrays(x, y)
    r = np.hypot(x, y)
    radial = [np.exp(-((r / s) ** 2) / 2) for s in SCALES]
    radial += [np.log1p((r / NEAR[0]) ** 2), r]
    away = [1 - np.exp(-((r / s) ** 2) / 2) for s in NEAR]
    cos, sin = x / np.maximum(r, 1e-9), y / np.maximum(r, 1e-9)
    cos2, sin2 = cos**2 - sin**2, 2 * sin * cos
    zeros = np.zeros_like(r)
    ahead = [[each * a for a in (*away, r)] for each in (cos, sin)]
    twice = [[each * a for a in away] for each in (cos2, sin2)]
    still = [*radial, *(cos2 * a for a in away), cos**8 * away[1], y, sin * away[0]]
    blocks = [
        {0: still},
        {1: ahead[0], 2: ahead[1]},
        {3: twice[0], 4: twice[1]},
        {5: radial[1:7]},
        {6: radial[1:7]},
        {7: [*radial[1:7], cos2 * away[0], y]},
        {8: radial[:7]},
        dict.fromkeys((9, 10, 11), radial[1:5]),
        dict.fromkeys((12, 13, 14), radial[1:5]),
    ]
    columns = [
        np.stack([block.get(t, [zeros] * len(first))[k] for t in range(len(LAGS))])
        for block in blocks
        for first in [next(iter(block.values()))]
        for k in range(len(first))
    ]
    return np.stack(columns, axis=-1)


def path_terms(
    xy: FloatArray, shape: tuple[int, ...], image_shape: tuple[int, int]
) -> tuple[IntArray, FloatArray]:
    """What the fixation after a path depends on.

    Args:
        xy: (n, 2) fixations so far in pixels, at least one; the last is the current one.
        shape: (h, w) of the map.
        image_shape: (H, W) of the image.

    Returns:
        (T, 2) row and column of the fixation of each table, and (T,) its factor, which is 0
        where no such fixation was.
    """
    n = len(xy)
    cells = np.floor((xy[:, ::-1] + 0.5) / image_shape * shape).astype(np.int64)
    anchors = cells.clip(0, np.array(shape) - 1)[[max(n - lag, 0) for lag in LAGS]]
    cos, sin, size = 0.0, 0.0, 0.0
    if n > 1:
        dx, dy = (xy[-1] - xy[-2]) / max(image_shape)
        amplitude = float(np.hypot(dx, dy))
        cos, sin = dx / (amplitude or 1.0), dy / (amplitude or 1.0)
        size = np.log(amplitude + NEAR[0])
    of_last = [1.0, cos, sin, cos**2 - sin**2, 2 * cos * sin, size, 1 / n, float(n == 1)]
    return anchors, np.array([*of_last, *(float(n >= lag) for lag in LAGS[8:])])
