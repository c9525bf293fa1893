"""Keypoint detection in a scale space: the loop over octaves that SIFT and MUST share."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.io.image import as_gray
from saccade.keypoints.descriptor import assign_orientations, describe_points
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.scale_space_points import Points, locate
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.scale_space import MIN_SIDE, ScaleSpace, gaussian_scale_space
from saccade.scale.workspace import Threads, Workspace, WorkspacePool
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints

KEYPOINTS_PER_SCALE = 50
"""Keypoints asked for, for each pixel of the scale at which the ranking levels off: chosen by the
matches and homographies of known pairs at 100 to 4000 keypoints."""
ROBUSTNESS = 0.9
"""A point is suppressed only by those of which this fraction exceeds its own response."""
FIRST_NEIGHBORS = 8
"""Neighbors that are queried of every point."""


class ScaleSpaceDetector(ABC):
    """A detector of the extrema of a response in scale space.

    Args:
        config: settings of the detector.
        sift: those of its scale space, fit, orientations, selection and descriptors.
        threads: of a call; None for one per core. The keypoints do not depend on it. The
            Gaussians are OpenCV's, which asks `cv2.setNumThreads`.

    A detector keeps the memory that its largest image took, for the next.
    """

    further_planes = 2
    """Gaussian planes of an octave besides one for each interval."""

    def __init__(self, config: Any, sift: SiftConfig, threads: int | None) -> None:
        self.config = config
        self._sift = sift
        self._workspaces = WorkspacePool(threads)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.config})"

    @abstractmethod
    def _responses(
        self, gray: Float32Array, space: ScaleSpace, workspace: Workspace
    ) -> Iterator[tuple[int, Float32Array]]:
        """The responses whose extrema are keypoints: number of an octave, and its (s + 2, h, w).

        Octaves come in any order; what was given may change when the next is asked for.
        """

    def _preferred(self, points: Points, space: ScaleSpace) -> IntArray:
        """Indices of the points to keep, first those that are kept where there are too many."""
        return preferred(points, space, self._sift)

    def __call__(
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect keypoints and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            mask: (H, W), keypoints are kept where it is not zero; None keeps all.
            describe: whether to compute descriptors.

        Returns:
            The keypoints, strongest first; of equally strong ones the upper left first. The
            response is that at the extremum: |D| of SIFT, the symmetry of MUST; SIFT's strongest
            are chosen by it and the scale, see `SiftConfig.ranking`. A flat
            image, or one of a few pixels, has none.

        Raises:
            ImageError: not an image, empty, not finite, outside [0, 1], or the mask does
                not have its shape.
        """
        gray, config = as_gray(image), self._sift  # (H, W)
        inside = None if mask is None else np.asarray(mask) != 0
        if inside is not None and inside.shape != gray.shape:
            raise ImageError(f"mask: expected the image's shape {gray.shape}, found {inside.shape}")
        with self._workspaces.workspace() as workspace:
            threads = workspace.threads
            min_side = max(MIN_SIDE, 2 * config.border + 1)
            space = gaussian_scale_space(
                gray,
                config,
                min_side=min_side,
                further_planes=self.further_planes,
                workspace=workspace,
            )
            threshold = self.config.min_response
            points = Points.concatenate(
                scale_space_extrema(responses, octave, config, threshold, threads)
                for octave, responses in self._responses(gray, space, workspace)  # B.1, B.4-B.10
            )
            if inside is not None:
                points = points.inside(inside, space)
            points = points.take(self._preferred(points, space))
            if not config.upright:
                points, _ = oriented(points, space, config, threads)  # B.11-B.12
            points = points.take(slice(config.max_keypoints))
            points = points.take(by_strength(points, space, config))
            keypoints = points.keypoints(space, config.first_octave)
            if not describe:
                return keypoints
            # From what is returned, so that it can be described again to the same bytes.
            points = locate(keypoints, space, config)
            descriptors = describe_points(space.octaves, points, config, threads)
            return replace(keypoints, descriptors=descriptors)


