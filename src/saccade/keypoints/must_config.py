"""The settings of MUST and SymRoID."""

from dataclasses import dataclass, field, fields
from math import inf
from typing import Self

from saccade.errors import Settings, setting
from saccade.keypoints.descriptor_config import DescriptorConfig
from saccade.keypoints.selection_config import MIN_RESPONSE, SelectionConfig
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.scale_space_config import MAX_OCTAVES


@dataclass(frozen=True)
class MustConfig(SelectionConfig):
    """Settings of the detector; `saccade.keypoints.must` gives the reasons for the defaults."""

    first_octave: int = setting(-1, -1, 0)
    """First octave: -1 starts at the scales of a doubled image, 0 at the scales of the image."""
    octaves: int | None = setting(None, 1, MAX_OCTAVES)
    """Maximum number of octaves; None for as many as the image has room for."""
    intervals: int = setting(2, 1, 16)
    """Intervals per octave, s."""
    base_sigma: float = setting(3.2, 0.5, 8)
    """Blur of the first plane of an octave, in samples of a grid twice as dense as its own."""
    radius: float = setting(2.5, 0.1, 20)
    """Largest distance of a pair from its middle, in scales of the plane."""
    falloff: float = setting(1.3, 0.1, 20)
    """Standard deviation, in scales, of the normal density that weights a pair by the distance
    of the two from their middle."""
    gain: float = setting(100.0, above=0, maximum=1e6)
    """Gain of a gradient, whose strength is log(1 + gain g), with the change g over one
    scale by the standard deviation of the image."""
    scale_power: float = setting(0.25, -5, 5)
    """Power of the scale in pixels by which symmetry is multiplied: above 0, large structures
    count more."""
    contrast_threshold: float | None = setting(None, 0, below=1000)
    """Smallest symmetry: the weighted mean over the pairs of strength and phase weight. None means
    0.05, or no threshold if `max_keypoints` is set."""
    edge_ratio: float = setting(50.0, 1, inf)
    """Largest ratio of the principal curvatures of the symmetry, as B.10 has it for D."""
    descriptor: DescriptorConfig = field(default_factory=DescriptorConfig)
    """How orientations are assigned and keypoints described."""

    default_threshold = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        self.sift()  # checks combinations

    @classmethod
    def kootstra2010(cls) -> Self:
        """The default detector with the descriptor of section B.2, as the source describes MUST's.

        The appendices do not have the detector itself.
        """
        return cls(descriptor=DescriptorConfig.kootstra2010())

    def sift(self) -> SiftConfig:
        """SIFT with the same scale space, fit, selection and descriptors."""
        names = {each.name for each in fields(SiftConfig)} & {each.name for each in fields(self)}
        names -= {"contrast_threshold", "descriptor"}
        return SiftConfig(
            **vars(self.descriptor),
            **{name: getattr(self, name) for name in names},
            extra_intervals=0,
            density=0.5,
            candidate_fraction=0.8,
            ranking="response",
        )


@dataclass(frozen=True)
class SymRoidConfig(Settings):
    """Settings of the region detector."""

    seed_threshold: float = setting(0.05, above=0, maximum=1)
    """Smallest symmetry of a region, as a fraction of the largest in the image."""
    upright: bool = False
    """Describe regions upright; otherwise along each dominant orientation of their gradients."""
    max_keypoints: int | None = setting(50, 1)
    """Number of regions to keep, the strongest: few, as landmarks should be; None for all. Like
    a keypoint, a region counts once for each of its orientations."""
    descriptor: DescriptorConfig = field(default_factory=DescriptorConfig)
    """How orientations of a region are assigned and the region described."""

    def must(self) -> MustConfig:
        """MUST with which regions are found, from the scales of the image on."""
        return MustConfig(
            first_octave=0,
            contrast_threshold=MIN_RESPONSE,
            upright=self.upright,
            max_keypoints=self.max_keypoints,
            descriptor=self.descriptor,
        )
