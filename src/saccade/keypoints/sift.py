"""The Scale-Invariant Feature Transform: the detector of appendix B.1."""

import os
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, require
from saccade.image import as_gray
from saccade.keypoints.descriptor import Frames, describe_frames, orientations
from saccade.keypoints.extrema import find_extrema
from saccade.scale_space import (
    SMALLEST_SIDE,
    ScaleSpace,
    Workspace,
    difference_of_gaussians,
    gaussian_scale_space,
)
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints

BoolArray: TypeAlias = npt.NDArray[np.bool_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class SiftConfig:
    """What the detector and the descriptor are to do; the default is `lowe2004`.

    Thresholds are for images in [0, 1].
    """

    first_octave: int = -1
    """-1 doubles the image first; 0 starts from the image: a quarter of the points."""
    octaves: int = 0
    """How many at most; 0 for as many as the image has room for."""
    intervals: int = 3
    """s, the scales to an octave."""
    base_sigma: float = 1.6
    """Blur of the first plane of an octave, in samples."""
    camera_sigma: float = 0.5
    """Blur that the image is assumed to have, in pixels."""
    kernel_radius: float = 4.0
    """Where Gaussian kernels are cut, in sigmas."""
    grid: Literal["centered", "shifted"] = "centered"
    """"centered" gives unbiased places, and to a mirrored image the mirrored points;
    "shifted" puts every point a quarter pixel too far to the right and down where the image
    is doubled, as OpenCV does."""
    border: int = 2
    """Samples at the edge of every octave that are not searched."""
    contrast_threshold: float = 0.03
    """tau_c: the least |D| at an extremum (B.6)."""
    candidate_fraction: float = 0.5
    """Share of `contrast_threshold` that a sample must exceed before the fit."""
    edge_ratio: float = 10.0
    """tau_r: the greatest ratio of the principal curvatures (B.10)."""
    fit: Literal["quartic", "quadratic"] = "quartic"
    """"quadratic" is B.5. "quartic" goes on from there with two samples each way, which finds
    a blob's centre within 0.003 px rather than 0.07, and keeps the extrema that lie halfway
    between two samples, where the quadratic goes back and forth."""
    voting: Literal["linear", "nearest"] = "linear"
    """Whether a gradient is shared by the two nearest of the 36 directions or goes to one."""
    smoothing: int = 0
    """Passes of [1 2 1] / 4 over the histogram of directions."""
    max_orientations: int = 0
    """Strongest directions to keep at a place; 0 for all over 80 % of the highest."""
    upright: bool = False
    """Give every point the angle 0."""
    subpixel_patches: bool = True
    """Centre orientation and descriptor on the point, not on the sample nearest to it."""
    orientation_spacing: float = 0.0
    """Of the samples that the histogram of directions looks at, in scales; 0 for all."""
    descriptor_spacing: float = 0.0
    """Of the samples that the descriptor looks at, in scales; 0 for all. Lowe's 4x4 samples
    in each of 4x4 subregions are 0.75 apart."""
    window_sigma: float = 0.5
    """Of the descriptor's Gaussian window, in sides of the descriptor."""
    descriptor: Literal["sift", "root"] = "sift"
    """"root" L1-normalizes and takes the square root (RootSIFT)."""
    max_keypoints: int = 0
    """Keep this many of the strongest; 0 keeps all."""

    def __post_init__(self) -> None:
        require(self.first_octave in (-1, 0), "first_octave", "-1 or 0", self.first_octave)
        require(self.octaves >= 0, "octaves", "0 or more", self.octaves)
        require(1 <= self.intervals <= 16, "intervals", "1 to 16", self.intervals)
        require(0.5 <= self.base_sigma <= 8, "base_sigma", "0.5 to 8", self.base_sigma)
        require(0 <= self.camera_sigma <= 4, "camera_sigma", "0 to 4", self.camera_sigma)
        require(1 <= self.kernel_radius <= 8, "kernel_radius", "1 to 8", self.kernel_radius)
        require(
            self.grid in ("centered", "shifted"),
            "grid",
            "'centered' or 'shifted'",
            self.grid,
        )
        require(self.border >= 2, "border", "2 or more", self.border)
        require(self.fit in ("quartic", "quadratic"), "fit", "'quartic' or 'quadratic'", self.fit)
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
        require(
            self.voting in ("linear", "nearest"), "voting", "'linear' or 'nearest'", self.voting
        )
        require(self.smoothing >= 0, "smoothing", "0 or more", self.smoothing)
        require(self.max_orientations >= 0, "max_orientations", "0 or more", self.max_orientations)
        for name in ("orientation_spacing", "descriptor_spacing"):
            require(0 <= getattr(self, name) <= 3, name, "0 to 3", getattr(self, name))
        require(self.window_sigma > 0, "window_sigma", "over 0", self.window_sigma)
        require(
            self.descriptor in ("sift", "root"), "descriptor", "'sift' or 'root'", self.descriptor
        )
        require(self.max_keypoints >= 0, "max_keypoints", "0 or more", self.max_keypoints)

    @classmethod
    def lowe2004(cls) -> "SiftConfig":
        """Lowe (2004): the image doubled, all octaves, |D| over 0.03.

        The article leaves the sharing of gradients and the grid open; the place is refined
        beyond its quadratic (see `fit`).
        """
        return cls()

    @classmethod
    def kootstra2010(cls) -> "SiftConfig":
        """Kootstra (2010): B.1-B.12 to the letter, three octaves from the image itself.

        The descriptor's window is wide; what the source leaves open is as in the default.
        """
        return cls(
            first_octave=0,
            octaves=3,
            kernel_radius=3.0,
            fit="quadratic",
            contrast_threshold=0.02,
            window_sigma=1.5,
        )

    @classmethod
    def opencv(cls) -> "SiftConfig":
        """As `cv2.SIFT_create()`, its shift by a quarter pixel included."""
        return cls(
            grid="shifted",
            border=5,
            fit="quadratic",
            contrast_threshold=0.04 / 3,
            candidate_fraction=3 / (0.04 * 255),  # OpenCV rounds down to one grey level
            voting="nearest",
            smoothing=2,
            subpixel_patches=False,
        )

    @classmethod
    def colmap(cls) -> "SiftConfig":
        """COLMAP's settings of VLFeat; of more than 8192 points the strongest are kept."""
        return cls(
            octaves=4,
            contrast_threshold=0.02 / 3,
            candidate_fraction=0.8,
            smoothing=8,  # the variance of VLFeat's six passes of [1 1 1] / 3
            max_orientations=2,
            descriptor="root",
            max_keypoints=8192,
        )


class Sift:
    """SIFT as a callable: `Sift(config)(image)` gives `Keypoints`.

    Args:
        config: what to do.
        threads: how many work at a time; 0 for one to a core. The points do not depend on it.
    """

    def __init__(self, config: SiftConfig | None = None, threads: int = 0) -> None:
        require(threads >= 0, "threads", "0 or more", threads)
        self.config = SiftConfig.lowe2004() if config is None else config
        self.threads = threads or os.cpu_count() or 1
        self._spare = [Workspace()]  # as many as calls ran at a time

    def __repr__(self) -> str:
        return f"Sift({self.config})"

    def __call__(
        self, image: Image, mask: BoolArray | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect interest points and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            mask: (H, W), points are kept where it is not zero; None keeps all.
            describe: whether descriptors are wanted.

        Returns:
            The points, strongest first; of equally strong ones the upper left first. The
            response is |D| at the extremum. An image of a few pixels has none.

        Raises:
            ImageError: not an image, empty, not finite, outside [0, 1], or the mask does
                not fit.

        Source: Lowe (2004); Kootstra (2010), equations B.1-B.12.
        """
        gray = as_gray(image)  # (H, W)
        if mask is not None and mask.shape != gray.shape:
            raise ImageError(f"mask: expected the image's shape {gray.shape}, found {mask.shape}")
        workspace = self._spare.pop() if self._spare else Workspace()
        try:
            return self._detect(gray, mask, describe, workspace)
        finally:
            self._spare.append(workspace)

    def _detect(
        self, gray: Float32Array, mask: BoolArray | None, describe: bool, workspace: Workspace
    ) -> Keypoints:
        config = self.config
        space = gaussian_scale_space(
            gray,
            first_octave=config.first_octave,
            octaves=config.octaves,
            intervals=config.intervals,
            base_sigma=config.base_sigma,
            camera_sigma=config.camera_sigma,
            kernel_radius=config.kernel_radius,
            grid=config.grid,
            smallest_side=max(SMALLEST_SIDE, 2 * config.border + 1),
            workspace=workspace,
        )  # B.1-B.2
        found = [Points.none()]
        for number, octave in enumerate(space.octaves):
            differences = difference_of_gaussians(octave, workspace)  # B.3
            points = detect(differences, number, config, self.threads)  # B.4-B.10
            if mask is not None:
                points = points.inside(mask, space)
            if not config.upright:
                points = orient(octave, points, config, self.threads)  # B.11-B.12
            found.append(points)
        points = strongest(concatenate(found), space, config.max_keypoints)
        descriptors = describe_all(space, points, config, self.threads) if describe else None
        return keypoints(points, space, config.first_octave, descriptors)


class Points(NamedTuple):
    """Interest points on their way: each is measured in samples of its octave."""

    octave: IntArray
    """(n,) number of the octave in the scale space, from 0."""
    plane: IntArray
    """(n,) the plane of that octave that is nearest in scale."""
    xy: Float32Array
    """(n, 2)."""
    sigma: Float32Array
    """(n,)."""
    angle: Float32Array
    """(n,) in radians from x towards y; 0 until it is known."""
    response: Float32Array
    """(n,) |D|."""

    @classmethod
    def none(cls) -> "Points":
        """No points at all."""
        number, real = np.zeros(0, np.int64), np.zeros(0, np.float32)
        return cls(number, number, np.zeros((0, 2), np.float32), real, real, real)

    @property
    def frames(self) -> Frames:
        """Plane, place and scale."""
        return Frames(self.plane, self.xy, self.sigma)

    def take(self, index: npt.NDArray[Any]) -> "Points":
        """Those that a mask or an index array names."""
        return Points(*(field[index] for field in self))

    def in_image(self, space: ScaleSpace) -> tuple[FloatArray, FloatArray]:
        """(n, 2) places and (n,) scales in pixels of the image."""
        spacing = space.spacing[self.octave]
        return space.origin[self.octave] + self.xy * spacing[:, None], self.sigma * spacing

    def inside(self, mask: BoolArray, space: ScaleSpace) -> "Points":
        """Those whose nearest pixel is set in an (H, W) mask."""
        xy, _ = self.in_image(space)
        column, row = np.rint(xy).astype(np.int64).T
        height, width = mask.shape
        return self.take(mask[row.clip(0, height - 1), column.clip(0, width - 1)] != 0)


def concatenate(parts: list[Points]) -> Points:
    """All points in one."""
    return Points(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def detect(dog: Float32Array, octave: int, config: SiftConfig, threads: int = 1) -> Points:
    """The points of an octave's (s + 2, h, w) differences (B.4-B.10)."""
    found = find_extrema(
        dog,
        border=config.border,
        candidate_threshold=config.candidate_fraction * config.contrast_threshold,
        contrast_threshold=config.contrast_threshold,
        edge_ratio=config.edge_ratio,
        quartic=config.fit == "quartic",
        threads=threads,
    )
    sigma = config.base_sigma * 2 ** (found.scale / config.intervals)
    return Points(
        octave=np.full(len(found.plane), octave),
        plane=found.plane,
        xy=found.xy,
        sigma=sigma.astype(np.float32),
        angle=np.zeros(len(found.plane), np.float32),
        response=np.abs(found.value),
    )


def orient(octave: Float32Array, points: Points, config: SiftConfig, threads: int = 1) -> Points:
    """Each point once for every strong direction of its gradients (B.11-B.12)."""
    index, angle, height = orientations(
        octave,
        points.frames,
        linear=config.voting == "linear",
        smoothing=config.smoothing,
        subpixel=config.subpixel_patches,
        spacing=config.orientation_spacing,
        threads=threads,
    )
    if config.max_orientations:
        order = np.lexsort((-height, index))
        rank = np.arange(len(index)) - np.searchsorted(index, index)
        chosen = np.sort(order[rank < config.max_orientations])
        index, angle = index[chosen], angle[chosen]
    return points.take(index)._replace(angle=angle)


def strongest(points: Points, space: ScaleSpace, most: int) -> Points:
    """Points by falling response, then by row, column, size and angle; `most` of them unless 0."""
    xy, sigma = points.in_image(space)
    order = np.lexsort((points.angle, sigma, xy[:, 0], xy[:, 1], -points.response))
    return points.take(order[:most] if most else order)


def describe_all(
    space: ScaleSpace, points: Points, config: SiftConfig, threads: int = 1
) -> ByteArray:
    """(n, 128) descriptors, octave by octave."""
    descriptors = np.empty((len(points.octave), 128), np.uint8)
    for number, octave in enumerate(space.octaves):
        here = points.octave == number
        part = points.take(here)
        descriptors[here] = describe_frames(
            octave,
            part.frames,
            part.angle,
            window_sigma=config.window_sigma,
            subpixel=config.subpixel_patches,
            root=config.descriptor == "root",
            spacing=config.descriptor_spacing,
            threads=threads,
        )
    return descriptors


def keypoints(
    points: Points, space: ScaleSpace, first_octave: int, descriptors: ByteArray | None
) -> Keypoints:
    """Points in pixels of the image."""
    xy, sigma = points.in_image(space)
    return Keypoints(
        xy=xy.astype(np.float32),
        size=(2 * sigma).astype(np.float32),
        angle=points.angle,
        response=points.response,
        octave=(points.octave + first_octave).astype(np.int32),
        descriptors=descriptors,
    )
