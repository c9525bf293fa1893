"""Interest points in a scale space, on their way from an octave to the caller.

What SIFT and MUST share: they differ in what they look for in an octave.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, require
from saccade.keypoints.descriptor import Frames, describe_frames, orientations
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.given import locate
from saccade.keypoints.selection import spread_out
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale_space import SMALLEST_SIDE, ScaleSpace, Workspace, gaussian_scale_space
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints

BoolArray: TypeAlias = npt.NDArray[np.bool_]
ByteArray: TypeAlias = npt.NDArray[np.uint8]


class Workbench:
    """How many work at a time, and memory for as many calls as ran at a time.

    Args:
        threads: 0 for one to a core.
    """

    def __init__(self, threads: int) -> None:
        require(threads >= 0, "threads", "0 or more", threads)
        self.threads = threads or os.cpu_count() or 1
        self._spare = [Workspace()]

    @contextmanager
    def workspace(self) -> Iterator[Workspace]:
        """Memory that no other call uses meanwhile; the next has it again."""
        try:
            workspace = self._spare.pop()
        except IndexError:  # not asked before: another thread may take the last meanwhile
            workspace = Workspace()
        try:
            yield workspace
        finally:
            self._spare.append(workspace)


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
    """(n,) its amount: |D| of SIFT, the symmetry of MUST."""

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


Search: TypeAlias = Callable[[Float32Array, int, float], Points]
"""Finds the points of an octave in its (s + 3, h, w) planes, from its number and spacing."""


def interest_points(
    gray: Float32Array,
    mask: npt.ArrayLike | None,
    config: SiftConfig,
    search: Search,
    describe: bool,
    workspace: Workspace,
    threads: int,
) -> Keypoints:
    """Search every octave of an image; direct, choose and describe what is found.

    Args:
        gray: (H, W).
        mask: (H, W), points are kept where it is not zero; None keeps all.
        config: of the scale space, the directions, the choice and the descriptors.
        search: finds the points of an octave.
        describe: whether descriptors are wanted.
        workspace: where the octaves are made.
        threads: how many work at a time.

    Raises:
        ImageError: the mask does not fit.
    """
    wanted = wanted_pixels(mask, gray.shape)
    searched = max(SMALLEST_SIDE, 2 * config.border + 1)
    space = scale_space_of(gray, config, searched, workspace, threads)  # B.2-B.3
    found = [Points.none()]
    for number, octave in enumerate(space.octaves):
        points = search(octave, number, float(space.spacing[number]))  # B.1, B.4-B.10
        if wanted is not None:
            points = points.inside(wanted, space)
        if not config.upright:
            points = orient(octave, points, config, threads)  # B.11-B.12
        found.append(points)
    points = concatenate(found)
    order = strongest(points, space, config.max_keypoints, config.spread)
    return handed_out(points, order, space, config, describe, threads)


def detect(
    responses: Float32Array, octave: int, config: SiftConfig, threshold: float, threads: int = 1
) -> Points:
    """The extrema of an octave's (s + 2, h, w) responses that exceed a threshold (B.4-B.10)."""
    found = find_extrema(
        responses,
        border=config.border,
        candidate_threshold=config.candidate_fraction * threshold,
        contrast_threshold=threshold,
        edge_ratio=config.edge_ratio,
        lagrange=config.fit == "lagrange",
        neighbors=config.neighbors,
        threads=threads,
    )
    level = found.scale + config.extra_intervals * (octave > 0)
    sigma = config.density * config.base_sigma * 2 ** (level / config.intervals)
    return Points(
        octave=np.full(len(found.plane), octave),
        plane=np.rint(found.scale).astype(np.int64),  # the refinement may have left the seed's
        xy=found.xy,
        sigma=sigma.astype(np.float32),
        angle=np.zeros(len(found.plane), np.float32),
        response=np.abs(found.value),
    )


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


def concatenate(parts: list[Points]) -> Points:
    """All points in one."""
    return Points(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


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
        descriptors[place[here]] = descriptors_of(octave, points.take(here), config, threads)
    return descriptors


def descriptors_of(
    octave: Float32Array, points: Points, config: SiftConfig, threads: int = 1
) -> ByteArray:
    """(n, 128) descriptors of the points of one octave."""
    return describe_frames(
        octave,
        points.frames,
        points.angle,
        window_sigma=config.window_sigma,
        subpixel=config.subpixel_patches,
        root=config.descriptor == "root",
        spacing=config.descriptor_spacing,
        threads=threads,
    )


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
