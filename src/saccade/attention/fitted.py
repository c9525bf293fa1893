"""Fixation models whose weights were fitted to recorded fixations by `saccade fit`.

The logarithm of the density of the next fixation is a weighted sum of features of the image and of
functions of the displacement from earlier fixations, so that the negative log-likelihood is convex
(a conditional logit, McFadden 1974). Lengths are fractions of the longer side of the image.

A feature map is the logarithm of a map of `attention_saliency`, relative to its mean over the
image, so that their weighted sum is the logarithm of a product of powers. "NAME around 8" is
computed from the map smoothed by 8 cells and describes the surroundings of a position. Geometry
(center, height, border) and faces enter without a logarithm.
"""

from collections.abc import Collection
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention._scanpath_model_kernels import fill_logits
from saccade.attention.channels import CONSPICUITY
from saccade.attention.combined import (
    CHANNELS,
    AttentionConfig,
    AttentionMaps,
    FaceDetector,
    attention_maps,
    channel_maps,
)
from saccade.attention.maps import SaliencyMaps
from saccade.errors import Settings, require
from saccade.io.image import check_image, in_unit_range, repeat_gray
from saccade.scale.pyramid import FloatMap, resize
from saccade.types import FloatArray, Image, IntArray

FLOOR = 0.1
"""Constant added to a map of mean 1 before the logarithm."""
SURROUNDINGS = (3, 8)
"""Standard deviations in cells of the smoothed maps."""
AROUND = " around "
"""Separator of the parts of a feature's name."""
GEOMETRY = ("center x", "center y", "height", "border", "edge")
"""Squared distance from the center along each axis, downward position and distance from the border,
as fractions of the sides, and closeness to the border."""
EDGE = 0.05
"""Decay length of the closeness to the border: it falls to 1 / e at this distance."""
FACES = "faces"
SKIN = ((15.0, 12.0), (18.0, 12.0))
"""Mean and standard deviation of a* and b* of skin in CIE L*a*b*."""
EARLY = ("attention", "attention around 3", "center x", "center y", "height", "border")
"""Features whose weight differs for the first fixations of a scanpath."""


def map_names(config: AttentionConfig) -> list[str]:
    """Names of the maps of a configuration."""
    names = ["attention", *CHANNELS, "boolean edges"]
    names += ["intensity", "color", "orientation", "color distance", "skin"]
    names += [f"symmetry {i}" for i in range(len(config.symmetry.levels))]
    for channel in CONSPICUITY:
        oriented = channel == "orientation"
        scales = config.contrast.orientation_scales if oriented else config.contrast.scales
        names += [f"{channel} {i}" for i in range(len(scales))]
    return names


def feature_names(config: AttentionConfig, *, faces: bool) -> list[str]:
    """Names of all features; those for faces only with a face detector."""
    maps = map_names(config)
    around = [f"{name}{AROUND}{cells}" for cells in SURROUNDINGS for name in maps]
    return [*maps, *around, *GEOMETRY, *([FACES] if faces else [])]


def feature_maps(
    image: Image,
    names: Collection[str],
    config: AttentionConfig | None = None,
    faces: FaceDetector | None = None,
) -> FloatArray:
    """The features of an image, in the order of their names.

    Args:
        image: as for `attention_saliency`.
        names: feature names, from `feature_names`.
        config: settings of the maps.
        faces: face detector, returning (n, 4) boxes; None for no faces.

    Returns:
        (k, h, w) features in the order of `names`, at the size of the attention map.

    Raises:
        ImageError: as `attention_saliency`.
    """
    maps = base_maps(image, config or AttentionConfig(), faces)
    shape = maps["attention"].shape
    fixed = geometry(shape) | {FACES: maps.pop(FACES)}

    def feature(name: str) -> FloatArray:
        if name in fixed:
            return fixed[name]
        source, _, cells = name.partition(AROUND)
        return relative_log(maps[source], float(cells or 0))

    return np.stack([feature(name) for name in names])


