"""The settings of symmetry saliency, and the source's as a preset."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Self, get_args

import numpy as np

from saccade.errors import require
from saccade.pyramid import DEEPEST

Kind = Literal["isotropic", "radial", "color"]
Channels = Literal["opponent", "rgb", "gray"]
Border = Literal["average", "missing"]
Arithmetic = Literal["mirrored", "kootstra2010"]


@dataclass(frozen=True)
class SymmetryConfig:
    """Kind, scales and kernel of the symmetry transform.

    The default is what predicts the fixations of people best; how it was chosen stands in
    docs/symmetry.md.
    """

    kind: Kind = "radial"
    """What the pairs add up to: "isotropic" counts every pair, "radial" (Reisfeld, Wolfson &
    Yeshurun 1995) those least whose axis is that of the strongest, "color" (Heidemann 2004)
    every pair of gradients from any two channels, a light side facing a dark one too."""
    channels: Channels = "opponent"
    """Where gradients are taken: in intensity and the two color opponents, in red, green and
    blue, or in the intensity of a grey image."""
    levels: tuple[int, ...] = (1, 2, 3, 4, 5)
    """Pyramid levels; the image is level 0."""
    level_weights: tuple[float, ...] = (3.0, 2.0, 1.0, 1.0, 1.0)
    """How much each of these counts."""
    inner: int = 1
    """The least distance of a pair from its middle, along x or y, in pixels of its level."""
    outer: int = 4
    """The largest, likewise."""
    sigma: float = 4.0
    """Of the normal density that weighs a pair by the distance between the two, likewise."""
    gain: float = 60.0
    """How soon a gradient is strong: its strength is log(1 + gain m), with the magnitude m that
    Sobel's filters give, 4 for an edge between black and white."""
    border: Border = "average"
    """What pairs count that would reach beyond the image: as much as those inside do on average
    over the level, or, as "missing", nothing. Then nothing at a border is symmetric, and the map
    has a prior for the center."""
    map_level: int = 4
    """Pyramid level whose size the saliency has."""
    smoothing: float = 0.75
    """Standard deviation in cells of the Gaussian that smooths the sum over the levels."""
    sharpening: float = 2.0
    """Exponent of the saliency, scaled to [0, 1] before."""
    viewing_size: int = 800
    """Longer side in pixels of an image for which the levels are meant. In an image of twice
    that every level is one coarser, in one of half that one finer; 0 takes them as they are."""
    arithmetic: Arithmetic = "mirrored"
    """How levels are made: "mirrored" reflects the image at its borders, "kootstra2010" does as
    `saccade.attention.symmetry_2010` describes."""

    def __post_init__(self) -> None:
        for name, choices in (
            ("kind", get_args(Kind)),
            ("channels", get_args(Channels)),
            ("border", get_args(Border)),
            ("arithmetic", get_args(Arithmetic)),
        ):
            choice = getattr(self, name)
            require(choice in choices, name, f"one of {', '.join(choices)}", choice)
        inside = all(0 <= level <= DEEPEST for level in self.levels)
        rising = all(finer < coarser for finer, coarser in pairwise(self.levels))
        expected = f"rising levels from 0 to {DEEPEST}"
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
        require(0 <= self.map_level <= DEEPEST, "map_level", f"0 to {DEEPEST}", self.map_level)
        require(0 <= self.smoothing < np.inf, "smoothing", "0 cells or more", self.smoothing)
        require(0 < self.sharpening <= 100, "sharpening", "above 0, at most 100", self.sharpening)
        require(self.viewing_size >= 0, "viewing_size", "0 px or more", self.viewing_size)
        source = self.arithmetic == "kootstra2010"
        require(
            not source or self.channels == "gray",
            "channels",
            '"gray" for the arithmetic of kootstra2010',
            self.channels,
        )

    def at_size(self, shape: tuple[int, int]) -> Self:
        """The settings with the levels that they mean in an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size == 0:
            return self
        coarser = round(np.log2(max(shape) / self.viewing_size))
        coarser = max(coarser, -self.levels[0], 1 - self.map_level)
        return replace(
            self,
            levels=tuple(level + coarser for level in self.levels),
            map_level=self.map_level + coarser,
            viewing_size=0,
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """The authors' release of 2010, in grey at levels 3 to 5; the map has the first's size.

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
            viewing_size=0,
            arithmetic="kootstra2010",
        )
