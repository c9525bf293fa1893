"""Frames of regions: maxima of symmetry over position and scale that do not overlap."""

import numpy as np

from saccade.keypoints.detection import by_strength
from saccade.keypoints.must import Must
from saccade.keypoints.scale_space_points import Points
from saccade.keypoints.symroid_config import SymRoidConfig
from saccade.scale.scale_space import ScaleSpace
from saccade.types import Float32Array, FloatArray, IntArray, Keypoints

SEPARATION = 2.0
"""Smallest distance of two regions, in scales of the coarser."""


class RegionFrames(Must):
    """Finds the frames of regions as MUST finds keypoints, none within a stronger one.

    Args:
        config: of the regions.
        threads: of a call; None for one per core. The regions do not depend on it.
    """

    def __init__(self, config: SymRoidConfig, threads: int | None = None) -> None:
        super().__init__(config.must(), threads)
        self._seed_threshold = config.seed_threshold

    def _preferred(self, points: Points, space: ScaleSpace) -> IntArray:
        order = by_strength(points, space, self._sift)
        response = points.response[order]
        order = order[response >= self._seed_threshold * response.max(initial=0)]
        xy, sigma = points.take(order).image_coordinates(space)
        kept: IntArray = order[separated(xy, sigma, self._sift.max_keypoints)]
        return kept


def separated(xy: FloatArray, sigma: FloatArray, count: int | None) -> IntArray:
    """Indices of the first points that are apart from those kept before them.

    Args:
        xy: (n, 2) positions.
        sigma: (n,) scales.
        count: number of points to keep; None for all.
    """
    kept: list[int] = []
    for i in range(len(xy)):
        if len(kept) == count:
            break
        reach = SEPARATION * np.maximum(sigma[kept], sigma[i])
        if (np.hypot(*(xy[kept] - xy[i]).T) >= reach).all():
            kept.append(i)
    return np.array(kept, np.int64)


def pair_boxes(keypoints: Keypoints, radius: float, shape: tuple[int, int]) -> Float32Array:
    """The boxes about the discs from which the symmetry of keypoints was summed.

    Args:
        keypoints: n keypoints.
        radius: of the disc, in scales.
        shape: (H, W) of the image.

    Returns:
        (n, 4) left, top, right and bottom in pixels, clipped to the image.
    """
    reach = radius * keypoints.size[:, None] / 2
    low = (keypoints.xy - reach).clip(-0.5)
    high = np.minimum(keypoints.xy + reach, np.array(shape[::-1]) - 0.5)
    return np.hstack([low, high]).astype(np.float32)
