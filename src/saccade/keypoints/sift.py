"""The Scale-Invariant Feature Transform: the detector of appendix B.1."""

import os
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, require
from saccade.image import as_gray
from saccade.keypoints.descriptor import Frames, describe_frames, orientations
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.sift_config import SiftConfig
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


class Sift:
    """SIFT as a callable: `Sift(config)(image)` gives `Keypoints`.

    Args:
        config: what to do.
        threads: how many work at a time; 0 for one to a core. The points do not depend on
            it. The Gaussians are OpenCV's, which asks `cv2.setNumThreads`.

    A detector keeps the memory that its largest image took, for the next.
    """

    def __init__(self, config: SiftConfig | None = None, threads: int = 0) -> None:
        require(threads >= 0, "threads", "0 or more", threads)
        self.config = SiftConfig.recommended() if config is None else config
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
            density=config.density,
            camera_sigma=config.camera_sigma,
            kernel_radius=config.kernel_radius,
            grid=config.grid,
            smallest_side=max(SMALLEST_SIDE, 2 * config.border + 1),
            workspace=workspace,
            threads=self.threads,
        )  # B.1-B.2
        found = [Points.none()]
        for number, octave in enumerate(space.octaves):
            differences = difference_of_gaussians(octave, workspace, self.threads)  # B.3
            points = detect(differences, number, config, self.threads)  # B.4-B.10
            if mask is not None:
                points = points.inside(mask, space)
            if not config.upright:
                points = orient(octave, points, config, self.threads)  # B.11-B.12
            found.append(points)
        points = concatenate(found)
        order = strongest(points, space, config.max_keypoints)
        descriptors = None
        if describe:
            descriptors = describe_all(space, points, order, config, self.threads)
        return keypoints(points.take(order), space, config.first_octave, descriptors)


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
        lagrange=config.fit == "lagrange",
        threads=threads,
    )
    sigma = config.density * config.base_sigma * 2 ** (found.scale / config.intervals)
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


def strongest(points: Points, space: ScaleSpace, most: int) -> IntArray:
    """Order by falling response, then row, column, size, angle; `most` of the points unless 0."""
    xy, sigma = points.in_image(space)
    order = np.lexsort((points.angle, sigma, xy[:, 0], xy[:, 1], -points.response))
    return order[:most] if most else order


def describe_all(
    space: ScaleSpace, points: Points, order: IntArray, config: SiftConfig, threads: int = 1
) -> ByteArray:
    """(n, 128) descriptors of the points that `order` names.

    They are made as the points lie in the planes: neighbors share what is in the cache.
    """
    place = np.empty(len(points.octave), np.int64)
    place[order] = np.arange(len(order))
    wanted = np.zeros(len(place), np.bool_)
    wanted[order] = True
    descriptors = np.empty((len(order), 128), np.uint8)
    for number, octave in enumerate(space.octaves):
        here = np.flatnonzero(wanted & (points.octave == number))
        part = points.take(here)
        descriptors[place[here]] = describe_frames(
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
