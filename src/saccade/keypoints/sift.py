"""The Scale-Invariant Feature Transform (section B.1)."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from saccade.errors import ImageError
from saccade.io.image import as_gray
from saccade.io.preparation import gray_and_mask, opaque_part, warn_of_low_contrast
from saccade.keypoints.descriptor import describe_points
from saccade.keypoints.detection import (
    find_points,
    oriented,
    preferred,
    to_keypoints,
)
from saccade.keypoints.scale_space_points import check_keypoints, locate
from saccade.keypoints.sift_config import SiftConfig
from saccade.scale.scale_space import MIN_OCTAVE_SIDE, difference_of_gaussians, gaussian_scale_space
from saccade.scale.workspace import WorkspacePool
from saccade.types import Image, Keypoints

FEW = 15
"""Number of keypoints below which the contrast of the image is checked."""
LEAST_CONTRAST = 3.0
"""Range of the values of an image below which none may be found, in contrast thresholds: |D| of a
blob is about a third of its contrast."""


class Sift:
    """SIFT as a callable: `Sift(config)(image)` gives `Keypoints`.

    A detector keeps the memory that its largest image took, for the next.

    Args:
        config: scale space, detector and descriptor.
        threads: of a call; None for one per core. The keypoints do not depend on it. During a call
            OpenCV starts no threads of its own in this process.

    Source: Lowe (2004); Kootstra (2010), equations B.1-B.12.
    """

    def __init__(self, config: SiftConfig | None = None, threads: int | None = None) -> None:
        self.config = config or SiftConfig()
        self._workspaces = WorkspacePool(threads)

    def __repr__(self) -> str:
        return f"Sift({self.config})"

    def __call__(
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect keypoints and describe them.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            mask: (H, W), keypoints are kept where it is not zero, and where the alpha channel of
                the image is opaque; None keeps all opaque ones.
            describe: whether to compute descriptors.

        Returns:
            The keypoints, strongest first by `SiftConfig.ranking`; of equally strong ones the upper
            left first. The response is |D| at the extremum. A flat image, or one of a few pixels,
            has none.

        Raises:
            ImageError: not an image, empty, not finite, outside [0, 1], or the mask does
                not have its shape.
        """
        config = self.config
        with self._workspaces.workspace() as workspace:
            gray, inside = gray_and_mask(image, mask, workspace.run_in_blocks)  # (H, W) each
            min_side = max(MIN_OCTAVE_SIDE, 2 * config.border + 1)
            space = gaussian_scale_space(gray, config, min_side=min_side, workspace=workspace)
            responses = (difference_of_gaussians(each, workspace) for each in space.octaves)  # B.1
            points = find_points(enumerate(responses), config, config.min_response, workspace)
            if len(points.octave) < FEW:
                warn_of_low_contrast(gray, LEAST_CONTRAST * config.min_response)
            points = points.inside(inside, space)
            points = points.take(preferred(points, space, config))
            return to_keypoints(points, space, config, workspace, describe=describe)

    def describe(self, image: Image, keypoints: Keypoints, *, orient: bool = False) -> Keypoints:
        """Describe keypoints from anywhere: another detector, a grid, an earlier image.

        Keypoints that this detector found are described as they were, byte for byte.

        Args:
            image: as for detection.
            keypoints: n keypoints between the outer edges of the image; see `Keypoints.at` and
                `saccade.exchange`. The size sets the width and blur of the described patch: 12
                scales, which are 6 sizes. Samples outside the image do not count. Descriptors of
                the keypoints are ignored.
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
        gray, config = as_gray(opaque_part(image)[0]), self.config
        keypoints = check_keypoints(keypoints, gray.shape)
        with self._workspaces.workspace() as workspace:
            space = gaussian_scale_space(gray, config, workspace=workspace)
            if len(keypoints) and not space.octaves:
                height, width = gray.shape
                raise ImageError(
                    f"image: expected at least {MIN_OCTAVE_SIDE} samples a side in the first "
                    f"octave to describe keypoints, found an image of {width} x {height} px"
                )
            points = locate(keypoints, space, config)
            if orient and config.upright:
                points = points._replace(angle=np.zeros_like(points.angle))
            elif orient:
                points, index = oriented(points, space, config, workspace)
                keypoints = keypoints[index]
            descriptors = describe_points(space.octaves, points, config, workspace)
        return replace(keypoints, angle=points.angle, descriptors=descriptors)
