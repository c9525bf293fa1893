"""Settings of the contrast model, with presets for published models."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, Self

from saccade.attention.channels import Color
from saccade.attention.normalize import NORMALIZATIONS, Normalization, check_normalization
from saccade.errors import Settings, require, setting
from saccade.scale.pyramid import MAX_LEVEL, coarser_levels

Scales = tuple[tuple[int, int], ...]

MapSize = Literal["center", "map"]
Variant = Literal["mirrored", "kootstra2010", "saliencytoolbox2"]

CENTERS_2_TO_4: Scales = ((2, 5), (2, 6), (3, 6), (3, 7), (4, 7), (4, 8))
"""Six pairs of center and surround levels (A.7-A.10)."""

MAX_WEIGHT = 1e6
"""Maximum weight; a larger one would cancel the others in single precision."""


@dataclass(frozen=True)
class ContrastConfig(Settings):
    """Channels, scales and normalization of the contrast model.

    The default predicts human fixations best; docs/contrast-default.md describes how it was chosen.
    """

    intensity_weight: float = setting(1.0, 0, MAX_WEIGHT)
    """Weight of intensity in the saliency; with 0 the channel is not computed and its map is 0."""
    color_weight: float = setting(1.0, 0, MAX_WEIGHT)
    """Weight of color in the saliency; with 0 the channel is not computed and its map is 0."""
    orientation_weight: float = setting(0.2, 0, MAX_WEIGHT)
    """Weight of orientation in the saliency; with 0 it is not computed and its map is 0."""
    color: Color = "linear"
    """Color opponency: differences of intensities ("linear"), or differences divided by the
    brightest color ("quotient"; A.2-A.3)."""
    dark: float = setting(0.1, 0, 1)
    """Minimum value of the brightest color, for "quotient" only; in darker pixels the opponency is
    0."""
    scales: Scales = ((1, 2), (1, 3), (4, 7))
    """Center and surround levels for intensity and color; the image is level 0."""
    scale_weights: tuple[float, ...] = (1.0, 1.0, 0.5)
    """Weight of each pair of `scales`."""
    orientation_scales: Scales = ((2, 4),)
    """Center and surround levels for orientation, each with weight 1."""
    orientations: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    """Directions of bars in degrees, from x towards y."""
    gabor_period: float = setting(7.0, 2, 1000)
    """Wavelength of the Gabor filters, in pixels of the pyramid level."""
    gabor_sigma: float = setting(7 / 3, 0.1, 1000)
    """Standard deviation of the Gabor filters' Gaussian window, in pixels of the pyramid level."""
    gabor_size: int = setting(9, 3, 99)
    """Side of the Gabor filters, odd, in pixels of the pyramid level."""
    map_level: int = setting(4, 0, MAX_LEVEL)
    """Pyramid level that sets the size of the conspicuity maps and the saliency."""
    normalize_at: MapSize = "map"
    """Size of the feature maps during normalization: the size of the "center" level, before
    resizing, or the size of the "map"."""
    smoothing: float = setting(1.5, 0)
    """Standard deviation, in cells, of the Gaussian applied to a feature map before it is
    normalized at the size of the map; at most an eighth of the side."""
    normalization: Normalization = setting("local-maxima", choices=NORMALIZATIONS)
    """The operator N: a name of `saccade.attention.normalize.NORMALIZATIONS` that the variant
    supports, a function such as those in its rows, or module:function."""
    maxima_threshold: float = setting(0.1, 0, 1)
    """Minimum height of the local maxima that the normalization counts, in a map scaled to [0,
    1]."""
    maxima_radius: float | None = setting(None, above=0, maximum=1)
    """Radius of the neighborhood of a local maximum, as a fraction of the longer side of the map;
    None for the 8 neighbors.

    The sources leave the radius open. Without smoothing and with 8 neighbors, faint maxima between
    the items of a display lower the mean, and a uniform display is not suppressed."""
    iterations: int = setting(3, 1, 1000)
    """Number of iterations of the iterative normalization."""
    sharpening: float = setting(1.5, above=0, maximum=100)
    """Exponent applied to the saliency scaled to [0, 1]; 1 gives A.14."""
    viewing_size: int | None = setting(800, 1)
    """Reference length in pixels of the longer side of an image. Doubling the image size makes
    every level one coarser and halving it one finer, so that saliency does not depend on the
    resolution of a photograph; None uses the levels unchanged."""
    variant: Variant = "mirrored"
    """Borders, sizes and ranges of the steps: "mirrored" reflects the image at its borders;
    `saccade.attention.contrast_steps` describes "kootstra2010",
    `saccade.attention.saliencytoolbox2` the third."""

    @property
    def weights(self) -> tuple[float, float, float]:
        """Weights of intensity, color and orientation."""
        return self.intensity_weight, self.color_weight, self.orientation_weight

    def __post_init__(self) -> None:
        super().__post_init__()
        require(sum(self.weights) > 0, "weights", "at least one above 0", self.weights)
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
        require(self.gabor_size % 2 == 1, "gabor_size", "an odd size", self.gabor_size)
        at_map = self.normalize_at == "map"
        unsmoothed = 'none, unless normalize_at = "map"'
        require(self.smoothing == 0 or at_map, "smoothing", unsmoothed, self.smoothing)
        expected = '"map" for the variant saliencytoolbox2'
        possible = self.variant != "saliencytoolbox2" or at_map
        require(possible, "normalize_at", expected, self.normalize_at)
        check_normalization(self.normalization, self.variant)

    def at_size(self, shape: tuple[int, int]) -> "ContrastConfig":
        """Returns the configuration with its levels adapted to an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size is None:
            return self
        finest = min(level for pair in (*self.scales, *self.orientation_scales) for level in pair)
        coarser = coarser_levels(shape, self.viewing_size, finest, self.map_level)
        return _coarser(self, coarser)

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): equations A.1-A.14 as published.

        One correction: a map with a single local maximum keeps its weight. Details that the source
            leaves open follow `saccade.textbook.contrast_saliency`. The two differ for images below
            129 px, which have no level 8: missing pairs of levels are skipped here, while the
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
            variant="kootstra2010",
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
        """The default of Walther & Koch's SaliencyToolbox 2, reproduced to the last digits."""
        return replace(
            cls.itti1998(),
            gabor_sigma=2.3333,
            normalize_at="map",
            normalization="iterative",
            variant="saliencytoolbox2",
        )


DEFAULT = ContrastConfig()
"""The default settings, validated once."""


@lru_cache(maxsize=64)
def _coarser(config: ContrastConfig, levels: int) -> ContrastConfig:
    """The configuration with coarser levels, cached since validation takes a third of a ms."""
    return replace(
        config,
        scales=_shifted(config.scales, levels),
        orientation_scales=_shifted(config.orientation_scales, levels),
        map_level=config.map_level + levels,
        viewing_size=None,
    )


def _shifted(scales: Scales, levels: int) -> Scales:
    return tuple((center + levels, surround + levels) for center, surround in scales)
