"""The settings of a Gaussian scale space."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from saccade.errors import Settings, require, setting
from saccade.types import FloatArray, IntArray

Grid: TypeAlias = Literal["centered", "shifted", "published"]
Level = TypeVar("Level", float, FloatArray)
MAX_OCTAVES = 32
"""Maximum number of octaves; an image of 2^28 pixels in one row has 29."""


@dataclass(frozen=True)
class ScaleSpaceConfig(Settings):
    """Octaves, intervals and sampling of a Gaussian scale space, with the defaults of `Sift`."""

    first_octave: int = setting(-1, -1, 0)
    """First octave: -1 starts at the scales of a doubled image, 0 at the scales of the image, with
    a quarter of the keypoints."""
    octaves: int | None = setting(None, 1, MAX_OCTAVES)
    """Maximum number of octaves; None for no limit."""
    intervals: int = setting(3, 1, 16)
    """Intervals per octave, s."""
    extra_intervals: int = setting(2, 0, 16)
    """Additional intervals in the first octave. Later octaves then start at a larger blur, relative
    to their sampling. Without them, `density` 0.5 causes aliasing, with keypoint errors of a fifth
    of a pixel under rotation or scaling."""
    base_sigma: float = setting(1.8, 0.5, 8)
    """Blur of the first plane of the first octave, in samples of density 1."""
    density: float = setting(0.5, 0.5, 1)
    """Sampling density relative to Lowe's, 1 or 0.5. With 0.5 and `first_octave` -1 the first
    octave is sampled at the image's own pixels, at a quarter of the cost; its blur leaves almost no
    detail between pixels."""
    camera_sigma: float = setting(0.0, 0, 4)
    """Assumed blur of the image, in pixels. 0 applies the full `base_sigma`, which suppresses the
    finest, noise-induced keypoints and raises the repeatability."""
    kernel_radius: float = setting(3.0, 1, 8)
    """Truncation of the Gaussian kernels, in sigmas."""
    grid: Grid = "centered"
    """"centered" places the samples of every octave symmetrically about the image center: positions
    are unbiased, and a mirrored image has mirrored keypoints. "shifted" samples like OpenCV:
    doubling shifts the image by a quarter pixel to the right and down, and every octave starts at
    the upper left sample of the previous octave. "published" also keeps the last sample of an odd
    side, which OpenCV drops."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.density in (0.5, 1), "density", "0.5 or 1", self.density)
        centered = self.grid == "centered" or self.density == 1
        require(centered, "grid", "'centered' where density is 0.5", self.grid)

    def sigma(self, level: Level) -> Level:
        """Blur, in samples, of a plane `level` intervals above the first of its octave."""
        return self.density * self.base_sigma * 2 ** (level / self.intervals)

    def first_level(self, octave: IntArray) -> IntArray:
        """Level of the first plane of octaves (numbers from 0), in intervals above `base_sigma`."""
        level: IntArray = octave * self.intervals + np.where(octave > 0, self.extra_intervals, 0)
        return level