def base_maps(
    image: Image, config: AttentionConfig, faces: FaceDetector | None
) -> dict[str, FloatMap]:
    """Maps by name at the size of the attention map, for the scales that the image has."""
    pixels = check_image(image)
    found = attention_maps(pixels, config, keep_features=True, faces=faces)
    shape = found.saliency.shape
    channels = {
        name: channel_maps(name, pixels, config).saliency
        if getattr(config, row.weight) == 0
        else found.channels[name].saliency
        for name, row in CHANNELS.items()
    }
    boolean = channels["boolean"]
    distance, skin = color_maps(pixels, found.image_shape)
    maps = {
        "attention": found.saliency,
        **channels,
        "boolean edges": np.maximum(boolean - cv2.GaussianBlur(boolean, (0, 0), 6), 0),
        "intensity": found.contrast.intensity,
        "color": found.contrast.color,
        "orientation": found.contrast.orientation,
        "color distance": distance,
        "skin": skin,
        FACES: np.zeros(shape) if found.faces is None else found.faces,
    }
    maps = dict.fromkeys(map_names(config), np.zeros(shape)) | maps | scale_maps(found, config)
    return {name: resize(np.asarray(values, np.float64), shape) for name, values in maps.items()}


def scale_maps(maps: AttentionMaps, config: AttentionConfig) -> dict[str, FloatMap]:
    """Symmetry and contrast maps of each scale, numbered as in the configuration."""
    symmetry = config.symmetry.at_size(maps.image_shape)
    contrast = config.contrast.at_size(maps.image_shape)
    found: dict[str, FloatMap] = {
        f"symmetry {i}": maps.symmetry.levels[level]
        for i, level in enumerate(symmetry.levels)
        if level in maps.symmetry.levels
    }
    for each in maps.contrast.features:
        oriented = each.channel.name == "orientation"
        scales = contrast.orientation_scales if oriented else contrast.scales
        name = f"{each.channel.name} {list(scales).index((each.center, each.surround))}"
        found[name] = found.get(name, 0) + each.values  # sum over the angles
    return found


def color_maps(pixels: FloatMap, shape: tuple[int, int]) -> tuple[FloatMap, FloatMap]:
    """(h, w) distance from the mean color in CIE L*a*b*, and similarity to skin color.

    Args:
        pixels: validated image.
        shape: (H, W) of the image.
    """
    scale = min(1.0, 200 / max(shape))
    small = max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))
    rgb = repeat_gray(resize(in_unit_range(pixels), small))
    lab = cv2.cvtColor(np.ascontiguousarray(rgb, np.float32), cv2.COLOR_RGB2LAB)
    distance = np.sqrt(((lab - lab.mean((0, 1))) ** 2).sum(2))
    squared = sum(
        ((lab[:, :, i] - mean) / sigma) ** 2 for i, (mean, sigma) in enumerate(SKIN, start=1)
    )
    return distance, np.exp(-squared / 2)


def geometry(shape: tuple[int, ...]) -> dict[str, FloatArray]:
    """Features that depend only on the position, (h, w) each."""
    y, x = (
        axis.astype(np.float64)
        for axis in np.meshgrid(
            *((np.arange(side) + 0.5) / side - 0.5 for side in shape), indexing="ij"
        )
    )
    border = np.minimum(0.5 - abs(x), 0.5 - abs(y))
    return dict(zip(GEOMETRY, (x * x, y * y, y, border, np.exp(-border / EDGE)), strict=True))


def relative_log(values: FloatMap, cells: float) -> FloatArray:
    """Logarithm of a nonnegative map relative to its mean, after smoothing by `cells` cells."""
    if cells > 0:
        values = cv2.GaussianBlur(values, (0, 0), cells, borderType=cv2.BORDER_REFLECT)
    mean = float(values.mean())
    scaled = values / mean if mean > 0 else np.ones_like(values)
    return np.asarray(np.log(np.maximum(scaled, 0) + FLOOR), np.float64)


