"""The settings of SIFT, and their presets."""

from dataclasses import dataclass, fields, replace
from numbers import Integral, Real
from typing import Literal, get_args

import numpy as np

from saccade.errors import require
from saccade.types import IntArray


@dataclass(frozen=True)
class SiftConfig:
    """What the detector and the descriptor are to do; the default is `recommended`.

    Thresholds are for images in [0, 1].
    """

    first_octave: int = -1
    """-1 begins at the scales of a doubled image; 0 at those of the image: a quarter of the
    points."""
    octaves: int = 0
    """How many at most; 0 for as many as the image has room for."""
    intervals: int = 3
    """s, the scales to an octave."""
    extra_intervals: int = 2
    """Scales more in the first octave. The octaves after it begin at a wider blur and so have
    denser samples: an octave that is halved as early as `density` 0.5 halves it holds what its
    samples cannot, and its places are off by a fifth of a pixel under rotation or scaling."""
    base_sigma: float = 1.8
    """Blur of the first plane of the first octave, in samples of density 1."""
    density: float = 0.5
    """Samples to a side of an octave for each of Lowe's: 1 or 0.5. At 0.5 and `first_octave` -1
    the octave of the doubled image is made of the image's own pixels: under its blur there is
    next to nothing between them. It costs a quarter."""
    camera_sigma: float = 0.0
    """Blur that the image is assumed to have, in pixels. 0 blurs it by all of `base_sigma`:
    the finest points, which the noise makes, are fewer, and more of the others come back."""
    kernel_radius: float = 3.0
    """Where Gaussian kernels are cut, in sigmas."""
    grid: Literal["centered", "shifted", "printed"] = "centered"
    """"centered" gives unbiased places, and to a mirrored image the mirrored points;
    "shifted" puts every point a quarter pixel too far to the right and down where the image
    is doubled, as OpenCV does; "printed" does too, and keeps the last sample of an odd side."""
    border: int = 5
    """Samples at the edge of every octave that are not searched."""
    contrast_threshold: float = 0.016
    """tau_c: the least |D| at an extremum (B.6)."""
    candidate_fraction: float = 0.7
    """Share of `contrast_threshold` that a sample must exceed before the fit."""
    neighbors: Literal[10, 26] = 10
    """Samples that an extremum must not be exceeded by: all 26 around it, as Lowe has it, or the
    8 in its plane and the 2 above and below. Where samples are sparse one of the other 16 often
    belongs to another hill, and the extremum is found one time and missed the next. Of 10, the
    fit tells those that are extrema from saddles."""
    edge_ratio: float = 15.0
    """tau_r: the greatest ratio of the principal curvatures (B.10)."""
    fit: Literal["lagrange", "quadratic", "once"] = "lagrange"
    """"once" is B.5 alone. "quadratic" fits again from the neighboring sample while that is
    nearer to the extremum, as Lowe does. "lagrange" goes on from there with the polynomial
    through 9 samples each way, which finds a blob's centre within 0.003 samples rather than
    0.07, and keeps the extrema that lie halfway between two samples, where the quadratic goes
    back and forth."""
    voting: Literal["linear", "nearest"] = "linear"
    """Whether a gradient is shared by the two nearest of the 36 directions or goes to one."""
    smoothing: int = 6
    """Passes of [1 2 1] / 4 over the histogram of directions."""
    orientation_bins: Literal["peaks", "all"] = "peaks"
    """Whether of the directions over 80 % of the highest only local peaks count, or all."""
    max_orientations: int = 0
    """Strongest directions to keep at a place; 0 for all over 80 % of the highest."""
    upright: bool = False
    """Give every point the angle 0."""
    subpixel_patches: bool = True
    """Centre orientation and descriptor on the point, not on the sample nearest to it."""
    orientation_spacing: float = 1.0
    """Of the samples that the histogram of directions looks at, in scales; 0 for all."""
    descriptor_spacing: float = 1.2
    """Of the samples that the descriptor looks at, in scales; 0 for all. Lowe's 4x4 samples
    in each of 4x4 subregions are 0.75 apart."""
    window_sigma: float = 0.7
    """Of the descriptor's Gaussian window, in sides of the descriptor."""
    descriptor: Literal["sift", "root", "kootstra2010"] = "root"
    """"root" L1-normalizes and takes the square root (RootSIFT). "kootstra2010" takes 4 x 4
    samples in each of the 4 x 4 subregions, each shared by its Euclidean distance, as section
    B.2 has it; it takes a millisecond a point, and has no use for the three settings above."""
    descriptor_dtype: Literal["uint8", "float32"] = "uint8"
    """Whether descriptors are bytes, 512 to the unit, or floats of unit length."""
    max_keypoints: int = 0
    """Keep this many of the strongest; 0 keeps all."""
    spread: bool = False
    """Keep as many, but rather those that are far from any clearly stronger one: they cover
    the image (adaptive non-maximal suppression)."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type is int:
                require(isinstance(value, Integral), field.name, "a whole number", value)
            elif field.type is float:
                require(isinstance(value, Real), field.name, "a number", value)
            elif choices := get_args(field.type):
                require(value in choices, field.name, " or ".join(map(repr, choices)), value)
        require(self.first_octave in (-1, 0), "first_octave", "-1 or 0", self.first_octave)
        require(self.octaves >= 0, "octaves", "0 or more", self.octaves)
        require(1 <= self.intervals <= 16, "intervals", "1 to 16", self.intervals)
        require(0 <= self.extra_intervals <= 16, "extra_intervals", "0 to 16", self.extra_intervals)
        require(0.5 <= self.base_sigma <= 8, "base_sigma", "0.5 to 8", self.base_sigma)
        require(self.density in (0.5, 1), "density", "0.5 or 1", self.density)
        require(0 <= self.camera_sigma <= 4, "camera_sigma", "0 to 4", self.camera_sigma)
        require(1 <= self.kernel_radius <= 8, "kernel_radius", "1 to 8", self.kernel_radius)
        require(
            self.grid == "centered" or self.density == 1,
            "grid",
            "'centered' where density is 0.5",
            self.grid,
        )
        require(self.border >= 2, "border", "2 or more", self.border)
        require(
            0 <= self.contrast_threshold < 1,
            "contrast_threshold",
            "at least 0 and under 1",
            self.contrast_threshold,
        )
        require(
            0 <= self.candidate_fraction <= 1,
            "candidate_fraction",
            "0 to 1",
            self.candidate_fraction,
        )
        require(self.edge_ratio >= 1, "edge_ratio", "1 or more", self.edge_ratio)
        require(0 <= self.smoothing <= 100, "smoothing", "0 to 100", self.smoothing)
        require(self.max_orientations >= 0, "max_orientations", "0 or more", self.max_orientations)
        for name in ("orientation_spacing", "descriptor_spacing"):
            require(0 <= getattr(self, name) <= 3, name, "0 to 3", getattr(self, name))
        require(0.1 <= self.window_sigma <= 10, "window_sigma", "0.1 to 10", self.window_sigma)
        require(self.max_keypoints >= 0, "max_keypoints", "0 or more", self.max_keypoints)
        require(
            self.max_keypoints > 0 or not self.spread,
            "spread",
            "max_keypoints over 0 with it",
            self.max_keypoints,
        )

    @classmethod
    def recommended(cls) -> "SiftConfig":
        """Ours: unbiased, about as many points as OpenCV finds, sparse samples, RootSIFT.

        Its numbers were chosen on the affine covariant regions set, all eight sequences in view.
        """
        return cls()

    @classmethod
    def lowe2004(cls) -> "SiftConfig":
        """Lowe (2004): the image doubled, all octaves, |D| over 0.03.

        The article leaves the sharing of gradients and the grid open; the place is refined
        beyond its quadratic (see `fit`).
        """
        return cls(
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
            smoothing=0,
            orientation_spacing=0.0,
            descriptor_spacing=0.0,
            window_sigma=0.5,
            descriptor="sift",
        )

    @classmethod
    def kootstra2010(cls) -> "SiftConfig":
        """Kootstra (2010): appendix B, three octaves from the image itself.

        What the print leaves open is as in `saccade.textbook.sift`.
        """
        return replace(
            cls.lowe2004(),
            first_octave=0,
            octaves=3,
            camera_sigma=0.0,
            kernel_radius=3.0,
            grid="printed",
            contrast_threshold=0.02,
            candidate_fraction=0.0,
            fit="once",
            voting="nearest",
            orientation_bins="all",
            window_sigma=1.5,
            descriptor="kootstra2010",
        )

    @classmethod
    def opencv(cls) -> "SiftConfig":
        """As `cv2.SIFT_create()`, its shift by a quarter pixel included.

        Of a wide point every second sample is described, where OpenCV takes all: descriptors
        have a median cosine of 0.9998 with OpenCV's, and 99 % of them one of over 0.997.
        """
        return replace(
            cls.lowe2004(),
            grid="shifted",
            border=5,
            fit="quadratic",
            contrast_threshold=0.04 / 3,
            candidate_fraction=3 / (0.04 * 255),  # OpenCV rounds down to one grey level
            voting="nearest",
            smoothing=2,
            descriptor_spacing=0.7,
            subpixel_patches=False,
        )

    @classmethod
    def colmap(cls) -> "SiftConfig":
        """COLMAP's settings of VLFeat; of more than 8192 points the strongest are kept."""
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

    def first_level(self, octave: int | IntArray) -> IntArray:
        """By how many intervals the first plane of an octave is wider than `base_sigma`.

        Args:
            octave: number from 0, or some.
        """
        number = np.asarray(octave, np.int64)
        level: IntArray = number * self.intervals + (number > 0) * self.extra_intervals
        return level