def scale_space_extrema(
    responses: Float32Array, octave: int, config: SiftConfig, threshold: float, threads: Threads
) -> Points:
    """The extrema of an octave's (s + 2, h, w) responses that exceed a threshold (B.4-B.10)."""
    found = find_extrema(responses, config, threshold, threads)
    level = found.scale + config.extra_intervals * (octave > 0)
    return Points(
        octave=np.full(len(found.scale), octave),
        # The refinement may have left the plane of the candidate.
        plane=np.rint(found.scale).astype(np.int64).clip(0, len(responses) - 1),
        xy=found.xy,
        sigma=config.sigma(level).astype(np.float32),
        angle=np.zeros(len(found.scale), np.float32),
        response=np.abs(found.value),
    )


def oriented(
    points: Points, space: ScaleSpace, config: SiftConfig, threads: Threads
) -> tuple[Points, IntArray]:
    """Each point once for each of its dominant orientations, and (m,) its index (B.11-B.12)."""
    limit = config.max_orientations
    index, angle = assign_orientations(space.octaves, points, config, limit, threads)
    order = np.lexsort((angle, index))
    index, angle = index[order], angle[order]
    return points.take(index)._replace(angle=angle), index


def by_strength(points: Points, space: ScaleSpace, config: SiftConfig) -> IntArray:
    """Indices of the points by falling strength, then row, column, size and angle."""
    xy, sigma = points.image_coordinates(space)
    return np.lexsort((points.angle, sigma, xy[:, 0], xy[:, 1], -strength(points, space, config)))


def strength(points: Points, space: ScaleSpace, config: SiftConfig) -> Float32Array:
    """(n,) what points are ranked by, see `SiftConfig.ranking`."""
    if config.ranking == "response":
        return points.response
    sigma = points.image_coordinates(space)[1]
    if config.max_keypoints is not None:
        sigma = 1 / np.hypot(1 / sigma, KEYPOINTS_PER_SCALE / config.max_keypoints)
    return (points.response * sigma).astype(np.float32)


def preferred(points: Points, space: ScaleSpace, config: SiftConfig) -> IntArray:
    """Indices of at most `max_keypoints` points, first the strongest, or the most spread ones."""
    if config.max_keypoints is None:
        return np.arange(len(points.octave))
    order = by_strength(points, space, config)
    if config.spread:
        xy = points.image_coordinates(space)[0][order]
        order = order[spread_out(xy, strength(points, space, config)[order])]
    return order[: config.max_keypoints]


def spread_out(xy: FloatArray, response: Float32Array) -> IntArray:
    """Order of points by falling suppression radius.

    The radius of a point is its distance to the nearest point that is clearly stronger; of equal
    radii the lower index comes first. There is no grid: a mirrored or rotated image keeps
    the mirrored or rotated points.

    Args:
        xy: (n, 2) positions.
        response: (n,) in falling order.

    Returns:
        (n,) indices.

    Source: adaptive non-maximal suppression; Brown, Szeliski & Winder (2005), section 3.
    """
    stronger = np.searchsorted(-ROBUSTNESS * response, -response)  # (n,) number of stronger ones
    return np.argsort(-nearest_before(xy, stronger), kind="stable")


def nearest_before(xy: FloatArray, ends: IntArray) -> FloatArray:
    """Distance of each point to the nearest of the first `ends` points.

    More and more neighbors are queried of those points that have no such neighbor yet.

    Args:
        xy: (n, 2) positions.
        ends: (n,) at most n.

    Returns:
        (n,) distances; infinite where `ends` is 0.
    """
    from scipy.spatial import cKDTree  # half a second that few detections need

    n, neighbors = len(xy), FIRST_NEIGHBORS
    nearest, pending = np.full(n, np.inf), np.flatnonzero(ends)
    tree = cKDTree(xy)
    while len(pending):
        ranks = np.arange(1, min(neighbors, n) + 1)
        distance, index = map(np.asarray, tree.query(xy[pending], ranks))
        before = index < ends[pending, None]
        found, first = before.any(axis=1), before.argmax(axis=1)
        nearest[pending[found]] = distance[found, first[found]]
        pending, neighbors = pending[~found], 4 * neighbors
    return nearest
