"""The contrast-saliency model: what differs from its surround draws the eye.

After Itti, Koch & Niebur (1998) and Itti & Koch (2001); equations A.1-A.14.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from saccade.attention import channels
from saccade.attention.normalize import NORMALIZATIONS, Normalization, normalize
from saccade.errors import ImageError, require
from saccade.image import as_rgb
from saccade.pyramid import (
    FloatMap,
    deepest_level,
    dyadic_pyramid,
    gabor_pair,
    gabor_response,
    level_shape,
    resize,
)
from saccade.types import Image


@dataclass(frozen=True)
class ContrastConfig:
    """Channels, scales and normalization of the contrast model.

    The default is `itti1998`: it leaves the highest maximum out of the mean, so that a lone
    maximum needs no special case.
    """

    intensity_weight: float = 1.0
    """Part of intensity in the saliency; 0 leaves the channel out, its map is then 0."""
    color_weight: float = 1.0
    """The same for color."""
    orientation_weight: float = 1.0
    """The same for orientation."""
    dark: float = 0.1
    """Where no color reaches this, there is no hue."""
    center_levels: tuple[int, ...] = (2, 3, 4)
    """Pyramid levels of the center; the image is level 0."""
    surround_deltas: tuple[int, ...] = (3, 4)
    """How many levels coarser the surround is."""
    orientations: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    """Directions of bars in degrees, from x towards y."""
    gabor_period: float = 7.0
    """Wavelength of the oriented filters in pixels of their level."""
    gabor_sigma: float = 7 / 3
    """Standard deviation of their window, likewise."""
    gabor_size: int = 9
    """Their side, odd."""
    normalization: Normalization = "local-maxima-1998"
    """How a map with few strong places is promoted; see `saccade.attention.normalize`."""
    maxima_threshold: float = 0.1
    """Lower local maxima of a map in [0, 1] do not count in its normalization."""
    maxima_radius: float = 0.05
    """How far around itself a local maximum is the highest, as part of the map's longer side.

    The sources do not say. With the nearest neighbors only, the faint maxima between the items
    of a display pull the mean down, and a display that should be suppressed is not."""
    iterations: int = 3
    """Of the iterative normalization."""
    map_level: int = 4
    """Pyramid level whose size the conspicuity maps and the saliency have."""

    def __post_init__(self) -> None:
        for name in ("intensity_weight", "color_weight", "orientation_weight"):
            weight = getattr(self, name)
            require(0 <= weight < np.inf, name, "a finite weight of at least 0", weight)
        total = self.intensity_weight + self.color_weight + self.orientation_weight
        require(total > 0, "weights", "at least one above 0", total)
        require(0 <= self.dark <= 1, "dark", "a value in [0, 1]", self.dark)
        require(
            len(self.center_levels) > 0 and min(self.center_levels) >= 0,
            "center_levels",
            "one or more levels of at least 0",
            self.center_levels,
        )
        require(
            len(self.surround_deltas) > 0 and min(self.surround_deltas) >= 1,
            "surround_deltas",
            "one or more differences of at least 1",
            self.surround_deltas,
        )
        require(len(self.orientations) > 0, "orientations", "one or more angles", ())
        require(self.gabor_period >= 2, "gabor_period", "2 px or more", self.gabor_period)
        require(self.gabor_sigma > 0, "gabor_sigma", "a positive width", self.gabor_sigma)
        require(
            self.gabor_size >= 3 and self.gabor_size % 2 == 1,
            "gabor_size",
            "an odd size of 3 or more",
            self.gabor_size,
        )
        require(
            self.normalization in NORMALIZATIONS,
            "normalization",
            f"one of {', '.join(NORMALIZATIONS)}",
            self.normalization,
        )
        require(
            0 <= self.maxima_threshold <= 1,
            "maxima_threshold",
            "a value in [0, 1]",
            self.maxima_threshold,
        )
        require(
            0 < self.maxima_radius <= 1, "maxima_radius", "a part in (0, 1]", self.maxima_radius
        )
        require(self.iterations >= 1, "iterations", "1 or more", self.iterations)
        require(self.map_level >= 0, "map_level", "0 or more", self.map_level)

    @classmethod
    def kootstra2010(cls) -> Self:
        """Equations A.1-A.14 to the letter; a map with a single maximum keeps its weight."""
        return cls(normalization="local-maxima")

    @classmethod
    def itti1998(cls) -> Self:
        """The same with the global maximum left out of m, as Itti, Koch & Niebur (1998) do."""
        return cls(normalization="local-maxima-1998")


class FeatureMap(NamedTuple):
    """One of the maps that the conspicuity maps are made of, before its normalization."""

    channel: str
    """"intensity", "red-green", "blue-yellow", or "orientation" and its angle in degrees."""
    center: int
    """Pyramid level of the center, whose size the map has."""
    surround: int
    """Pyramid level of the surround."""
    values: FloatMap
    """(h, w) absolute difference of center and surround."""


@dataclass(frozen=True, eq=False, repr=False)
class ContrastMaps:
    """Saliency and what it is made of.

    Maps are float32, and their cells tile the image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) in [0, 1] for the normalizations by local maxima (A.14)."""
    intensity: FloatMap
    """(h, w) conspicuity, not negative (A.11)."""
    color: FloatMap
    """(h, w) conspicuity, not negative (A.12); 0 for a grey image."""
    orientation: FloatMap
    """(h, w) conspicuity, not negative (A.13)."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""
    features: tuple[FeatureMap, ...] = ()
    """The feature maps (A.7-A.10), where they were asked for."""

    def __repr__(self) -> str:
        height, width = self.saliency.shape
        rows, columns = self.image_shape
        return f"ContrastMaps({width} x {height} cells of a {columns} x {rows} image)"


