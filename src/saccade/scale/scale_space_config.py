"""The settings of a Gaussian scale space."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from saccade.errors import Settings, require, setting
from saccade.types import FloatArray, IntArray

Grid: TypeAlias = Literal["centered", "shifted", "published"]
Level = TypeVar("Level", float, FloatArray)


@dataclass(frozen=True)
class ScaleSpaceConfig(Settings):
    """Octaves, intervals and sampling of a Gaussian scale space; the default is `Sift`'s."""

    first_octave: int = setting(-1, -1, 0)
    """First octave: -1 has the scales of a doubled image; 0 those of the image, which are a quarter
    of the keypoints."""
    octaves: int | None = setting(None, 1)
    """Maximum number of octaves; None for as many as the image has room for."""
    intervals: int = setting(3, 1, 16)
    """Intervals per octave, s."""
    extra_intervals: int = setting(2, 0, 16)
    """Additional intervals in the first octave. The later octaves begin at a wider blur and so
    have denser samples: an octave that is halved as early as `density` 0.5 halves it is aliased,
    and its keypoints are off by a fifth of a pixel under rotation or scaling."""
    base_sigma: float = setting(1.8, 0.5, 8)
    """Blur of the first plane of the first octave, in samples of density 1."""
    density: float = setting(0.5, 0.5, 1)
    """Samples to a side of an octave for each of Lowe's: 1 or 0.5. At 0.5 and `first_octave` -1
    the octave of the doubled image has the image's own pixels: under its blur there is next to
    nothing between them. It costs a quarter."""
    camera_sigma: float = setting(0.0, 0, 4)
    """Assumed blur of the image, in pixels. 0 blurs it by all of `base_sigma`: the finest
    keypoints, which the noise makes, are fewer, and more of the others are repeated."""
    kernel_radius: float = setting(3.0, 1, 8)
    """Truncation of the Gaussian kernels, in sigmas."""
    grid: Grid = "centered"
    """"centered" lays the samples of every octave symmetrically about the middle of the image:
    positions are unbiased, and a mirrored image has the mirrored keypoints. "shifted" samples as
    OpenCV does: doubling shifts the image by a quarter pixel to the right and down, and every
    octave starts at the upper left sample of the one before. "published" does too, and keeps the
    last sample of an odd side, which OpenCV drops."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.density in (0.5, 1), "density", "0.5 or 1", self.density)
        centered = self.grid == "centered" or self.density == 1
        require(centered, "grid", "'centered' where density is 0.5", self.grid)

    def sigma(self, level: Level) -> Level:
        """Blur of a plane so many intervals above the first, in samples of its octave."""
        return self.density * self.base_sigma * 2 ** (level / self.intervals)

    def first_level(self, octave: IntArray) -> IntArray:
        """Level of the first plane of octaves (numbers from 0), in intervals above `base_sigma`."""
        level: IntArray = octave * self.intervals + np.where(octave > 0, self.extra_intervals, 0)
        return level
