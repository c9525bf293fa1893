"""Interest points in a scale space, on their way from an octave to the caller.

What SIFT and MUST share: they differ in what they look for in an octave.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError, KeypointsError
from saccade.keypoints.descriptor import (
    Descriptors,
    Frames,
    describe_frames,
    describe_literally,
    orientations,
)
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.selection import spread_out
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale_space import SMALLEST_SIDE, ScaleSpace, Workspace, gaussian_scale_space
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints

BoolArray: TypeAlias = npt.NDArray[np.bool_]


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
    return to_keypoints(points, order, space, config, describe, threads)


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
        refit=config.fit != "once",
        neighbors=config.neighbors,
        threads=threads,
    )
    level = found.scale + config.extra_intervals * (octave > 0)
    sigma = config.density * config.base_sigma * 2 ** (level / config.intervals)
    return Points(
        octave=np.full(len(found.plane), octave),
        # The refinement may have left the plane of the seed.
        plane=np.rint(found.scale).astype(np.int64).clip(0, len(responses)),
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


def to_keypoints(
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
        every_bin=config.orientation_bins == "all",
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
) -> Descriptors:
    """(n, 128) descriptors of the points that `order` names.

    They are made as the points lie in the planes: neighbors share what is in the cache.
    """
    place = np.empty(len(points.octave), np.int64)
    place[order] = np.arange(len(order))
    wanted = np.zeros(len(place), np.bool_)
    wanted[order] = True
    descriptors: Descriptors = np.empty((len(order), 128), config.descriptor_dtype)
    for number, octave in enumerate(space.octaves):
        here = np.flatnonzero(wanted & (points.octave == number))
        descriptors[place[here]] = descriptors_of(octave, points.take(here), config, threads)
    return descriptors


def descriptors_of(
    octave: Float32Array, points: Points, config: SiftConfig, threads: int = 1
) -> Descriptors:
    """(n, 128) descriptors of the points of one octave."""
    as_float = config.descriptor_dtype == "float32"
    if config.descriptor == "kootstra2010":
        return describe_literally(octave, points.frames, points.angle, as_float)
    return describe_frames(
        octave,
        points.frames,
        points.angle,
        window_sigma=config.window_sigma,
        subpixel=config.subpixel_patches,
        root=config.descriptor == "root",
        spacing=config.descriptor_spacing,
        as_float=as_float,
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


def locate(
    keypoints: Keypoints, space: ScaleSpace, config: SiftConfig
) -> tuple[IntArray, IntArray, Float32Array, Float32Array]:
    """Octave, plane, place and scale of points, in samples of their octave.

    A point's own octave is taken where its size belongs there, so that what a detector found
    is looked at where it was found; else the octave that has its size between the first
    plane and the last but two, or the nearest there is.

    Args:
        keypoints: n points, as `check_keypoints` leaves them.
        space: what `config` makes of their image; at least one octave if there are points.
        config: of the detector.

    Returns:
        (n,) number of the octave in `space`; (n,) its plane that is nearest in scale; (n, 2)
        place and (n,) scale in its samples.
    """
    last, intervals = len(space.octaves) - 1, config.intervals
    sigma = keypoints.size.astype(np.float64) / 2
    level = intervals * (np.log2(sigma / config.base_sigma) - config.first_octave)
    own = keypoints.octave.astype(np.int64) - config.first_octave
    extra = config.extra_intervals * (own == 0)
    plane = np.rint(level - config.first_level(own))
    fits = (own >= 0) & (own <= last) & (plane >= 0) & (plane <= intervals + extra + 1)
    nearest = np.floor((level - config.extra_intervals - 0.5) / intervals)
    octave = np.where(fits, own, nearest.clip(0, last).astype(np.int64))
    extra = config.extra_intervals * (octave == 0)
    plane = np.rint(level - config.first_level(octave)).clip(0, intervals + extra + 2)
    plane = plane.astype(np.int64)
    spacing = space.spacing[octave]
    xy = (keypoints.xy - space.origin[octave]) / spacing[:, None]
    return octave, plane, xy.astype(np.float32), (sigma / spacing).astype(np.float32)


def check_keypoints(keypoints: Keypoints, shape: tuple[int, int]) -> Keypoints:
    """Points in their proper dtypes, without descriptors, if an image shows them.

    Args:
        keypoints: n points.
        shape: (H, W) of the image.

    Raises:
        KeypointsError: a place outside the image, a size that is not over 0, an angle that is
            not finite, or fields of different lengths.
    """
    height, width = shape
    n = len(keypoints)
    fields = {
        "xy": (keypoints.xy, (n, 2), np.float32),
        "size": (keypoints.size, (n,), np.float32),
        "angle": (keypoints.angle, (n,), np.float32),
        "response": (keypoints.response, (n,), np.float32),
        "octave": (keypoints.octave, (n,), np.int32),
    }
    found: dict[str, npt.NDArray[Any]] = {}
    for name, (values, expected, dtype) in fields.items():
        if np.shape(values) != expected:
            raise KeypointsError(
                f"keypoints: {name}: expected shape {expected}, found {np.shape(values)}"
            )
        found[name] = np.ascontiguousarray(values, dtype)
    x, y = found["xy"].T
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    _require_all(inside, f"a place in the image of {width} x {height} px", found["xy"])
    sized = (found["size"] > 0) & np.isfinite(found["size"])
    _require_all(sized, "a size over 0 px", found["size"])
    _require_all(np.isfinite(found["angle"]), "a finite angle", found["angle"])
    return Keypoints(**found)


def _require_all(holds: npt.NDArray[np.bool_], expected: str, found: npt.NDArray[Any]) -> None:
    if not holds.all():
        first = int(holds.argmin())
        raise KeypointsError(
            f"keypoints: expected {expected}, found {found[first].tolist()} at point {first}"
        )
