"""The Scale-Invariant Feature Transform (section B.1)."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from saccade.errors import ImageError
from saccade.io.image import as_gray
from saccade.keypoints.descriptor import describe_points
from saccade.keypoints.detection import ScaleSpaceDetector, oriented
from saccade.keypoints.scale_space_points import check_keypoints, locate
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.scale_space import (
    MIN_SIDE,
    ScaleSpace,
    difference_of_gaussians,
    gaussian_scale_space,
)
from saccade.scale.workspace import Workspace
from saccade.types import Float32Array, Image, Keypoints


class Sift(ScaleSpaceDetector):
    """SIFT as a callable: `Sift(config)(image)` gives `Keypoints`.

    Args:
        config: scale space, detector and descriptor.
        threads: of a call; None for one per core. The keypoints do not depend on it.

    Source: Lowe (2004); Kootstra (2010), equations B.1-B.12.
    """

    further_planes = 3

    def __init__(self, config: SiftConfig | None = None, threads: int | None = None) -> None:
        config = config or SiftConfig.recommended()
        super().__init__(config, config, threads)

    def _responses(
        self, gray: Float32Array, space: ScaleSpace, workspace: Workspace
    ) -> Iterator[tuple[int, Float32Array]]:
        for number, octave in enumerate(space.octaves):
            yield number, difference_of_gaussians(octave, workspace)  # B.1

    def describe(self, image: Image, keypoints: Keypoints, *, orient: bool = False) -> Keypoints:
        """Describe keypoints from anywhere: another detector, a grid, an earlier image.

        Keypoints that this detector found are described as they were, byte for byte.

        Args:
            image: as for detection.
            keypoints: n keypoints between the outer edges of the image; see `Keypoints.at` and
                `saccade.exchange`. Their size says how much of the image is described and
                how blurred; a descriptor is 12 scales wide, that is 6 sizes, and what lies
                outside the image counts for nothing. Their own descriptors are not used.
            orient: whether to assign orientations. The default describes each keypoint along its
                angle. With it a keypoint is returned once for each dominant orientation, or not
                at all where the image is flat; in an upright configuration angles are 0.

        Returns:
            The keypoints in the order in which they were given, with descriptors.

        Raises:
            KeypointsError: a position outside the image, a size that is not over 0, an angle
                that is not finite, or fields of different lengths.
            ImageError: not an image, or too small an image.
        """
        gray, config = as_gray(image), self._sift
        keypoints = check_keypoints(keypoints, gray.shape)
        with self._workspaces.workspace() as workspace:
            space = gaussian_scale_space(gray, config, workspace=workspace)
            if len(keypoints) and not space.octaves:
                height, width = gray.shape
                raise ImageError(
                    f"image: expected at least {MIN_SIDE} samples a side in the first octave "
                    f"to describe keypoints, found an image of {width} x {height} px"
                )
            points, threads = locate(keypoints, space, config), workspace.threads
            if orient and config.upright:
                points = points._replace(angle=np.zeros_like(points.angle))
            elif orient:
                points, index = oriented(points, space, config, threads)
                keypoints = keypoints[index]
            descriptors = describe_points(space.octaves, points, config, threads)
        return replace(keypoints, angle=points.angle, descriptors=descriptors)
