"""The settings of SymRoID, and the source's as a preset."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, Self

from saccade.errors import require
from saccade.keypoints.sift_config import SiftConfig
from saccade.pyramid import MAX_LEVEL


@dataclass(frozen=True)
class SymRoidConfig:
    """Which regions to take for landmarks; docs/symmetry.md says how the default was chosen."""

    levels: tuple[int, ...] = (1, 2, 3)
    """Pyramid levels whose symmetry is added up; the image is level 0, and the map has the size
    of the first."""
    inner: int = 1
    """The least distance of a pair from its middle, along x or y, in pixels of its level."""
    outer: int = 7
    """The largest, likewise."""
    sigma: float = 8.0
    """Of the normal density that weighs a pair by the distance between the two, likewise."""
    gain: float = 60.0
    """How soon a gradient is strong; see `SymmetryConfig`."""
    seed_threshold: float = 0.05
    """The least symmetry of a seed, by the maximum of the map."""
    growth_threshold: float = 0.8
    """Down to which a region grows, by what `relative_to` says."""
    relative_to: Literal["seed", "maximum"] = "seed"
    """"maximum" of the map, as the source has it: its regions are few, and where threshold is low
    they run together. By its own "seed" every region is a peak."""
    upright: bool = False
    """Describe regions as they stand; otherwise along the strongest direction of gradients."""
    max_keypoints: int = 50
    """Keep this many of the strongest: few, as landmarks should be; 0 keeps all."""
    descriptor: SiftConfig = field(default_factory=SiftConfig)
    """How the orientation of a region is assigned and the region described; nothing else of it
    counts here, and a region has one orientation."""

    def __post_init__(self) -> None:
        rising = all(finer < coarser for finer, coarser in pairwise(self.levels))
        inside = all(0 <= level <= MAX_LEVEL for level in self.levels)
        expected = f"rising levels from 0 to {MAX_LEVEL}"
        require(len(self.levels) > 0 and inside and rising, "levels", expected, self.levels)
        require(1 <= self.outer <= 100, "outer", "1 to 100 px", self.outer)
        require(1 <= self.inner <= self.outer, "inner", f"1 px to {self.outer}", self.inner)
        require(0.1 <= self.sigma <= 1e6, "sigma", "0.1 px or more", self.sigma)
        require(0 < self.gain <= 1e6, "gain", "above 0, at most 1e6", self.gain)
        for name in ("seed_threshold", "growth_threshold"):
            value = getattr(self, name)
            require(0 < value <= 1, name, "above 0, at most 1", value)
        require(
            self.relative_to in ("seed", "maximum"),
            "relative_to",
            "'seed' or 'maximum'",
            self.relative_to,
        )
        require(self.max_keypoints >= 0, "max_keypoints", "0 or more", self.max_keypoints)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The source's: seeds and growth at half of the maximum, levels and ring of the release.

        Of its descriptor no more is known than that it is largely SIFT's (section B.2).
        """
        return cls(
            levels=(3, 4, 5),
            inner=3,
            outer=7,
            sigma=16.0,
            gain=1.0,
            seed_threshold=0.5,
            growth_threshold=0.5,
            relative_to="maximum",
            upright=True,
            max_keypoints=0,
            descriptor=SiftConfig.kootstra2010(),
        )
