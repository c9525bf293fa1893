"""The Scale-Invariant Feature Transform: the detector of section B.1."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.image import as_gray
from saccade.keypoints.scale_space_points import (
    Points,
    all_directions,
    check_keypoints,
    describe_all,
    detect,
    interest_points,
    scale_space_of,
)
from saccade.keypoints.sift_config import SiftConfig
from saccade.keypoints.workspaces import WorkspacePool
from saccade.scale_space import SMALLEST_SIDE, difference_of_gaussians
from saccade.types import Float32Array, Image, Keypoints


class Sift:
    """SIFT as a callable: `Sift(config)(image)` gives `Keypoints`.

    Args:
        config: what to do.
        threads: how many work at a time; 0 for one to a core. The points do not depend on
            it. The Gaussians are OpenCV's, which asks `cv2.setNumThreads`.

    A detector keeps the memory that its largest image took, for the next.
    """

    def __init__(self, config: SiftConfig | None = None, threads: int = 0) -> None:
        self._bench = WorkspacePool(threads)
        self.config = SiftConfig.recommended() if config is None else config
        self.threads = self._bench.threads

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
        config, threads = self.config, self.threads
        with self._bench.workspace() as workspace:

            def search(octave: Float32Array, number: int, spacing: float) -> Points:
                differences = difference_of_gaussians(octave, workspace, threads)  # B.1
                return detect(differences, number, config, config.contrast_threshold, threads)

            gray = as_gray(image)  # (H, W)
            return interest_points(gray, mask, config, search, describe, workspace, threads)

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
        given = check_keypoints(keypoints, gray.shape)
        with self._bench.workspace() as workspace:
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
