"""The settings of SymRoID, and the source's as a preset."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, Self

from saccade.errors import Settings, require, setting
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.sift_config import MIN_RESPONSE, DescriptorConfig
from saccade.scale.pyramid import MAX_LEVEL


@dataclass(frozen=True)
class SymRoidConfig(Settings):
    """Settings of the region detector; docs/symmetry.md says how the default was chosen."""

    frame: Literal["scale-space", "box"] = "scale-space"
    """Frame in which a region is described. "scale-space": center, scale and orientations of a
    maximum of symmetry over position and scale, as MUST finds it. "box": the box about a region
    grown in the map of symmetry, as the source has it; `levels`, `inner`, `outer`, `sigma`, `gain`
    and `growth_threshold` are settings of that map and of no effect otherwise."""
    levels: tuple[int, ...] = (3, 4, 5)
    """Pyramid levels whose symmetry is summed; the image is level 0, and the map has the size
    of the first."""
    inner: int = setting(3, 1, slider=(1, 10, 1))
    """Smallest distance of a pair from its middle, along x or y, in pixels of its level."""
    outer: int = setting(7, 1, 100, slider=(1, 15, 1))
    """Largest distance of a pair from its middle, likewise."""
    sigma: float = setting(16.0, 0.1, 1e6, slider=(0.5, 32, 0.5))
    """Standard deviation of the density that weights a pair by its distance, likewise."""
    gain: float = setting(1.0, above=0, maximum=1e6, slider=(1, 200, 1))
    """Gain of the strength of a gradient; see `SymmetryConfig`."""
    seed_threshold: float = setting(0.05, above=0, maximum=1, slider=(0.01, 1, 0.01))
    """Smallest symmetry of a region or a seed, as a fraction of the largest in the image."""
    growth_threshold: float = setting(0.5, above=0, maximum=1, slider=(0.05, 1, 0.05))
    """Smallest symmetry within a region, likewise."""
    upright: bool = False
    """Describe regions upright; otherwise along the dominant orientations of their gradients: a
    box along one, a frame in scale space along each, as a keypoint of MUST is."""
    max_keypoints: int | None = setting(50, 1, slider=(0, 500, 1))
    """Number of regions to keep, the strongest: few, as landmarks should be; None for all. Like
    a keypoint, a region counts once for each of its orientations."""
    descriptor: DescriptorConfig = field(default_factory=DescriptorConfig)
    """How orientations of a region are assigned and the region described."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rising = all(finer < coarser for finer, coarser in pairwise(self.levels))
        inside = all(0 <= level <= MAX_LEVEL for level in self.levels)
        expected = f"rising levels from 0 to {MAX_LEVEL}"
        require(len(self.levels) > 0 and inside and rising, "levels", expected, self.levels)
        require(self.inner <= self.outer, "inner", f"1 px to {self.outer}", self.inner)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The source's: seeds and growth at half of the maximum, levels and ring of the release.

        Of its descriptor no more is known than that it is largely SIFT's (section B.2).
        """
        return cls(
            frame="box",
            seed_threshold=0.5,
            upright=True,
            max_keypoints=None,
            descriptor=DescriptorConfig.kootstra2010(),
        )

    def must(self) -> MustConfig:
        """MUST with which regions are found where `frame` is "scale-space".

        It begins at the scales of the image: the finest points are no regions.
        """
        return MustConfig(
            first_octave=0,
            contrast_threshold=MIN_RESPONSE,
            upright=self.upright,
            max_keypoints=self.max_keypoints,
            descriptor=self.descriptor,
        )
