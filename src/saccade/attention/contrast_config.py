"""The settings of the contrast model, and the published models as presets of it."""

from dataclasses import dataclass, replace
from typing import Literal, Self, get_args

import numpy as np

from saccade.attention.channels import COLORS, Color
from saccade.attention.normalize import NORMALIZATIONS, Normalization
from saccade.errors import require
from saccade.pyramid import DEEPEST

Scales = tuple[tuple[int, int], ...]

Place = Literal["center", "map"]
Arithmetic = Literal["mirrored", "kootstra2010", "saliencytoolbox2"]

CENTERS_2_TO_4: Scales = ((2, 5), (2, 6), (3, 6), (3, 7), (4, 7), (4, 8))
"""The six pairs of A.7-A.10."""

HEAVIEST = 1e6
"""Weight beyond which single precision loses what weighs less."""


@dataclass(frozen=True)
class ContrastConfig:
    """Channels, scales and normalization of the contrast model.

    The default is what predicts the fixations of people best; how it was chosen stands in
    docs/contrast-default.md.
    """

    intensity_weight: float = 1.0
    """Part of intensity in the saliency; 0 leaves the channel out, its map is then 0."""
    color_weight: float = 1.0
    """The same for color."""
    orientation_weight: float = 0.2
    """The same for orientation."""
    color: Color = "linear"
    """Opponents as differences of lights, or as "quotient" by the brightest color (A.2-A.3)."""
    dark: float = 0.1
    """Where no color reaches this there is no hue; for "quotient" only."""
    scales: Scales = ((1, 2), (1, 3), (4, 7))
    """Pyramid levels of center and surround for intensity and color; the image is level 0."""
    scale_weights: tuple[float, ...] = (1.0, 1.0, 0.5)
    """How much each of these pairs counts."""
    orientation_scales: Scales = ((2, 4),)
    """The same pairs for orientation; each counts 1."""
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
    normalize_at: Place = "map"
    """Whether a feature map is normalized at the size of its "center", and resized afterwards,
    or when it has the size of the "map"."""
    smoothing: float = 1.5
    """Standard deviation in cells of the Gaussian that smooths a feature map before it is
    normalized at the size of the map, at most an eighth of the side; 0 smooths nothing."""
    normalization: Normalization = "local-maxima"
    """How a map with few strong places is promoted; see `saccade.attention.normalize`."""
    maxima_threshold: float = 0.1
    """Lower local maxima of a map in [0, 1] do not count in its normalization."""
    maxima_radius: float = 0.0
    """How far around itself a local maximum is the highest, as part of the map's longer side,
    but at least among its neighbors.

    The sources do not say. Where nothing is smoothed and the neighbors alone count, the faint
    maxima between the items of a display pull the mean down, and a display that should be
    suppressed is not."""
    iterations: int = 3
    """Of the iterative normalization."""
    sharpening: float = 1.5
    """Exponent of the saliency, scaled to [0, 1] before; with 1 it stays as A.14 gives it."""
    center_prior: float = 0.0
    """Standard deviation, by the image's sides, of a fixed Gaussian in the middle of the image
    by which the saliency is multiplied: it knows nothing of the image, only that photographers
    point at what matters. 0 leaves it out."""
    viewing_size: int = 800
    """Longer side in pixels of an image for which the levels are meant. In an image of twice
    that every level is one coarser, in one of half that one finer, so that the size at which
    a photograph was saved does not decide what draws the eye; 0 takes the levels as they are."""
    arithmetic: Arithmetic = "mirrored"
    """How the steps treat borders, sizes and ranges: "mirrored" reflects the image at its
    borders, "kootstra2010" and "saliencytoolbox2" do as the modules of these names in
    `saccade.attention` describe."""

    def __post_init__(self) -> None:
        for name in ("intensity_weight", "color_weight", "orientation_weight"):
            weight = getattr(self, name)
            require(0 <= weight <= HEAVIEST, name, f"a weight from 0 to {HEAVIEST:g}", weight)
        total = self.intensity_weight + self.color_weight + self.orientation_weight
        require(total > 0, "weights", "at least one above 0", total)
        for name, choices in (
            ("color", COLORS),
            ("normalize_at", get_args(Place)),
            ("normalization", NORMALIZATIONS),
            ("arithmetic", get_args(Arithmetic)),
        ):
            choice = getattr(self, name)
            require(choice in choices, name, f"one of {', '.join(choices)}", choice)
        require(0 <= self.dark <= 1, "dark", "a value in [0, 1]", self.dark)
        for name in ("scales", "orientation_scales"):
            pairs = getattr(self, name)
            rising = all(len(pair) == 2 and 0 <= pair[0] < pair[1] <= DEEPEST for pair in pairs)
            expected = f"pairs of a center level and a coarser surround level, from 0 to {DEEPEST}"
            require(len(pairs) > 0 and rising, name, expected, pairs)
        require(
            len(self.scale_weights) == len(self.scales)
            and all(0 < weight <= HEAVIEST for weight in self.scale_weights),
            "scale_weights",
            f"a weight above 0, at most {HEAVIEST:g}, for each of the {len(self.scales)} scales",
            self.scale_weights,
        )
        require(len(self.orientations) > 0, "orientations", "one or more angles", ())
        require(2 <= self.gabor_period <= 1000, "gabor_period", "2 to 1000 px", self.gabor_period)
        require(0.1 <= self.gabor_sigma <= 1000, "gabor_sigma", "0.1 to 1000 px", self.gabor_sigma)
        odd = 3 <= self.gabor_size < 100 and self.gabor_size % 2 == 1
        require(odd, "gabor_size", "an odd size from 3 to 99", self.gabor_size)
        require(0 <= self.map_level <= DEEPEST, "map_level", f"0 to {DEEPEST}", self.map_level)
        require(0 <= self.smoothing < np.inf, "smoothing", "0 cells or more", self.smoothing)
        require(
            self.smoothing == 0 or self.normalize_at == "map",
            "smoothing",
            'none, unless normalize_at = "map"',
            self.smoothing,
        )
        exact = self.arithmetic != "saliencytoolbox2" or self.normalize_at == "map"
        require(
            exact, "normalize_at", '"map" for the arithmetic of saliencytoolbox2', self.normalize_at
        )
        threshold = self.maxima_threshold
        require(0 <= threshold <= 1, "maxima_threshold", "a value in [0, 1]", threshold)
        require(0 <= self.maxima_radius <= 1, "maxima_radius", "in [0, 1]", self.maxima_radius)
        require(1 <= self.iterations <= 1000, "iterations", "1 to 1000", self.iterations)
        require(0 < self.sharpening <= 100, "sharpening", "above 0, at most 100", self.sharpening)
        require(0 <= self.center_prior < np.inf, "center_prior", "0 or more", self.center_prior)
        require(self.viewing_size >= 0, "viewing_size", "0 px or more", self.viewing_size)

    def at_size(self, shape: tuple[int, int]) -> Self:
        """The settings with the levels that they mean in an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size == 0:
            return self
        finest = min(level for pair in (*self.scales, *self.orientation_scales) for level in pair)
        coarser = round(np.log2(max(shape) / self.viewing_size))
        coarser = max(coarser, -finest, 1 - self.map_level)
        return replace(
            self,
            scales=_coarser(self.scales, coarser),
            orientation_scales=_coarser(self.orientation_scales, coarser),
            map_level=self.map_level + coarser,
            viewing_size=0,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): equations A.1-A.14 as printed.

        Mended is one thing: a map with a single local maximum keeps its weight.
        What the print leaves open is as in `saccade.textbook.contrast_saliency`. Differs from it
        where an image has no level 8, shorter than 129 px: pairs of levels that do not exist are
        left out, where the textbook goes on with levels of a single sample.
        """
        return replace(
            cls.itti1998(),
            normalization="local-maxima",
            dark=0.0,
            maxima_radius=0.0,
            gabor_period=4.0,
            gabor_sigma=2.25,
            gabor_size=15,
            arithmetic="kootstra2010",
        )

    @classmethod
    def itti1998(cls) -> Self:
        """Itti, Koch & Niebur (1998): the global maximum is left out of the mean of maxima.

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
            viewing_size=0,
        )

    @classmethod
    def saliencytoolbox2(cls) -> Self:
        """What Walther & Koch's SaliencyToolbox 2 computes by default, to the last digits."""
        return replace(
            cls.itti1998(),
            gabor_sigma=2.3333,
            normalize_at="map",
            normalization="iterative",
            arithmetic="saliencytoolbox2",
        )


def _coarser(scales: Scales, levels: int) -> Scales:
    return tuple((center + levels, surround + levels) for center, surround in scales)
