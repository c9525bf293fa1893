"""Keypoints from the responses of a scale space, shared by SIFT, MUST and SymRoID."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from saccade.keypoints._extrema_kernels import fill_suppression_radii
from saccade.keypoints.descriptor import assign_orientations, describe_points
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.scale_space_points import Points, locate
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.scale_space import ScaleSpace
from saccade.scale.workspace import Workspace
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints

KEYPOINTS_PER_SCALE = 50
"""Ratio of `max_keypoints` to the saturation scale of the ranking in pixels, chosen by the matches
and homographies of known pairs at 100 to 4000 keypoints."""
ROBUSTNESS = 0.9
"""Largest ratio of the response of a point to the response of one that suppresses it."""


def find_points(
    responses: Iterable[tuple[int, Float32Array]],
    config: SiftConfig,
    threshold: float,
    workspace: Workspace,
) -> Points:
    """The extrema of the responses of each octave that exceed a threshold (B.4-B.10).

    Args:
        responses: number of an octave and its (s + 2, h, w) responses, in any order; the next
            octave may overwrite these.
        config: candidates and fit.
        threshold: smallest absolute response.
        workspace: its threads share the rows.
    """

    def points_in(octave: int, responses: Float32Array) -> Points:
        found = find_extrema(responses, config, threshold, workspace)
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

    return Points.concatenate(points_in(*each) for each in responses)


def to_keypoints(
    points: Points,
    space: ScaleSpace,
    config: SiftConfig,
    workspace: Workspace,
    *,
    describe: bool = True,
) -> Keypoints:
    """Keypoints of points, one for each orientation, strongest first, perhaps described."""
    if not config.upright:
        points, _ = oriented(points, space, config, workspace)  # B.11-B.12
    points = points.take(slice(config.max_keypoints))
    points = points.take(by_strength(points, space, config))
    keypoints = points.keypoints(space, config.first_octave)
    if not describe:
        return keypoints
    # Keypoints in float32 are located again, so that `describe` gives the same bytes.
    points = locate(keypoints, space, config)
    return replace(keypoints, descriptors=describe_points(space.octaves, points, config, workspace))


def oriented(
    points: Points, space: ScaleSpace, config: SiftConfig, workspace: Workspace
) -> tuple[Points, IntArray]:
    """Each point once for each of its dominant orientations, and (m,) its index (B.11-B.12)."""
    limit = config.max_orientations
    index, angle = assign_orientations(space.octaves, points, config, limit, workspace)
    order = np.lexsort((angle, index))
    index, angle = index[order], angle[order]
    return points.take(index)._replace(angle=angle), index


def by_strength(points: Points, space: ScaleSpace, config: SiftConfig) -> IntArray:
    """Indices of the points by falling strength, then row, column, size and angle."""
    falling = -strength(points, space, config)
    order = np.argsort(falling, kind="stable")
    equal = falling[order][1:] == falling[order][:-1]
    tied = np.flatnonzero(np.r_[equal, False] | np.r_[False, equal])
    some = points.take(order[tied])  # all keys for equal strengths alone, in half of the time
    xy, sigma = some.image_coordinates(space)
    order[tied] = order[
        tied[np.lexsort((some.angle, sigma, xy[:, 0], xy[:, 1], falling[order[tied]]))]
    ]
    return order


def strength(points: Points, space: ScaleSpace, config: SiftConfig) -> Float32Array:
    """(n,) strengths of points; see `SiftConfig.ranking`."""
    if config.ranking == "response":
        return points.response
    sigma = points.image_coordinates(space)[1]
    if config.max_keypoints is not None:
        sigma = 1 / np.hypot(1 / sigma, KEYPOINTS_PER_SCALE / config.max_keypoints)
    return (points.response * sigma).astype(np.float32)


def preferred(points: Points, space: ScaleSpace, config: SiftConfig) -> IntArray:
    """Indices of at most `max_keypoints` points, the strongest or the most isolated first."""
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
    radii = np.empty(len(xy))
    fill_suppression_radii(xy, stronger, radii)
    return np.argsort(-radii, kind="stable")
