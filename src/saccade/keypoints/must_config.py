"""The settings of MUST."""

from dataclasses import dataclass, field, replace
from typing import Literal, Self

from saccade.errors import require
from saccade.keypoints.sift_config import SiftConfig

DENSITY = 0.5
"""Samples to a side of an octave for each of Lowe's; see `SiftConfig`."""
KERNEL_RADIUS = 3.0
"""Where the Gaussian kernels are cut, in sigmas."""
CANDIDATE = 0.8
"""Share of the threshold that a sample must exceed before the fit."""


@dataclass(frozen=True)
class MustConfig:
    """What the detector is to do; `saccade.keypoints.must` says why these are the defaults."""

    first_octave: int = -1
    """-1 begins at the scales of a doubled image; 0 at those of the image."""
    octaves: int = 0
    """How many at most; 0 for as many as the image has room for."""
    intervals: int = 3
    """s, the scales to an octave."""
    base_sigma: float = 2.6
    """Blur of the first plane of an octave, in samples of a grid twice as dense as its own."""
    reach: float = 2.5
    """The largest distance of a pair from its middle, in scales of the plane."""
    falloff: float = 1.3
    """Standard deviation, in scales, of the normal density by which a pair counts less the
    farther the two are from their middle."""
    gain: float = 100.0
    """How soon a gradient is strong: its strength is log(1 + gain g), with the change g over one
    scale by the standard deviation of the image."""
    scale_power: float = 0.25
    """Power of the scale in pixels by which symmetry is multiplied: above 0, large things count
    more."""
    contrast_threshold: float = 0.05
    """The least symmetry: the weighted mean over the pairs of strength and phase weight."""
    neighbors: Literal[10, 26] = 10
    """Samples that a maximum must not be exceeded by: all 26 around it, or 10 as `SiftConfig`
    has it."""
    edge_ratio: float = 50.0
    """The greatest ratio of the principal curvatures of the symmetry, as B.10 has it for D."""
    border: int = 5
    """Samples at the edge of every octave that are not searched."""
    max_orientations: int = 0
    """Strongest directions to keep at a place; 0 for all over 80 % of the highest."""
    upright: bool = False
    """Give every point the angle 0."""
    max_keypoints: int = 0
    """Keep this many of the strongest; 0 keeps all."""
    spread: bool = False
    """Keep as many, but rather those that are far from any clearly stronger one."""
    descriptor: SiftConfig = field(default_factory=SiftConfig)
    """How orientations are assigned and keypoints described; what it says of the scale space,
    of detection and of which keypoints are kept does not count here."""

    def __post_init__(self) -> None:
        require(0.1 <= self.reach <= 20, "reach", "0.1 to 20 scales", self.reach)
        require(0.1 <= self.falloff <= 20, "falloff", "0.1 to 20 scales", self.falloff)
        require(0 < self.gain <= 1e6, "gain", "above 0, at most 1e6", self.gain)
        require(-5 <= self.scale_power <= 5, "scale_power", "-5 to 5", self.scale_power)
        require(
            0 <= self.contrast_threshold < 1e3,
            "contrast_threshold",
            "at least 0 and under 1000",
            self.contrast_threshold,
        )
        self.sift()  # checks the others

    @classmethod
    def kootstra2010(cls) -> Self:
        """The default detector with the descriptor of section B.2, as the source describes MUST's.

        The appendices do not have the detector itself.
        """
        return cls(descriptor=SiftConfig.kootstra2010())

    def sift(self) -> SiftConfig:
        """SIFT over the same scale space, for the orientations and the descriptors."""
        return replace(
            self.descriptor,
            first_octave=self.first_octave,
            octaves=self.octaves,
            intervals=self.intervals,
            extra_intervals=0,
            base_sigma=self.base_sigma,
            density=DENSITY,
            camera_sigma=0.0,
            kernel_radius=KERNEL_RADIUS,
            grid="centered",
            candidate_fraction=CANDIDATE,
            neighbors=self.neighbors,
            fit="lagrange",
            edge_ratio=self.edge_ratio,
            border=self.border,
            max_orientations=self.max_orientations,
            upright=self.upright,
            max_keypoints=self.max_keypoints,
            spread=self.spread,
        )
