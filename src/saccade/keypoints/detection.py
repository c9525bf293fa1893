"""Keypoint detection in a scale space: the loop over octaves that SIFT and MUST share."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.keypoints.descriptor import describe_points
from saccade.keypoints.extrema import find_extrema
from saccade.keypoints.orientation import assign_orientations
from saccade.keypoints.scale_space_points import Points, locate
from saccade.keypoints.selection import spread_out
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale_space import MIN_SIDE, ScaleSpace, gaussian_scale_space
from saccade.types import Float32Array, IntArray, Keypoints
from saccade.workspace import Threads, Workspace

Response: TypeAlias = Callable[[Float32Array, float], Float32Array]
"""The (s + 2, h, w) response to the (s + 3, h, w) planes of an octave, from its spacing."""


def detect_keypoints(
    gray: Float32Array,
    mask: npt.ArrayLike | None,
    config: SiftConfig,
    response: Response,
    threshold: float,
    with_descriptors: bool,
    workspace: Workspace,
) -> Keypoints:
    """Detect the extrema of a response in scale space, assign orientations, select and describe.

    Args:
        gray: (H, W).
        mask: (H, W), keypoints are kept where it is not zero; None keeps all.
        config: of the scale space, fit, orientations, selection and descriptors.
        response: to an octave.
        threshold: smallest absolute response at an extremum.
        with_descriptors: whether to describe them.
        workspace: memory of the octaves, and threads.

    Raises:
        ImageError: the mask does not have the image's shape.
    """
    inside = None if mask is None else np.asarray(mask) != 0
    if inside is not None and inside.shape != gray.shape:
        raise ImageError(f"mask: expected the image's shape {gray.shape}, found {inside.shape}")
    min_side, threads = max(MIN_SIDE, 2 * config.border + 1), workspace.threads
    space = gaussian_scale_space(gray, config, min_side=min_side, workspace=workspace)  # B.2-B.3
    octaves = enumerate(zip(space.octaves, space.spacing.tolist(), strict=True))
    points = Points.concatenate(
        scale_space_extrema(response(octave, spacing), number, config, threshold, threads)
        for number, (octave, spacing) in octaves  # B.1, B.4-B.10
    )
    if inside is not None:
        points = points.inside(inside, space)
    if not config.upright:
        points = oriented(points, space, config, threads)  # B.11-B.12
    points = points.take(strongest(points, space, config.max_keypoints, config.spread))
    keypoints = points.keypoints(space, config.first_octave)
    if not with_descriptors:
        return keypoints
    # From what is returned, so that it can be described again to the same bytes.
    points = locate(keypoints, space, config)
    return replace(keypoints, descriptors=describe_points(space.octaves, points, config, threads))


def scale_space_extrema(
    responses: Float32Array, octave: int, config: SiftConfig, threshold: float, threads: Threads
) -> Points:
    """The extrema of an octave's (s + 2, h, w) responses that exceed a threshold (B.4-B.10)."""
    found = find_extrema(responses, config, threshold, threads)
    level = found.scale + config.extra_intervals * (octave > 0)
    return Points(
        octave=np.full(len(found.scale), octave),
        # The refinement may have left the plane of the candidate.
        plane=np.rint(found.scale).astype(np.int64).clip(0, len(responses)),
        xy=found.xy,
        sigma=config.sigma(level).astype(np.float32),
        angle=np.zeros(len(found.scale), np.float32),
        response=np.abs(found.value),
    )


def oriented(points: Points, space: ScaleSpace, config: SiftConfig, threads: Threads) -> Points:
    """Each point once for each of its dominant orientations (B.11-B.12)."""
    limit = config.max_orientations
    index, angle = assign_orientations(space.octaves, points, config, limit, threads)
    return points.take(index)._replace(angle=angle)


def strongest(
    points: Points, space: ScaleSpace, max_points: int | None = None, spread: bool = False
) -> IntArray:
    """Indices of the points to keep, by falling response, then row, column, size and angle."""
    xy, sigma = points.image_coordinates(space)
    order = np.lexsort((points.angle, sigma, xy[:, 0], xy[:, 1], -points.response))
    if spread and max_points is not None:
        order = order[spread_out(xy[order], points.response[order], max_points)]
    return order[:max_points]
