"""The settings of MUST."""

from dataclasses import dataclass, field, fields
from typing import Literal, Self

from saccade.errors import require, require_ranges, require_types
from saccade.keypoints.descriptor_config import DescriptorConfig
from saccade.keypoints.sift_config import SiftConfig


@dataclass(frozen=True)
class MustConfig:
    """Settings of the detector; `saccade.keypoints.must` says why these are the defaults."""

    first_octave: int = -1
    """-1 begins at the scales of a doubled image; 0 at those of the image."""
    octaves: int | None = None
    """Maximum number of octaves; None for as many as the image has room for."""
    intervals: int = 2
    """s, intervals per octave."""
    base_sigma: float = 3.2
    """Blur of the first plane of an octave, in samples of a grid twice as dense as its own."""
    radius: float = 2.5
    """The largest distance of a pair from its middle, in scales of the plane."""
    falloff: float = 1.3
    """Standard deviation, in scales, of the normal density that weights a pair by the distance
    of the two from their middle."""
    gain: float = 100.0
    """Of the logarithm of a gradient: its strength is log(1 + gain g), with the change g over one
    scale by the standard deviation of the image."""
    scale_power: float = 0.25
    """Power of the scale in pixels by which symmetry is multiplied: above 0, large structures
    count more."""
    contrast_threshold: float = 0.05
    """The smallest symmetry: the weighted mean over the pairs of strength and phase weight."""
    neighbors: Literal[10, 26] = 10
    """Samples that a maximum is compared with: all 26 around it, or 10 as `SiftConfig` has it."""
    edge_ratio: float = 50.0
    """The largest ratio of the principal curvatures of the symmetry, as B.10 has it for D."""
    border: int = 5
    """Samples at the edge of every octave that are not searched."""
    max_orientations: int | None = None
    """Strongest orientations to keep at a position; None for all over 80 % of the highest."""
    upright: bool = False
    """Give every keypoint the angle 0."""
    max_keypoints: int | None = None
    """Number of keypoints to keep, the strongest; None for all."""
    spread: bool = False
    """Keep as many, but rather those that are far from any clearly stronger one."""
    descriptor: DescriptorConfig = field(default_factory=DescriptorConfig)
    """How orientations are assigned and keypoints described."""

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(self, radius=(0.1, 20), falloff=(0.1, 20), scale_power=(-5, 5))
        require(0 < self.gain <= 1e6, "gain", "above 0, at most 1e6", self.gain)
        threshold = self.contrast_threshold
        require(0 <= threshold < 1e3, "contrast_threshold", "at least 0 and under 1000", threshold)
        self.sift()  # checks the others

    @classmethod
    def kootstra2010(cls) -> Self:
        """The default detector with the descriptor of section B.2, as the source describes MUST's.

        The appendices do not have the detector itself.
        """
        return cls(descriptor=DescriptorConfig.kootstra2010())

    def sift(self) -> SiftConfig:
        """SIFT with the same scale space, fit, selection and descriptors."""
        names = [setting.name for setting in fields(DescriptorConfig)]
        return SiftConfig(
            **{name: getattr(self.descriptor, name) for name in names},
            first_octave=self.first_octave,
            octaves=self.octaves,
            intervals=self.intervals,
            extra_intervals=0,
            base_sigma=self.base_sigma,
            density=0.5,
            camera_sigma=0.0,
            kernel_radius=3.0,
            candidate_fraction=0.8,
            neighbors=self.neighbors,
            edge_ratio=self.edge_ratio,
            border=self.border,
            max_orientations=self.max_orientations,
            upright=self.upright,
            max_keypoints=self.max_keypoints,
            ranking="response",
            spread=self.spread,
        )