def contrast_saliency(
    image: Image, config: ContrastConfig | None = None, *, keep_features: bool = False
) -> ContrastMaps:
    """Where contrast in intensity, color and orientation draws the eye.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: channels, scales and normalization; presets name their source.
        keep_features: whether the result holds the feature maps.

    Returns:
        Saliency and the three conspicuity maps, each (h, w), h = H / 2**config.map_level
        rounded up.

    Raises:
        ImageError: not an image, not finite, or too small for the finest surround.

    Source: Itti, Koch & Niebur (1998); equations A.1-A.14.
    """
    config = config or ContrastConfig()
    rgb = as_rgb(image)  # (H, W, 3)
    scales = existing_scales(rgb.shape[:2], config)
    pyramids = channel_pyramids(rgb, scales, config)  # A.1-A.6
    features = [
        FeatureMap(channel, center, surround, contrast(levels[center], levels[surround]))
        for channel, levels in pyramids.items()
        for center, surround in scales
    ]  # A.7-A.10

    N = partial(
        normalize,
        method=config.normalization,
        threshold=config.maxima_threshold,
        radius=config.maxima_radius,
        iterations=config.iterations,
    )
    nothing = np.zeros(level_shape(rgb.shape[:2], config.map_level), rgb.dtype)  # (h, w)
    across_scales = dict.fromkeys(("intensity", "red-green", "blue-yellow", *pyramids), nothing)
    for channel, _, _, values in features:
        across_scales[channel] = across_scales[channel] + resize(N(values), nothing.shape)
    oriented = [name for name in pyramids if name.startswith("orientation")]

    intensity = across_scales["intensity"]  # A.11
    color = N(across_scales["red-green"]) + N(across_scales["blue-yellow"])  # A.12
    orientation = sum((N(across_scales[name]) for name in oriented), start=nothing)  # A.13
    w_I, w_C, w_O = config.intensity_weight, config.color_weight, config.orientation_weight
    weighted = w_I * N(intensity) + w_C * N(color) + w_O * N(orientation)
    return ContrastMaps(
        saliency=weighted / (w_I + w_C + w_O),  # A.14
        intensity=intensity,
        color=color,
        orientation=orientation,
        image_shape=rgb.shape[:2],
        features=tuple(features) if keep_features else (),
    )


def existing_scales(shape: tuple[int, int], config: ContrastConfig) -> list[tuple[int, int]]:
    """The pairs of center and surround level that an image of this shape has (A.7-A.10)."""
    deepest = deepest_level(shape)
    scales = [(c, c + d) for c in config.center_levels for d in config.surround_deltas]
    existing = [(center, surround) for center, surround in scales if surround <= deepest]
    if not existing:
        finest = min(surround for _, surround in scales)
        raise ImageError(
            f"image: expected at least {2 ** (finest - 1) + 1} px on the shorter side, "
            f"which surround level {finest} needs, found {shape[1]} x {shape[0]} px; "
            "enlarge it, or set finer center_levels"
        )
    return existing


def channel_pyramids(
    rgb: FloatMap, scales: list[tuple[int, int]], config: ContrastConfig
) -> dict[str, dict[int, FloatMap]]:
    """The levels that the scales need, by channel and level number (A.1-A.6)."""
    needed = sorted({level for scale in scales for level in scale})

    def levels_of(channel: FloatMap) -> dict[int, FloatMap]:
        pyramid = dyadic_pyramid(channel, needed[-1])
        return {level: pyramid[level] for level in needed}

    pyramids = {}
    if config.intensity_weight > 0 or config.orientation_weight > 0:
        brightness = levels_of(channels.intensity(rgb))  # A.1, A.4
    if config.intensity_weight > 0:
        pyramids["intensity"] = brightness
    if config.color_weight > 0:
        red_green, blue_yellow = channels.opponency(rgb, config.dark)  # A.2, A.3
        pyramids["red-green"] = levels_of(red_green)  # A.5
        pyramids["blue-yellow"] = levels_of(blue_yellow)
    if config.orientation_weight > 0:
        for angle in config.orientations:
            pair = gabor_pair(
                np.deg2rad(angle), config.gabor_period, config.gabor_sigma, config.gabor_size
            )
            pyramids[f"orientation {angle:g}"] = {
                level: gabor_response(values, pair) for level, values in brightness.items()
            }  # A.6
    return pyramids


def contrast(center: FloatMap, surround: FloatMap) -> FloatMap:
    """How far the center is from its surround, at the size of the center (A.7-A.10)."""
    difference: FloatMap = np.abs(center - resize(surround, center.shape))
    return difference