SCALES = (0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
"""Standard deviations of the Gaussians around an earlier fixation."""
MIN_DIRECTION_DISTANCES = (0.03, 0.1)
"""Minimum distances for a direction to count."""
LAGS = (1, 1, 1, 1, 1, 1, 1, 1, 2, 3, 4, 5, 6, 7, 8)
"""Number of fixations back from the next one, for each table."""
FUNCTIONS = 53
"""Their number."""


@dataclass(frozen=True, eq=False, repr=False)
class FittedMaps(SaliencyMaps):
    """Saliency of a fitted model: (h, w) float32, in proportion to the density of fixations.

    Its maximum is 1.
    """


@dataclass(frozen=True)
class FittedModel(Settings):
    """Log-linear model of fixation density: a weight for each feature of the image.

    The default is the attention map itself. `saccade.load_model` reads a file of `saccade fit`.
    """

    features: tuple[str, ...] = ("attention",)
    """Names of the features; see `saccade.attention.fitted`."""
    weights: tuple[float, ...] = (1.0,)
    """Weight of each feature."""
    fitted_to: str = ""
    """Description of the training data, for information only."""
    attention: AttentionConfig = field(default_factory=AttentionConfig)
    """Settings of the maps."""
    scanpath_weights: tuple[float, ...] = ()
    """Weights for `next_fixation_density`: for the features, for the features in `EARLY` divided by
    the fixation number, and for the functions of `saccade_tables`. Empty for a static model."""

    @property
    def _early(self) -> list[int]:
        return [i for i, name in enumerate(self.features) if name in EARLY]

    def __post_init__(self) -> None:
        super().__post_init__()
        known = {*map_names(self.attention), *GEOMETRY, FACES}
        for name in self.features:
            base, around, cells = str(name).partition(AROUND)
            holds = base in known and (not around or _is_size(cells))
            require(holds, "features", "names of features of its attention settings", name)
        matching = len(self.weights) == len(self.features) > 0
        expected = f"a finite number for each of the {len(self.features)} features"
        require(matching, "weights", expected, len(self.weights))
        count = len(self.features) + len(self._early) + FUNCTIONS
        found = len(self.scanpath_weights)
        require(found in (0, count), "scanpath_weights", f"{count} finite numbers, or none", found)

    def maps(self, image: Image, faces: FaceDetector | None = None) -> FittedMaps:
        """The saliency of an image.

        Args:
            image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
            faces: face detector, returning (n, 4) boxes, for a model with faces; None for no faces.

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
        """Probability that the next fixation falls in each cell of the map.

        Args:
            image: as for `maps`.
            xy: (n, 2) fixations so far in pixels, beginning with the start, usually the center.
            faces: as for `maps`.

        Returns:
            (h, w), with a sum of 1.

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
    """(T, 2 h - 1, 2 w - 1, m) functions by table and offset in cells, from the middle.

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
    radial += [np.log1p((r / MIN_DIRECTION_DISTANCES[0]) ** 2), r]
    away = [1 - np.exp(-((r / s) ** 2) / 2) for s in MIN_DIRECTION_DISTANCES]
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
    """Anchors and factors of the tables for the fixation after a path.

    Args:
        xy: (n, 2) fixations so far in pixels, at least one; the last is the current one.
        shape: (h, w) of the map.
        image_shape: (H, W) of the image.

    Returns:
        (T, 2) row and column of the fixation of each table, and (T,) its factor, which is 0 if the
        path has no such fixation.
    """
    n = len(xy)
    cells = np.floor((xy[:, ::-1] + 0.5) / image_shape * shape).astype(np.int64)
    anchors = cells.clip(0, np.array(shape) - 1)[[max(n - lag, 0) for lag in LAGS]]
    cos, sin, size = 0.0, 0.0, 0.0
    if n > 1:
        dx, dy = (xy[-1] - xy[-2]) / max(image_shape)
        amplitude = float(np.hypot(dx, dy))
        cos, sin = dx / (amplitude or 1.0), dy / (amplitude or 1.0)
        size = np.log(amplitude + MIN_DIRECTION_DISTANCES[0])
    of_last = [1.0, cos, sin, cos**2 - sin**2, 2 * cos * sin, size, 1 / n, float(n == 1)]
    return anchors, np.array([*of_last, *(float(n >= lag) for lag in LAGS[8:])])
