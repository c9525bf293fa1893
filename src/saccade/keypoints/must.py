"""MUST, the multi-scale symmetry transform: interest points from local symmetry over scales."""

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from saccade._jit import run_in_blocks
from saccade.image import as_gray
from saccade.keypoints.must_config import MustConfig
from saccade.keypoints.scale_space_points import Points, detect, interest_points
from saccade.keypoints.workspaces import WorkspacePool
from saccade.pair_sums import PairKernel, gradients_of, isotropic_sums, pair_kernel
from saccade.scale_space import Workspace
from saccade.types import Float32Array, Image, Keypoints

DENSE = 2.5
"""Scale in samples from which on every second pair does: its neighbors are nearly alike."""
SOBEL = 8
"""What Sobel's filters make of a slope of 1 per sample."""


class Must:
    """MUST as a callable: `Must(config)(image)` gives `Keypoints`.

    Args:
        config: what to do.
        threads: how many work at a time; 0 for one to a core. The points do not depend on it.

    The source leaves open what stands in this list; each was chosen by repeatability at 100, 300
    and 1000 points under noise, low contrast and blur, on four sequences of the affine covariant
    regions set (docs/symmetry.md has the figures, and those of the other four):

    - *The disc grows with the scale.* Within an octave every plane has the same samples, so one
      of fixed size would see smaller things on coarser planes. Here a pair may be `reach` scales
      from its middle, and counts by a normal density of `falloff` scales: smooth in scale, so
      that extrema over scales mean something. There is no hole in the middle. Where samples are
      dense every second pair does.
    - *Gradients are changes over one scale and the weights of a plane add up to 1*, as Lowe's
      differences are normalized by scale, *times a power of the scale* (`scale_power`): what is
      large comes first, for noise and blur take the small.
    - *Gradients are measured by the standard deviation of the image*, and their logarithm taken.
      So half the contrast gives the same points in the same order, and a single strong edge does
      not outweigh many pairs.
    - *Only maxima count*, among the 10 nearest of 3x3x3 samples, as in our SIFT: the fit drops
      saddles. A minimum is a place about which nothing is symmetric.
    - *Places are those of the polynomial through 9 samples each way*, as our SIFT's are. With a
      quadratic alone maxima halfway between samples are lost: a tenth of what is found again.
    - *Bars are dropped* by the ratio of curvatures of the symmetry: along a bar every point is as
      symmetric as the next. The ratio may be larger than SIFT's, for the ends of pairs rather
      than the point itself lie on edges.
    - *The finest base is coarser than SIFT's*: finer symmetry is that of noise and of edges.
    """

    def __init__(self, config: MustConfig | None = None, threads: int = 0) -> None:
        self._bench = WorkspacePool(threads)
        self.config = config or MustConfig()
        self.threads = self._bench.threads

    def __repr__(self) -> str:
        return f"Must({self.config})"

    def __call__(
        self, image: Image, mask: npt.ArrayLike | None = None, *, describe: bool = True
    ) -> Keypoints:
        """Detect interest points and describe them as SIFT's are.

        Args:
            image: (H, W), (H, W, 3) or (H, W, 4); uint8, uint16, bool, or float in [0, 1].
            mask: (H, W), points are kept where it is not zero; None keeps all.
            describe: whether descriptors are wanted.

        Returns:
            The points, strongest first; the response is the symmetry at the maximum. A flat
            image has none.

        Raises:
            ImageError: not an image, empty, not finite, outside [0, 1], or the mask does
                not fit.

        Source: Kootstra, de Jong & Schomaker, *Using local symmetry for landmark selection*
        (ICVS 2009).
        """
        config, sift, threads = self.config, self.config.sift(), self.threads
        gray = as_gray(image)  # (H, W)
        contrast = float(gray.std(dtype=np.float64))
        with self._bench.workspace() as workspace:

            def search(octave: Float32Array, number: int, spacing: float) -> Points:
                if contrast == 0:
                    return Points.none()
                symmetry = symmetry_of(octave, spacing, config, contrast, workspace, threads)
                return detect(symmetry, number, sift, config.contrast_threshold, threads)

            return interest_points(gray, mask, sift, search, describe, workspace, threads)


def symmetry_of(
    octave: Float32Array,
    spacing: float,
    config: MustConfig,
    contrast: float,
    workspace: Workspace | None = None,
    threads: int = 1,
) -> Float32Array:
    """(s + 2, h, w) isotropic symmetry of the planes of an octave; s has its maxima.

    Args:
        octave: (s + 3, h, w) Gaussian planes.
        spacing: image pixels from one of its samples to the next.
        config: of the detector.
        contrast: standard deviation of the image.
        workspace: where it is made, in the place of the last octave's.
        threads: how many work at a time, each on a plane.
    """
    workspace = Workspace() if workspace is None else workspace
    sift = config.sift()
    symmetry = workspace.array("symmetry", 0, (config.intervals + 2, *octave.shape[1:]))

    def fill(planes: slice) -> None:
        for i in range(planes.start, planes.stop):
            sigma = sift.density * sift.base_sigma * 2 ** (i / sift.intervals)  # samples
            gain = config.gain * sigma / (SOBEL * contrast)
            gradients = gradients_of(octave[i], gain, cv2.BORDER_REFLECT_101)
            pairs = pairs_in_disc(config.reach * sigma, config.falloff * sigma, sigma > DENSE)
            sums = isotropic_sums([gradients], pairs)
            np.multiply(sums, np.float32((spacing * sigma) ** config.scale_power), out=symmetry[i])

    run_in_blocks(fill, len(symmetry), 1, threads)
    return symmetry


@cache
def pairs_in_disc(radius: float, sigma: float, every_second: bool) -> PairKernel:
    """The pairs that are no farther than a radius from their middle; their weights add up to 1.

    Args:
        radius: in samples.
        sigma: of the normal density that weighs them by that distance.
        every_second: take one of two, as the black squares of a chessboard lie.
    """
    pairs = pair_kernel(1, max(1, int(radius)), 2 * sigma)
    distance = np.hypot(*pairs.offsets.T)
    kept = distance <= max(radius, 1)
    if every_second and radius >= 2:
        kept &= pairs.offsets.sum(axis=1) % 2 == 0
    weights = np.exp((distance[kept].min() ** 2 - distance[kept] ** 2) / (2 * sigma**2))
    weights /= weights.sum()
    return PairKernel(pairs.offsets[kept], pairs.directions[kept], weights.astype(np.float32))
