"""Keypoints in scale-space coordinates: octave, plane, and samples of that octave."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import KeypointsError
from saccade.scale.scale_space import ScaleSpace
from saccade.scale.scale_space_config import ScaleSpaceConfig
from saccade.scale.workspace import Workspace
from saccade.types import BoolArray, Float32Array, FloatArray, IntArray, Keypoints

POINTS_PER_BLOCK = 256
"""Number of points in the block of a thread."""

Index: TypeAlias = npt.NDArray[Any]


class Points(NamedTuple):
    """Keypoints measured in samples of their octaves."""

    octave: IntArray
    """(n,) number of the octave in the scale space, from 0."""
    plane: IntArray
    """(n,) plane of that octave that is nearest in scale."""
    xy: Float32Array
    """(n, 2)."""
    sigma: Float32Array
    """(n,) scale."""
    angle: Float32Array
    """(n,) in radians from x towards y; 0 until it is assigned."""
    response: Float32Array
    """(n,) absolute response: |D| of SIFT, the symmetry of MUST."""

    @classmethod
    def concatenate(cls, parts: Iterable["Points"]) -> "Points":
        """The points of all parts."""
        integer, real = np.zeros(0, np.int64), np.zeros(0, np.float32)
        none = cls(integer, integer, np.zeros((0, 2), np.float32), real, real, real)
        return cls._make(map(np.concatenate, zip(none, *parts, strict=True)))

    def take(self, index: Index | slice) -> "Points":
        """The points that a mask, an index array or a slice selects."""
        return Points._make(field[index] for field in self)

    def image_coordinates(self, space: ScaleSpace) -> tuple[FloatArray, FloatArray]:
        """(n, 2) positions and (n,) scales in pixels of the image."""
        spacing = space.spacing[self.octave]
        return space.origin[self.octave] + self.xy * spacing[:, None], self.sigma * spacing

    def inside(self, mask: BoolArray, space: ScaleSpace) -> "Points":
        """The points whose nearest pixel is set in an (H, W) mask."""
        xy, _ = self.image_coordinates(space)
        column, row = np.rint(xy).astype(np.int64).T
        height, width = mask.shape
        return self.take(mask[row.clip(0, height - 1), column.clip(0, width - 1)])

    def keypoints(self, space: ScaleSpace, first_octave: int) -> Keypoints:
        """The points in pixels of the image."""
        xy, sigma = self.image_coordinates(space)
        return Keypoints(
            xy=xy.astype(np.float32),
            size=(2 * sigma).astype(np.float32),
            angle=self.angle,
            response=self.response,
            octave=(self.octave + first_octave).astype(np.int32),
        )


def run_by_octave(
    work: Callable[[Float32Array, IntArray], None],
    octaves: Sequence[Float32Array],
    points: Points,
    workspace: Workspace,
) -> None:
    """Calls `work` for each octave with the indices of a block of its points."""
    for number, octave in enumerate(octaves):
        index = np.flatnonzero(points.octave == number)
        # Sorted by plane and row, for the cache.
        index = index[np.lexsort((points.xy[index, 1], points.plane[index]))]

        def run(block: slice, octave: Float32Array = octave, index: IntArray = index) -> None:
            work(octave, index[block])

        workspace.run_in_blocks(run, len(index), POINTS_PER_BLOCK)


def locate(keypoints: Keypoints, space: ScaleSpace, config: ScaleSpaceConfig) -> Points:
    """Octave, plane and coordinates of keypoints in a scale space.

    A keypoint's own octave is taken where its size belongs there, so that it is described where it
    was detected; else the octave that has its size between the first plane and the last but two,
    or the nearest there is.

    Args:
        keypoints: n keypoints, as `check_keypoints` returns them.
        space: scale space of their image; at least one octave if there are keypoints.
        config: of the scale space.
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
    last_plane = np.array([len(planes) - 1 for planes in space.octaves])[octave]
    plane = np.rint(level - config.first_level(octave)).clip(0, last_plane)
    spacing = space.spacing[octave]
    return Points(
        octave=octave,
        plane=plane.astype(np.int64),
        xy=((keypoints.xy - space.origin[octave]) / spacing[:, None]).astype(np.float32),
        sigma=(sigma / spacing).astype(np.float32),
        angle=keypoints.angle,
        response=keypoints.response,
    )


def check_keypoints(keypoints: Keypoints, shape: tuple[int, int]) -> Keypoints:
    """Keypoints that lie in an image, in their proper dtypes and without descriptors.

    Args:
        keypoints: n keypoints.
        shape: (H, W) of the image.

    Raises:
        KeypointsError: a position outside the image, a size that is not over 0, an angle that is
            not finite, or fields of different lengths.
    """
    (height, width), n = shape, len(keypoints)
    columns: dict[str, Any] = {}
    for name in ("xy", "size", "angle", "response", "octave"):
        found, expected = getattr(keypoints, name), (n, 2) if name == "xy" else (n,)
        if np.shape(found) != expected:
            raise KeypointsError(
                f"keypoints: {name}: expected shape {expected}, found {np.shape(found)}"
            )
        columns[name] = np.ascontiguousarray(found, "i4" if name == "octave" else "f4")
    checked = Keypoints(**columns)
    x, y = checked.xy.T
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    positive = (checked.size > 0) & np.isfinite(checked.size)
    for valid, expected_words, values in (
        (inside, f"a position in the image of {width} x {height} px", checked.xy),
        (positive, "a size over 0 px", checked.size),
        (np.isfinite(checked.angle), "a finite angle", checked.angle),
    ):
        if not valid.all():
            first = int(valid.argmin())
            raise KeypointsError(
                f"keypoints: expected {expected_words}, "
                f"found {values[first].tolist()} at point {first}"
            )
    return checked
