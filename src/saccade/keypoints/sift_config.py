"""The settings of SIFT and their presets."""

from dataclasses import dataclass, replace
from typing import Literal, Self

from saccade.errors import require, setting
from saccade.keypoints.descriptor_config import DescriptorConfig
from saccade.keypoints.selection_config import SelectionConfig
from saccade.scale.scale_space_config import ScaleSpaceConfig


@dataclass(frozen=True)
class SiftConfig(SelectionConfig, DescriptorConfig, ScaleSpaceConfig):
    """Settings of scale space, detector and descriptor.

    The default is unbiased and has about as many keypoints as OpenCV's SIFT, sparse samples and
    RootSIFT; it was chosen on all eight sequences of the affine covariant regions set. Thresholds
    are for images in [0, 1].
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
