"""The settings of symmetry saliency, and the published model as a preset."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Self

import numpy as np

from saccade.errors import require, require_types
from saccade.scale.pyramid import MAX_LEVEL, coarser_levels

Kind = Literal["isotropic", "radial", "color"]
Channels = Literal["whitened", "opponent", "rgb", "gray"]
Border = Literal["average", "missing"]
Arithmetic = Literal["mirrored", "kootstra2010"]


@dataclass(frozen=True)
class SymmetryConfig:
    """Kind, scales and kernel of the symmetry transform.

    The default predicts human fixations best; docs/symmetry.md says how it was chosen.
    """

    kind: Kind = "radial"
    """Phase weight: "isotropic" weighs all axes alike, "radial" (Reisfeld, Wolfson & Yeshurun
    1995) those least that are parallel to the strongest, "color" (Heidemann 2004) pairs gradients
    of any two channels, and also those of opposite contrast."""
    channels: Channels = "whitened"
    """Channels of the gradients: three decorrelated color channels of unit variance; intensity
    and the two color opponents; red, green and blue; or the intensity of a gray image."""
    levels: tuple[int, ...] = (1, 2, 3, 4, 5)
    """Pyramid levels; the image is level 0."""
    level_weights: tuple[float, ...] = (3.0, 2.0, 1.0, 1.0, 1.0)
    """Weight of each of these levels."""
    inner: int = 1
    """Smallest distance of a pair from its center, along x or y, in pixels of its level."""
    outer: int = 4
    """Largest distance, likewise."""
    sigma: float = 4.0
    """Standard deviation of the normal density of the distance between the two, likewise."""
    gain: float = 18.0
    """Gain of the strength log(1 + gain m) of a gradient, with the magnitude m of Sobel's filters,
    which is 4 for an edge between black and white."""
    border: Border = "average"
    """What counts for pairs that reach beyond the image: the average of the level, or, with
    "missing", nothing, so that the map has a center bias."""
    map_level: int = 4
    """Pyramid level whose size the saliency has."""
    smoothing: float = 0.75
    """Standard deviation in cells of the Gaussian that smooths the sum over the levels."""
    sharpening: float = 2.0
    """Exponent of the saliency scaled to [0, 1]."""
    viewing_size: int | None = 800
    """Longer side in pixels of an image for which the levels are meant. In an image of twice that
    size every level is one coarser, in one of half that size one finer; None takes the levels as
    they are."""
    arithmetic: Arithmetic = "mirrored"
    """How levels are computed: "mirrored" reflects the image at its borders;
    `saccade.attention.symmetry_2010` describes "kootstra2010"."""

    def __post_init__(self) -> None:
        require_types(self)
        inside = all(0 <= level <= MAX_LEVEL for level in self.levels)
        rising = all(finer < coarser for finer, coarser in pairwise(self.levels))
        expected = f"rising levels from 0 to {MAX_LEVEL}"
        require(len(self.levels) > 0 and inside and rising, "levels", expected, self.levels)
        require(
            len(self.level_weights) == len(self.levels)
            and all(0 < weight < np.inf for weight in self.level_weights),
            "level_weights",
            f"a finite weight above 0 for each of the {len(self.levels)} levels",
            self.level_weights,
        )
        require(1 <= self.outer <= 100, "outer", "1 to 100 px", self.outer)
        require(1 <= self.inner <= self.outer, "inner", f"1 px to {self.outer}", self.inner)
        require(0.1 <= self.sigma < np.inf, "sigma", "0.1 px or more", self.sigma)
        require(0 < self.gain <= 1e6, "gain", "above 0, at most 1e6", self.gain)
        require(0 <= self.map_level <= MAX_LEVEL, "map_level", f"0 to {MAX_LEVEL}", self.map_level)
        require(0 <= self.smoothing < np.inf, "smoothing", "0 cells or more", self.smoothing)
        require(0 < self.sharpening <= 100, "sharpening", "above 0, at most 100", self.sharpening)
        size = self.viewing_size
        require(size is None or size >= 1, "viewing_size", "1 px or more, or none", size)
        expected = '"gray" for the arithmetic of kootstra2010'
        possible = self.arithmetic != "kootstra2010" or self.channels == "gray"
        require(possible, "channels", expected, self.channels)

    def at_size(self, shape: tuple[int, int]) -> Self:
        """The configuration with the levels for an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size is None:
            return self
        coarser = coarser_levels(shape, self.viewing_size, self.levels[0], self.map_level)
        return replace(
            self,
            levels=tuple(level + coarser for level in self.levels),
            map_level=self.map_level + coarser,
            viewing_size=None,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """The authors' release of 2010, in gray at levels 3 to 5; the map has the size of level 3.

        With `kind="radial"` it is their radial symmetry. For other levels set `map_level` too.
        """
        return cls(
            kind="isotropic",
            channels="gray",
            levels=(3, 4, 5),
            level_weights=(1.0, 1.0, 1.0),
            inner=3,
            outer=7,
            sigma=16.0,
            gain=1.0,
            border="missing",
            map_level=3,
            smoothing=0.0,
            sharpening=1.0,
            viewing_size=None,
            arithmetic="kootstra2010",
        )
