"""Settings of orientations and descriptors, shared by all detectors."""

from dataclasses import dataclass
from typing import Literal, Self

from saccade.errors import Settings, setting


@dataclass(frozen=True)
class DescriptorConfig(Settings):
    """How orientations are assigned and keypoints described; the default is `Sift`'s."""

    voting: Literal["linear", "nearest"] = "linear"
    """Whether a gradient is interpolated between the two nearest of the 36 orientation bins, or
    counts for one."""
    smoothing: int = setting(6, 0, 100)
    """Passes of [1 2 1] / 4 over the orientation histogram."""
    orientation_bins: Literal["peaks", "all"] = "peaks"
    """Whether all bins over 80 % of the highest count, or only local peaks."""
    orientation_spacing: float | None = setting(1.0, above=0, maximum=3)
    """Spacing of the samples of the orientation histogram, in scales; None for all samples."""
    subpixel_patches: bool = True
    """Center orientation and descriptor on the keypoint, not on the sample nearest to it."""
    descriptor_spacing: float | None = setting(1.2, above=0, maximum=3)
    """Spacing of the samples of the descriptor, in scales; None for all samples. Lowe's 4x4 samples
    in each of 4x4 subregions are 0.75 apart."""
    window_sigma: float = setting(0.7, 0.1, 10)
    """Standard deviation of the Gaussian window of the descriptor, in sides of the descriptor."""
    descriptor: Literal["sift", "root", "kootstra2010"] = "root"
    """"root" L1-normalizes and takes the square root (RootSIFT). "kootstra2010" takes 4 x 4
    samples in each of the 4 x 4 subregions, each weighted by its Euclidean distance, as section
    B.2 has it; it takes a millisecond a keypoint and ignores the three settings above."""
    descriptor_dtype: Literal["uint8", "float32"] = "uint8"
    """Whether descriptors are bytes, 512 to the unit, or floats of unit length."""

    @classmethod
    def lowe2004(cls) -> Self:
        """Lowe (2004), sections 5 and 6; all samples."""
        return cls(
            smoothing=0,
            orientation_spacing=None,
            descriptor_spacing=None,
            window_sigma=0.5,
            descriptor="sift",
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010), section B.2."""
        return cls(
            voting="nearest",
            smoothing=0,
            orientation_bins="all",
            orientation_spacing=None,
            descriptor_spacing=None,
            window_sigma=1.5,
            descriptor="kootstra2010",
        )
