"""SymRoID, the symmetrical region-of-interest detector: few regions, as landmarks."""

import numpy as np
import numpy.typing as npt

from saccade.io.preparation import gray_and_mask
from saccade.keypoints.detection import by_strength, to_keypoints
from saccade.keypoints.must import symmetric_points
from saccade.keypoints.must_config import SymRoidConfig
from saccade.scale.workspace import WorkspacePool
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
        self._workspaces = WorkspacePool(threads)

    def __repr__(self) -> str:
        return f"SymRoid({self.config})"

    def __call__(self, image: Image, mask: npt.ArrayLike | None = None) -> Regions:
        """Find regions of local symmetry and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            mask: (H, W), regions are kept whose center lies where it is not zero; None keeps all.

        Returns:
            The regions, the most symmetric first, once for each orientation; none where nothing is
            symmetric, or where the image is too small.

        Raises:
            ImageError: not an image, empty, not finite, outside [0, 1], or the mask does not have
                its shape.

        Source: after Kootstra & Schomaker, *Using symmetrical regions of interest to improve
        visual SLAM* (IROS 2009), who describe the bounding boxes of regions grown in one map.
        """
        (gray, inside), must = gray_and_mask(image, mask), self.config.must()  # (H, W) each
        sift = must.sift()
        with self._workspaces.workspace() as workspace:
            points, space = symmetric_points(gray, must, workspace)
            points = points.inside(inside, space)
            points = points.take(by_strength(points, space, sift))
            seed_response = self.config.seed_threshold * points.response.max(initial=0)
            points = points.take(points.response >= seed_response)
            xy, sigma = points.image_coordinates(space)
            points = points.take(separated(xy, sigma, sift.max_keypoints))
            keypoints = to_keypoints(points, space, sift, workspace)
        boxes = pair_boxes(keypoints, must.radius, (gray.shape[0], gray.shape[1]))
        return Regions(keypoints, boxes)


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
    """Bounding boxes of the discs of pairs around keypoints.

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
