"""Gaussian scale spaces: an image at increasing blur, in octaves."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from math import floor, log2, prod, sqrt

import cv2
import numpy as np

from saccade.scale.scale_space_config import ScaleSpaceConfig
from saccade.scale.workspace import SERIAL, Workspace
from saccade.types import Float32Array, FloatArray, IntArray

MIN_OCTAVE_SIDE = 8
"""Minimum samples per side of an octave; smaller octaves are dominated by reflected borders."""

NARROW_SIGMA = 0.8
"""Minimum sigma, in samples, of a Gaussian that its samples represent well."""

ROW_BLOCK = 192
"""Number of rows per block for a thread, chosen to stay in the cache between planes."""

MIN_SHARED = 2**20
"""Minimum number of samples of a plane whose blur threads share; with fewer they gain nothing."""


@dataclass(frozen=True, eq=False, repr=False)
class ScaleSpace:
    """An image at increasing blur; each octave halves the sampling density (B.2-B.3)."""

    octaves: tuple[Float32Array, ...]
    """Octaves of (s + 3, h, w) or fewer planes; plane i has 2**(i / s) times the blur of the first.
    The first octave may have additional scales."""
    origin: FloatArray
    """(octaves, 2) image pixel (x, y) of the first sample of each octave."""
    spacing: FloatArray
    """(octaves,) image pixels from one sample to the next."""

    def __repr__(self) -> str:
        shapes = ", ".join("x".join(map(str, octave.shape)) for octave in self.octaves)
        return f"ScaleSpace({len(self.octaves)} octaves: {shapes})"


def gaussian_scale_space(
    gray: Float32Array,
    config: ScaleSpaceConfig,
    *,
    min_side: int = MIN_OCTAVE_SIDE,
    further_planes: int = 3,
    workspace: Workspace | None = None,
) -> ScaleSpace:
    """The Gaussian scale space of a gray image.

    Args:
        gray: (H, W).
        config: octaves, intervals and sampling.
        min_side: minimum samples per side of an octave.
        further_planes: number of planes per octave in addition to its intervals, at least 1.
        workspace: reusable memory for the octaves; None allocates memory.

    Returns:
        Octaves of float32 planes; empty if the image is smaller than `min_side`.

    Source: Lowe (2004), section 3; equations B.2-B.3.
    """
    workspace = workspace or Workspace()
    centered, kernel_radius = config.grid == "centered", config.kernel_radius
    spacing = 2.0**config.first_octave / config.density
    intervals = config.intervals + config.extra_intervals  # in the first octave
    sigmas = [config.sigma(float(i)) for i in range(intervals + further_planes)]
    blur = sqrt(max(sigmas[0] ** 2 - (config.camera_sigma / spacing) ** 2, 0.01))
    plane, origin = first_plane(gray, spacing, blur, config, workspace)

    blur_next = partial(
        blurred, kernel_radius=kernel_radius, corrected=centered, workspace=workspace
    )
    octaves: list[Float32Array] = []
    origins, spacings = [], []
    max_octaves = config.octaves or int(log2(max(plane.shape))) + 1
    while len(octaves) < max_octaves and min(plane.shape) >= min_side:
        octave = workspace.array("octave", len(octaves), (len(sigmas), *plane.shape))
        octave[0] = plane
        for i, (before, after) in enumerate(pairwise(sigmas)):
            blur_next(octave[i], sqrt(after**2 - before**2), out=octave[i + 1])  # B.2
        octaves.append(octave)
        origins.append(origin)
        spacings.append(spacing)
        if centered:
            blur = sqrt(sigmas[intervals] ** 2 - sigmas[intervals - 1] ** 2)
            plane, start = downsampled(
                octave[intervals - 1], octave[intervals], blur, kernel_radius, workspace
            )
            origin = origin + spacing * start
        else:
            even = np.array(plane.shape) // 2 * 2
            height, width = plane.shape if config.grid == "published" else even
            plane = octave[intervals, :height:2, :width:2]
        spacing *= 2
        first, intervals = sigmas[intervals] / 2, config.intervals
        sigmas = [first * 2 ** (i / intervals) for i in range(intervals + further_planes)]
    return ScaleSpace(
        tuple(octaves), np.array(origins).reshape(-1, 2), np.array(spacings, np.float64)
    )


def first_plane(
    gray: Float32Array, spacing: float, blur: float, config: ScaleSpaceConfig, workspace: Workspace
) -> tuple[Float32Array, FloatArray]:
    """The image sampled every 0.5, 1 or 2 pixels, with a blur of `blur` samples.

    Returns:
        The plane and the (2,) pixel (x, y) of its first sample.
    """
    centered, kernel_radius = config.grid == "centered", config.kernel_radius
    if spacing > 1:
        blur *= spacing
        plane = blurred(gray, blur, kernel_radius, corrected=True, workspace=workspace)
        return downsampled(gray, plane, blur, kernel_radius, workspace)
    if spacing < 1 and centered:
        gray = upsampled(gray)
    elif spacing < 1:  # sample X lies at pixel X / 2 - 1 / 4
        gray = np.asarray(cv2.resize(gray, (2 * gray.shape[1], 2 * gray.shape[0])), np.float32)
    plane = blurred(
        *(gray, blur, kernel_radius),
        corrected=centered,
        out=workspace.array("plane", 0, gray.shape),
        workspace=workspace,
    )
    return plane, np.zeros(2)


def difference_of_gaussians(
    octave: Float32Array, workspace: Workspace | None = None
) -> Float32Array:
    """(s + 2, h, w) differences of the consecutive planes of an octave (B.1).

    In a workspace they overwrite the differences of the previous octave.
    """
    workspace = workspace or Workspace()
    planes, height, width = octave.shape
    differences = workspace.array("differences", 0, (planes - 1, height, width))

    def subtract(rows: slice) -> None:
        np.subtract(octave[1:, rows], octave[:-1, rows], out=differences[:, rows])

    workspace.run_in_blocks(subtract, height, ROW_BLOCK)
    return differences


def upsampled(gray: Float32Array) -> Float32Array:
    """(2H - 1, 2W - 1): the pixels, and their linear interpolation halfway between."""
    height, width = gray.shape
    doubled = np.empty((2 * height - 1, 2 * width - 1), np.float32)
    doubled[::2, ::2] = gray
    doubled[::2, 1::2] = (gray[:, :-1] + gray[:, 1:]) * np.float32(0.5)
    doubled[1::2] = (doubled[:-2:2] + doubled[2::2]) * np.float32(0.5)
    return doubled


def downsampled(
    before: Float32Array,
    plane: Float32Array,
    blur: float,
    kernel_radius: float,
    workspace: Workspace,
) -> tuple[Float32Array, FloatArray]:
    """Subsamples a plane by two, symmetrically about its center.

    Along an odd side, an odd number of samples is kept, so that the next octave is odd too. Along
    an even side, samples would be off center; means of two samples are taken instead, from a plane
    that is less blurred by the blur of the mean.

    Args:
        before: (h, w) plane before the blur that gave `plane`.
        plane: (h, w).
        blur: sigma of that blur, in samples.
        kernel_radius: truncation of the Gaussian kernel, in sigmas.
        workspace: its threads share the rows.

    Returns:
        (h', w') plane and the (2,) position (x, y) of its first sample, in samples of `plane`.
    """
    variance_of_mean = 0.25
    even = [side % 2 == 0 for side in plane.shape]
    if any(even):
        sigma_y, sigma_x = (sqrt(max(blur**2 - variance_of_mean * e, 0.01)) for e in even)
        plane = blurred(
            *(before, sigma_x, kernel_radius),
            sigma_y=sigma_y,
            corrected=True,
            out=workspace.array("plane", 0, before.shape),
            workspace=workspace,
        )
    first = [int(side % 4 == 3) for side in plane.shape]  # of an odd side
    plane = plane[first[0] :, first[1] :]
    result = np.empty([(side + 1) // 2 for side in plane.shape], np.float32)

    def fill(rows: slice) -> None:
        part = plane[2 * rows.start : 2 * rows.stop]
        for axis in (0, 1):
            lines = np.moveaxis(part, axis, 0)
            lines = (lines[::2] + lines[1::2]) * np.float32(0.5) if even[axis] else lines[::2]
            part = np.moveaxis(lines, 0, axis)
        result[rows] = part

    workspace.run_in_blocks(fill, len(result), ROW_BLOCK)
    start = [0.5 if e else float(each) for e, each in zip(even, first, strict=True)]
    return result, np.array(start[::-1])


def interpolated(plane: Float32Array, origin: FloatArray, shape: tuple[int, ...]) -> Float32Array:
    """Interpolates a plane of the next octave at the samples of this octave.

    Uses polynomials through 6 samples along each axis, with mirrored borders.

    Args:
        plane: (h', w'), every second sample.
        origin: (2,) position (x, y) of its first sample, in samples of the result: 0, 0.5 or 1.
        shape: (h, w) of the result.
    """
    padded = cv2.copyMakeBorder(plane, 0, 1, 0, 1, cv2.BORDER_REFLECT_101)
    result = np.empty(shape, np.float32)
    across, down = ([_taps((phase - start) / 2) for phase in (0, 1)] for start in origin.tolist())
    for y in (0, 1):
        for x in (0, 1):
            part = result[y::2, x::2]
            height, width = part.shape
            part[:] = cv2.sepFilter2D(
                padded, cv2.CV_32F, across[x], down[y], borderType=cv2.BORDER_REFLECT_101
            )[:height, :width]
    return result


def _taps(offset: float) -> Float32Array:
    """(7,) weights of samples -3 to 3 for interpolation by 6 samples at an offset."""
    first = floor(offset) - 2
    nodes = range(first, first + 6)
    weights = np.zeros(7, np.float32)
    for node in nodes:
        others = [each for each in nodes if each != node]
        weights[node + 3] = prod((offset - each) / (node - each) for each in others)
    return weights


def blurred(
    plane: Float32Array,
    sigma: float,
    kernel_radius: float,
    *,
    sigma_y: float | None = None,
    corrected: bool = False,
    out: Float32Array | None = None,
    workspace: Workspace = SERIAL,
) -> Float32Array:
    """Gaussian blur of a plane, mirrored at its borders.

    Args:
        plane: (h, w).
        sigma: sigma of the Gaussian, in samples.
        kernel_radius: truncation of the kernel, in sigmas.
        sigma_y: sigma along the columns, if different.
        corrected: corrects the kernel's variance for sampling and truncation; otherwise the kernel
            samples the Gaussian.
        out: (h, w) array for the result.
        workspace: its threads share the rows; the result does not depend on their number.
    """
    kernel_x = kernel_y = gaussian_kernel(sigma, kernel_radius, corrected)
    if sigma_y is not None:
        kernel_y = gaussian_kernel(sigma_y, kernel_radius, corrected)
    height, radius = len(plane), len(kernel_y) // 2
    result = np.empty(plane.shape, np.float32) if out is None else out

    share = -(-height // workspace.threads)
    border = cv2.BORDER_REFLECT_101

    def blur(rows: slice) -> None:
        cv2.sepFilter2D(plane[rows], -1, kernel_x, kernel_y, dst=result[rows], borderType=border)

    if share == height or plane.size < MIN_SHARED or share < 2 * radius:
        blur(slice(height))
        return result
    workspace.run_in_blocks(blur, height, share)
    for start in range(share, height, share):  # mirrored rows of the share were used there
        near = slice(start - 2 * radius, min(start + 2 * radius, height))
        part = cv2.sepFilter2D(plane[near], -1, kernel_x, kernel_y, borderType=border)
        result[start - radius : start + radius] = part[radius : 3 * radius]
    return result


@cache
def gaussian_kernel(sigma: float, kernel_radius: float, corrected: bool) -> Float32Array:
    """(n,) samples of a Gaussian, truncated at `kernel_radius` sigmas.

    Sampling and truncation change the variance. With `corrected`, narrow kernels match the
    Gaussian's moments up to the sixth, and wide kernels sample a Gaussian whose sampled variance is
    correct.
    """
    if corrected and sigma < NARROW_SIGMA:
        return kernel_of_moments(sigma)
    radius = (round(2 * kernel_radius * sigma + 1) | 1) // 2
    squares = np.arange(-radius, radius + 1) ** 2

    def excess(candidate: float) -> float:
        return float(samples_of_gaussian(squares, candidate) @ squares) - sigma**2

    # With severe truncation no sigma has the variance; keep the plain samples.
    if corrected and excess(2 * sigma) > 0:
        sigma = bisect(excess, sigma / 2, 2 * sigma)
    return samples_of_gaussian(squares, sigma).astype(np.float32)


def bisect(rising: Callable[[float], float], low: float, high: float) -> float:
    """Root of a function by bisection, without SciPy's import time of a second."""
    while low < (middle := (low + high) / 2) < high:
        low, high = (low, middle) if rising(middle) > 0 else (middle, high)
    return middle


def kernel_of_moments(sigma: float) -> Float32Array:
    """(7,) weights that match a Gaussian's moments up to the sixth."""
    taps = np.arange(4)
    even = np.vander(taps**2, 4, increasing=True).T.astype(np.float64)  # k^0, k^2, k^4, k^6
    half = np.linalg.solve(even, [1, sigma**2, 3 * sigma**4, 15 * sigma**6])
    return np.concatenate([half[:0:-1] / 2, half[:1], half[1:] / 2]).astype(np.float32)


def samples_of_gaussian(squares: IntArray, sigma: float) -> FloatArray:
    """Gaussian weights at positions with the given squares, normalized to a sum of 1."""
    weights = np.exp(-squares / (2 * sigma**2))
    return np.asarray(weights / weights.sum(), np.float64)
