"""MUST, the multi-scale symmetry transform: interest points from local symmetry over scales."""

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from saccade.io.preparation import gray_and_mask
from saccade.keypoints.detection import find_points, preferred, to_keypoints
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.scale_space_points import Points
from saccade.scale.pair_sums import PairKernel, gradients_of, isotropic_sums, pair_kernel
from saccade.scale.scale_space import (
    MIN_OCTAVE_SIDE,
    ScaleSpace,
    gaussian_scale_space,
    interpolated,
)
from saccade.scale.workspace import Workspace, WorkspacePool
from saccade.types import Float32Array, Image, Keypoints

SOBEL_GAIN = 8
"""Response of Sobel's filters to a slope of 1 per sample."""


class Must:
    """MUST as a callable: `Must(config)(image)` gives `Keypoints`.

    Args:
        config: scale space, symmetry, selection and descriptor.
        threads: of a call; None for one per core. The keypoints do not depend on it.

    The source leaves the following choices open. They were made by repeatability at 100, 300 and
    1000 keypoints under noise, low contrast and blur, on four sequences of the affine covariant
    regions set (docs/symmetry.md has the figures, also for the other four sequences):

    - *The disc grows with the scale.* Within an octave every plane has the same samples, so a disc
      of fixed size would cover smaller structures on coarser planes. Here a pair may be `radius`
      scales from its middle, and is weighted by a normal density of `falloff` scales: smooth in
      scale, so that extrema over scales are defined. There is no hole in the middle.
    - *The last two planes of an octave are the first two of the next*, interpolated: they have the
      same scales, and a quarter of the samples.
    - *Gradients are changes over one scale and the weights of a plane add up to 1*, as Lowe's
      differences are normalized by scale, *times a power of the scale* (`scale_power`): large
      structures come first, since noise and blur destroy small ones.
    - *Gradients are measured by the standard deviation of the image*, and their logarithm taken.
      So half the contrast gives the same keypoints in the same order, and a single strong edge
      does not outweigh many pairs.
    - *Only maxima count*, among the 10 nearest of 3x3x3 samples, as in our SIFT: the fit rejects
      saddles. A minimum has no symmetry about it.
    - *Positions are refined by the polynomial through 9 samples each way*, as our SIFT's are. With
      a quadratic alone maxima halfway between samples are lost: a tenth of the repeatable ones.
    - *Bars are rejected* by the ratio of curvatures of the symmetry: along a bar every position is
      as symmetric as the next. The ratio may be larger than SIFT's, since the ends of pairs, not
      the keypoint, lie on edges.
    - *The finest base is coarser than SIFT's*, since noise and edges dominate finer symmetry.

    Source: Kootstra, de Jong & Schomaker, *Using local symmetry for landmark selection*
    (ICVS 2009).
    """

    def __init__(self, config: MustConfig | None = None, threads: int | None = None) -> None:
        self.config = config or MustConfig()
        self._workspaces = WorkspacePool(threads)

    def __repr__(self) -> str:
        return f"Must({self.config})"

    def __call__(
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect keypoints and describe them.

        Arguments, result and errors as for `Sift.__call__`; the response is the symmetry.
        """
        (gray, inside), config = gray_and_mask(image, mask), self.config.sift()  # (H, W) each
        with self._workspaces.workspace() as workspace:
            points, space = symmetric_points(gray, self.config, workspace)
            points = points.inside(inside, space)
            points = points.take(preferred(points, space, config))
            return to_keypoints(points, space, config, workspace, describe=describe)


def symmetric_points(
    gray: Float32Array, config: MustConfig, workspace: Workspace
) -> tuple[Points, ScaleSpace]:
    """The maxima of symmetry over position and scale of a gray image, and its scale space."""
    sift, contrast = config.sift(), float(gray.std(dtype=np.float64))
    min_side = max(MIN_OCTAVE_SIDE, 2 * sift.border + 1)
    space = gaussian_scale_space(
        gray, sift, min_side=min_side, further_planes=2, workspace=workspace
    )

    def responses() -> Iterator[tuple[int, Float32Array]]:
        coarser: Float32Array | None = None
        for number in reversed(range(len(space.octaves))):
            coarser = octave_symmetry(space, number, config, contrast, coarser, workspace)
            yield number, coarser

    return find_points(responses(), sift, config.min_response, workspace), space


def octave_symmetry(
    space: ScaleSpace,
    number: int,
    config: MustConfig,
    contrast: float,
    coarser: Float32Array | None = None,
    workspace: Workspace | None = None,
) -> Float32Array:
    """(s + 2, h, w) isotropic symmetry of the planes of an octave; the inner s can have maxima.

    Args:
        space: the scale space of the image.
        number: of the octave.
        config: of the detector.
        contrast: standard deviation of the image.
        coarser: symmetry of the next octave, interpolated to the last two planes; None computes
            the two planes.
        workspace: holds the result; its threads share the planes.
    """
    workspace, sift = workspace or Workspace(), config.sift()
    octave, spacing = space.octaves[number], space.spacing[number]
    symmetry = workspace.array("symmetry", number, (config.intervals + 2, *octave.shape[1:]))
    if contrast == 0:
        symmetry[:] = 0
        return symmetry

    def fill(planes: slice) -> None:
        for i in range(planes.start, planes.stop):
            if coarser is not None and i >= config.intervals:
                origin = (space.origin[number + 1] - space.origin[number]) / spacing
                symmetry[i] = interpolated(coarser[i - config.intervals], origin, octave.shape[1:])
                continue
            sigma = sift.sigma(float(i))  # samples
            gain = config.gain * sigma / (SOBEL_GAIN * contrast)
            gradients = gradients_of(octave[i], gain, cv2.BORDER_REFLECT_101)
            pairs = pairs_in_disc(config.radius * sigma, config.falloff * sigma)
            sums = isotropic_sums([gradients], pairs)
            np.multiply(sums, np.float32((spacing * sigma) ** config.scale_power), out=symmetry[i])

    workspace.run_in_blocks(fill, len(symmetry), 1)
    return symmetry


@cache
def pairs_in_disc(radius: float, sigma: float) -> PairKernel:
    """The pairs within a radius of their middle; their weights add up to 1.

    Args:
        radius: in samples.
        sigma: of the normal density that weights them by that distance.
    """
    pairs = pair_kernel(1, max(1, int(radius)), 2 * sigma)
    distance = np.hypot(*pairs.offsets.T)
    kept = distance <= max(radius, 1)
    weights = np.exp((distance[kept].min() ** 2 - distance[kept] ** 2) / (2 * sigma**2))
    weights /= weights.sum()
    return PairKernel(pairs.offsets[kept], pairs.directions[kept], weights.astype(np.float32))
