"""The settings of the contrast model, and the published models as presets of it."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from saccade.attention.channels import Color
from saccade.attention.normalize import Normalization
from saccade.errors import require, require_types
from saccade.scale.pyramid import MAX_LEVEL, coarser_levels

Scales = tuple[tuple[int, int], ...]

MapSize = Literal["center", "map"]
Arithmetic = Literal["mirrored", "kootstra2010", "saliencytoolbox2"]

CENTERS_2_TO_4: Scales = ((2, 5), (2, 6), (3, 6), (3, 7), (4, 7), (4, 8))
"""The six pairs of A.7-A.10."""

MAX_WEIGHT = 1e6
"""A larger weight would leave nothing of the others in single precision."""


@dataclass(frozen=True)
class ContrastConfig:
    """Channels, scales and normalization of the contrast model.

    The default predicts human fixations best; docs/contrast-default.md says how it was chosen.
    """

    intensity_weight: float = 1.0
    """Weight of intensity in the saliency; at 0 the channel is not computed and its map is 0."""
    color_weight: float = 1.0
    """The same for color."""
    orientation_weight: float = 0.2
    """The same for orientation."""
    color: Color = "linear"
    """Color opponents as differences of intensities ("linear"), or divided by the brightest color
    ("quotient"; A.2-A.3)."""
    dark: float = 0.1
    """Opponents are 0 where the brightest color is below this; for "quotient" only."""
    scales: Scales = ((1, 2), (1, 3), (4, 7))
    """Pyramid levels of center and surround for intensity and color; the image is level 0."""
    scale_weights: tuple[float, ...] = (1.0, 1.0, 0.5)
    """Weight of each of these pairs."""
    orientation_scales: Scales = ((2, 4),)
    """Center and surround levels for orientation, each of weight 1."""
    orientations: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    """Directions of bars in degrees, from x towards y."""
    gabor_period: float = 7.0
    """Wavelength of the oriented filters in pixels of their level."""
    gabor_sigma: float = 7 / 3
    """Standard deviation of their window, likewise."""
    gabor_size: int = 9
    """Their side, odd."""
    map_level: int = 4
    """Pyramid level whose size the conspicuity maps and the saliency have."""
    normalize_at: MapSize = "map"
    """Whether a feature map is normalized at the size of its "center" level and then resized, or
    at the size of the "map"."""
    smoothing: float = 1.5
    """Standard deviation in cells of the Gaussian that smooths a feature map before it is
    normalized at the size of the map, at most an eighth of the side."""
    normalization: Normalization = "local-maxima"
    """The operator N; see `saccade.attention.normalize`."""
    maxima_threshold: float = 0.1
    """Lower local maxima of a map in [0, 1] are ignored by its normalization."""
    maxima_radius: float | None = None
    """Radius of the neighborhood of a local maximum, as a fraction of the longer side of the map;
    None for the 8 neighbors.

    The sources do not say. Without smoothing and with 8 neighbors, the faint maxima between the
    items of a display lower the mean, and a display that should be suppressed is not."""
    iterations: int = 3
    """Of the iterative normalization."""
    sharpening: float = 1.5
    """Exponent of the saliency scaled to [0, 1]; 1 leaves it as in A.14."""
    center_prior: float | None = None
    """Standard deviation, as a fraction of each side, of a central Gaussian by which the saliency
    is multiplied; None for no prior."""
    viewing_size: int | None = 800
    """Longer side in pixels of an image for which the levels are meant. In an image of twice
    that size every level is one coarser, in one of half that size one finer, so that saliency does
    not depend on the size at which a photograph was saved; None takes the levels as they are."""
    arithmetic: Arithmetic = "mirrored"
    """Borders, sizes and ranges of the steps: "mirrored" reflects the image at its borders; the
    modules of `saccade.attention` describe "kootstra2010" and "saliencytoolbox2"."""

    @property
    def weights(self) -> tuple[float, float, float]:
        """Weights of intensity, color and orientation."""
        return self.intensity_weight, self.color_weight, self.orientation_weight

    def __post_init__(self) -> None:
        for name in ("intensity_weight", "color_weight", "orientation_weight"):
            weight = getattr(self, name)
            require(0 <= weight <= MAX_WEIGHT, name, f"a weight from 0 to {MAX_WEIGHT:g}", weight)
        require(sum(self.weights) > 0, "weights", "at least one above 0", self.weights)
        require_types(self)
        require(0 <= self.dark <= 1, "dark", "a value in [0, 1]", self.dark)
        for name in ("scales", "orientation_scales"):
            pairs = getattr(self, name)
            rising = all(len(pair) == 2 and 0 <= pair[0] < pair[1] <= MAX_LEVEL for pair in pairs)
            expected = f"pairs of a center level and a coarser surround level, 0 to {MAX_LEVEL}"
            require(len(pairs) > 0 and rising, name, expected, pairs)
        require(
            len(self.scale_weights) == len(self.scales)
            and all(0 < weight <= MAX_WEIGHT for weight in self.scale_weights),
            "scale_weights",
            f"a weight above 0, at most {MAX_WEIGHT:g}, for each of the {len(self.scales)} scales",
            self.scale_weights,
        )
        require(len(self.orientations) > 0, "orientations", "one or more angles", ())
        require(2 <= self.gabor_period <= 1000, "gabor_period", "2 to 1000 px", self.gabor_period)
        require(0.1 <= self.gabor_sigma <= 1000, "gabor_sigma", "0.1 to 1000 px", self.gabor_sigma)
        odd = 3 <= self.gabor_size < 100 and self.gabor_size % 2 == 1
        require(odd, "gabor_size", "an odd size from 3 to 99", self.gabor_size)
        require(0 <= self.map_level <= MAX_LEVEL, "map_level", f"0 to {MAX_LEVEL}", self.map_level)
        require(0 <= self.smoothing < np.inf, "smoothing", "0 cells or more", self.smoothing)
        at_map = self.normalize_at == "map"
        unsmoothed = 'none, unless normalize_at = "map"'
        require(self.smoothing == 0 or at_map, "smoothing", unsmoothed, self.smoothing)
        expected = '"map" for the arithmetic of saliencytoolbox2'
        possible = self.arithmetic != "saliencytoolbox2" or at_map
        require(possible, "normalize_at", expected, self.normalize_at)
        threshold, radius, prior = self.maxima_threshold, self.maxima_radius, self.center_prior
        require(0 <= threshold <= 1, "maxima_threshold", "a value in [0, 1]", threshold)
        require(radius is None or 0 < radius <= 1, "maxima_radius", "in (0, 1], or none", radius)
        require(1 <= self.iterations <= 1000, "iterations", "1 to 1000", self.iterations)
        require(0 < self.sharpening <= 100, "sharpening", "above 0, at most 100", self.sharpening)
        require(prior is None or 0 < prior < np.inf, "center_prior", "above 0, or none", prior)
        size = self.viewing_size
        require(size is None or size >= 1, "viewing_size", "1 px or more, or none", size)

    def at_size(self, shape: tuple[int, int]) -> Self:
        """The configuration with the levels for an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size is None:
            return self
        finest = min(level for pair in (*self.scales, *self.orientation_scales) for level in pair)
        coarser = coarser_levels(shape, self.viewing_size, finest, self.map_level)
        return replace(
            self,
            scales=_shifted(self.scales, coarser),
            orientation_scales=_shifted(self.orientation_scales, coarser),
            map_level=self.map_level + coarser,
            viewing_size=None,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): equations A.1-A.14 as printed.

        One correction: a map with a single local maximum keeps its weight. What the print leaves
        open is as in `saccade.textbook.contrast_saliency`. Differs from it where an image has no
        level 8, shorter than 129 px: pairs of levels that do not exist are left out, where the
        textbook continues with levels of a single sample.
        """
        return replace(
            cls.itti1998(),
            normalization="local-maxima",
            dark=0.0,
            maxima_radius=None,
            gabor_period=4.0,
            gabor_sigma=2.25,
            gabor_size=15,
            arithmetic="kootstra2010",
        )

    @classmethod
    def itti1998(cls) -> Self:
        """Itti, Koch & Niebur (1998): the mean of maxima excludes the global maximum.

        Oriented responses are magnitudes, and dark pixels have no color.
        """
        return cls(
            orientation_weight=1.0,
            color="quotient",
            scales=CENTERS_2_TO_4,
            scale_weights=len(CENTERS_2_TO_4) * (1.0,),
            orientation_scales=CENTERS_2_TO_4,
            map_level=4,
            normalize_at="center",
            smoothing=0.0,
            normalization="local-maxima-1998",
            maxima_radius=0.05,
            sharpening=1.0,
            viewing_size=None,
        )

    @classmethod
    def saliencytoolbox2(cls) -> Self:
        """The default of Walther & Koch's SaliencyToolbox 2, to the last digits."""
        return replace(
            cls.itti1998(),
            gabor_sigma=2.3333,
            normalize_at="map",
            normalization="iterative",
            arithmetic="saliencytoolbox2",
        )


def _shifted(scales: Scales, levels: int) -> Scales:
    return tuple((center + levels, surround + levels) for center, surround in scales)
