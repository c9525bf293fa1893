"""The settings of SIFT and of the descriptor of every detector, and their presets."""

from dataclasses import dataclass, replace
from math import inf
from typing import Literal, Self

from saccade.errors import Settings, require, setting
from saccade.scale.scale_space_config import ScaleSpaceConfig


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


MIN_RESPONSE = 1e-4
"""Response that passes all but rounding errors."""


@dataclass(frozen=True)
class SelectionConfig(Settings):
    """Which extrema of a scale space become keypoints; the default is `Sift`'s."""

    border: int = setting(5, 2)
    """Samples at the edge of every octave that are not searched."""
    contrast_threshold: float | None = setting(None, 0, below=1)
    """Smallest |D| at an extremum, tau_c (B.6). None means 0.016, or no threshold if
    `max_keypoints` is set."""
    neighbors: Literal[10, 26] = 10
    """Samples that an extremum is compared with: all 26 around it, as Lowe has it, or the 8 in its
    plane and the 2 above and below. In sparse sampling one of the other 16 often belongs to another
    extremum, which makes detection less repeatable. With 10, the fit rejects saddles."""
    edge_ratio: float = setting(15.0, 1, inf)
    """Largest ratio of the principal curvatures, tau_r (B.10)."""
    max_orientations: int | None = setting(None, 1)
    """Strongest orientations to keep at a position; None for all over 80 % of the highest."""
    upright: bool = False
    """Give every keypoint the angle 0."""
    max_keypoints: int | None = setting(None, 1)
    """Number of keypoints to keep, the strongest; None for all."""
    spread: bool = False
    """Prefer keypoints far from any clearly stronger one, so that they cover the image (adaptive
    non-maximal suppression)."""

    default_threshold = 0.016
    """The threshold where neither it nor the number of keypoints is given."""

    @property
    def min_response(self) -> float:
        """Smallest response of a keypoint."""
        if self.contrast_threshold is not None:
            return self.contrast_threshold
        return self.default_threshold if self.max_keypoints is None else MIN_RESPONSE


@dataclass(frozen=True)
class SiftConfig(SelectionConfig, DescriptorConfig, ScaleSpaceConfig):
    """Settings of scale space, detector and descriptor; the default is `recommended`.

    Thresholds are for images in [0, 1].
    """

    candidate_fraction: float = setting(0.7, 0, 1)
    """Fraction of `contrast_threshold` that a sample must exceed before the fit."""
    fit: Literal["lagrange", "quadratic", "once"] = "lagrange"
    """"once" is B.5 alone. "quadratic" fits again from the neighboring sample while that is
    nearer to the extremum, as Lowe does. "lagrange" continues with the polynomial through 9
    samples each way, which localizes a blob's center within 0.003 samples rather than 0.07, and
    keeps the extrema halfway between two samples, where the quadratic goes back and forth."""
    ranking: Literal["signal-to-noise", "response"] = "signal-to-noise"
    """Strength of a keypoint: "response" is |D|; "signal-to-noise" is |D| times the scale in
    pixels, which is proportional to that ratio: white noise of the pixels has in D a standard
    deviation that falls as 1 / sigma. With `max_keypoints` scales level off at a fiftieth of it:
    the strongest few would else all be large, and large ones are localized coarsely."""

    def __post_init__(self) -> None:
        ScaleSpaceConfig.__post_init__(self)  # checks the ranges of the descriptor too
        limited = self.max_keypoints is not None
        require(limited or not self.spread, "spread", "max_keypoints with it", self.max_keypoints)

    @classmethod
    def recommended(cls) -> Self:
        """Ours: unbiased, about as many keypoints as OpenCV's, sparse samples, RootSIFT.

        Its numbers were chosen on the affine covariant regions set, all eight sequences in view.
        """
        return cls()

    @classmethod
    def mapping(cls) -> Self:
        """Structure from motion: more and finer keypoints, of more exact positions.

        Bundle adjustment weighs all observations equally. Lowe's sampling, 26 neighbors and a
        stricter edge ratio each lower the reprojection error (docs/measured.md).
        """
        return cls(
            density=1.0,
            contrast_threshold=0.006,
            neighbors=26,
            edge_ratio=10.0,
            max_keypoints=8192,
        )

    @classmethod
    def lowe2004(cls) -> Self:
        """Lowe (2004): the image doubled, all octaves, |D| over 0.03.

        The article leaves the interpolation of gradients and the grid open; the position is
        refined beyond its quadratic (see `fit`).
        """
        return replace(
            super().lowe2004(),
            extra_intervals=0,
            base_sigma=1.6,
            density=1.0,
            camera_sigma=0.5,
            kernel_radius=4.0,
            border=2,
            contrast_threshold=0.03,
            candidate_fraction=0.5,
            neighbors=26,
            edge_ratio=10.0,
            ranking="response",
        )

    @classmethod
    def kootstra2010(cls) -> Self:
        """Kootstra (2010): appendix B, three octaves from the image itself.

        Choices that the source leaves open are made as in `saccade.textbook.sift`.
        """
        return replace(
            super().kootstra2010(),
            first_octave=0,
            octaves=3,
            extra_intervals=0,
            base_sigma=1.6,
            density=1.0,
            camera_sigma=0.0,
            kernel_radius=3.0,
            grid="published",
            border=2,
            contrast_threshold=0.02,
            candidate_fraction=0.0,
            neighbors=26,
            edge_ratio=10.0,
            fit="once",
            ranking="response",
        )

    @classmethod
    def opencv(cls) -> Self:
        """Settings of `cv2.SIFT_create()`, with the same shift by a quarter pixel.

        The descriptor of a large keypoint has every second sample, where OpenCV takes all. The
        cosine of descriptors with OpenCV's is 0.9998 in the median and over 0.997 for 99 %.
        """
        return replace(
            cls.lowe2004(),
            grid="shifted",
            border=5,
            fit="quadratic",
            contrast_threshold=0.04 / 3,
            candidate_fraction=3 / (0.04 * 255),  # OpenCV rounds down to one gray level
            voting="nearest",
            smoothing=2,
            descriptor_spacing=0.7,
            subpixel_patches=False,
        )

    @classmethod
    def colmap(cls) -> Self:
        """COLMAP's settings of VLFeat; of more than 8192 keypoints the strongest are kept."""
        return replace(
            cls.lowe2004(),
            octaves=4,
            contrast_threshold=0.02 / 3,
            candidate_fraction=0.8,
            smoothing=8,  # the variance of VLFeat's six passes of [1 1 1] / 3
            max_orientations=2,
            descriptor="root",
            max_keypoints=8192,
        )
