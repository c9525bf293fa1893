"""SymRoID, the symmetrical region-of-interest detector: few regions, as landmarks."""

import numpy as np

from saccade.io.image import as_gray
from saccade.keypoints.detection import by_strength
from saccade.keypoints.must import Must
from saccade.keypoints.must_config import SymRoidConfig
from saccade.keypoints.scale_space_points import Points
from saccade.scale.scale_space import ScaleSpace
from saccade.types import Float32Array, FloatArray, Image, IntArray, Keypoints, Regions

SEPARATION = 2.0
"""Smallest distance of two regions, in scales of the coarser."""


class SymRoid:
    """SymRoID as a callable: `SymRoid(config)(image)` gives `Regions`.

    A region is a maximum of symmetry over position and scale, as MUST finds it, that lies within
    no stronger one.

    Args:
        config: selection and descriptor.
        threads: of a call; None for one per core. The regions do not depend on it.
    """

    def __init__(self, config: SymRoidConfig | None = None, threads: int | None = None) -> None:
        self.config = config or SymRoidConfig()
        self._frames = RegionFrames(self.config, threads)

    def __repr__(self) -> str:
        return f"SymRoid({self.config})"

    def __call__(self, image: Image) -> Regions:
        """Find regions of local symmetry and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].

        Returns:
            The regions, the most symmetric first, once for each orientation; none where nothing is
            symmetric, or where the image is too small.

        Raises:
            ImageError: not an image, empty, not finite, or outside [0, 1].

        Source: after Kootstra & Schomaker, *Using symmetrical regions of interest to improve
        visual SLAM* (IROS 2009), who describe the bounding boxes of regions grown in one map.
        """
        gray = as_gray(image)
        keypoints, radius = self._frames(gray), self._frames.config.radius
        return Regions(keypoints, pair_boxes(keypoints, radius, (gray.shape[0], gray.shape[1])))


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
