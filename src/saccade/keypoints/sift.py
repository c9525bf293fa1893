"""The Scale-Invariant Feature Transform: the detector of appendix B.1."""

import os
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, require
from saccade.image import as_gray
from saccade.keypoints.descriptor import Frames, describe_frames, orientations
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.given import check_given, locate
from saccade.keypoints.selection import spread_out
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
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
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
        wanted = wanted_pixels(mask, gray.shape)
        workspace = self._spare.pop() if self._spare else Workspace()
        try:
            return self._detect(gray, wanted, describe, workspace)
        finally:
            self._spare.append(workspace)

    def describe(self, image: Image, keypoints: Keypoints, *, orient: bool = False) -> Keypoints:
        """Describe points from anywhere: another detector, a grid, an earlier image.

        Points that this detector found are described as they were, byte for byte.

        Args:
            image: as for detection.
            keypoints: n points between the outer edges of the image; see `Keypoints.at` and
                `saccade.exchange`. Their size says how much of the image is described and
                how blurred; a descriptor is 12 scales wide, that is 6 sizes, and what lies
                outside the image counts for nothing. Their own descriptors are not used.
            orient: whether to find the angle. The default describes each point along the
                angle it has. With it a point comes once for each strong direction, or not
                at all where the image is flat; in an upright configuration angles are 0.

        Returns:
            The points in the order in which they were given, with descriptors.

        Raises:
            KeypointsError: a place outside the image, a size that is not over 0, an angle
                that is not finite, or fields of different lengths.
            ImageError: not an image, or too small an image.
        """
        gray, config = as_gray(image), self.config
        given = check_given(keypoints, gray.shape)
        workspace = self._spare.pop() if self._spare else Workspace()
        try:
            space = scale_space_of(gray, config, SMALLEST_SIDE, workspace, self.threads)
            if len(given) and not space.octaves:
                height, width = gray.shape
                raise ImageError(
                    f"image: expected at least {SMALLEST_SIDE} samples a side in the first octave "
                    f"to describe points, found an image of {width} x {height} px"
                )
            points = Points.at(given, space, config)
            if orient and config.upright:
                points = points._replace(angle=np.zeros_like(points.angle))
            elif orient:
                index, angle = all_directions(space, points, config, self.threads)
                given, points = given[index], points.take(index)._replace(angle=angle)
            order = np.arange(len(given))
            descriptors = describe_all(space, points, order, config, self.threads)
            return replace(given, angle=points.angle, descriptors=descriptors)
        finally:
            self._spare.append(workspace)

    def _detect(
        self, gray: Float32Array, mask: BoolArray | None, describe: bool, workspace: Workspace
    ) -> Keypoints:
        config = self.config
        searched = max(SMALLEST_SIDE, 2 * config.border + 1)
        space = scale_space_of(gray, config, searched, workspace, self.threads)  # B.1-B.2
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
        order = strongest(points, space, config.max_keypoints, config.spread)
        return handed_out(points, order, space, config, describe, self.threads)


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

    @classmethod
    def at(cls, keypoints: Keypoints, space: ScaleSpace, config: SiftConfig) -> "Points":
        """Points of the image, found by whomever."""
        octave, plane, xy, sigma = locate(keypoints, space, config)
        return cls(octave, plane, xy, sigma, keypoints.angle, keypoints.response)

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
        return self.take(mask[row.clip(0, height - 1), column.clip(0, width - 1)])


def wanted_pixels(mask: npt.ArrayLike | None, shape: tuple[int, ...]) -> BoolArray | None:
    """Where a mask is not zero; None where there is none.

    Raises:
        ImageError: it has not the (H, W) `shape` of the image.
    """
    wanted = None if mask is None else np.asarray(mask) != 0
    if wanted is not None and wanted.shape != shape:
        raise ImageError(f"mask: expected the image's shape {shape}, found {wanted.shape}")
    return wanted


def scale_space_of(
    gray: Float32Array, config: SiftConfig, smallest_side: int, workspace: Workspace, threads: int
) -> ScaleSpace:
    """The scale space that a configuration asks for."""
    return gaussian_scale_space(
        gray,
        first_octave=config.first_octave,
        octaves=config.octaves,
        intervals=config.intervals,
        extra_intervals=config.extra_intervals,
        base_sigma=config.base_sigma,
        density=config.density,
        camera_sigma=config.camera_sigma,
        kernel_radius=config.kernel_radius,
        grid=config.grid,
        smallest_side=smallest_side,
        workspace=workspace,
        threads=threads,
    )


def handed_out(
    points: Points,
    order: npt.NDArray[np.int64],
    space: ScaleSpace,
    config: SiftConfig,
    describe: bool,
    threads: int,
) -> Keypoints:
    """Points as the caller gets them, in `order`, described if that is wanted."""
    kept = keypoints(points, space, config.first_octave)
    if not describe:
        return kept[order]
    # From what is handed out, so that it can be described again to the same bytes.
    points = Points.at(kept, space, config)
    descriptors = describe_all(space, points, order, config, threads)
    return replace(kept[order], descriptors=descriptors)


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
        neighbors=config.neighbors,
        threads=threads,
    )
    level = found.scale + config.first_level(octave) - octave * config.intervals
    sigma = config.density * config.base_sigma * 2 ** (level / config.intervals)
    return Points(
        octave=np.full(len(found.plane), octave),
        plane=np.rint(found.scale).astype(np.int64),  # the refinement may have left the seed's
        xy=found.xy,
        sigma=sigma.astype(np.float32),
        angle=np.zeros(len(found.plane), np.float32),
        response=np.abs(found.value),
    )


def orient(octave: Float32Array, points: Points, config: SiftConfig, threads: int = 1) -> Points:
    """Each point once for every strong direction of its gradients (B.11-B.12)."""
    index, angle = directions(octave, points, config, threads)
    return points.take(index)._replace(angle=angle)


def directions(
    octave: Float32Array, points: Points, config: SiftConfig, threads: int = 1
) -> tuple[IntArray, Float32Array]:
    """(m,) index of the point, ascending, and (m,) angle, for the points of one octave."""
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
    return index, angle


def all_directions(
    space: ScaleSpace, points: Points, config: SiftConfig, threads: int = 1
) -> tuple[IntArray, Float32Array]:
    """As `directions`, for the points of all octaves."""
    indices, angles = [np.zeros(0, np.int64)], [np.zeros(0, np.float32)]
    for number, octave in enumerate(space.octaves):
        here = np.flatnonzero(points.octave == number)
        index, angle = directions(octave, points.take(here), config, threads)
        indices.append(here[index])
        angles.append(angle)
    index = np.concatenate(indices)
    order = np.argsort(index, kind="stable")
    return index[order], np.concatenate(angles)[order]


def strongest(points: Points, space: ScaleSpace, most: int, spread: bool = False) -> IntArray:
    """Order by falling response, then row, column, size, angle; `most` of the points unless 0."""
    xy, sigma = points.in_image(space)
    order = np.lexsort((points.angle, sigma, xy[:, 0], xy[:, 1], -points.response))
    if most and spread:
        order = order[spread_out(xy[order], points.response[order], most)]
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


def keypoints(points: Points, space: ScaleSpace, first_octave: int) -> Keypoints:
    """Points in pixels of the image."""
    xy, sigma = points.in_image(space)
    return Keypoints(
        xy=xy.astype(np.float32),
        size=(2 * sigma).astype(np.float32),
        angle=points.angle,
        response=points.response,
        octave=(points.octave + first_octave).astype(np.int32),
    )
