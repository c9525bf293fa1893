"""Images at many scales, shared by attention and interest points."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import log2, prod, sqrt
from typing import Literal

import cv2
import numpy as np

from saccade._jit import run_in_blocks
from saccade.types import Float32Array, FloatArray, IntArray

SMALLEST_SIDE = 8
"""Samples: an octave narrower than this shows its reflected borders, not the image."""

NARROW = 0.8
"""Samples: a Gaussian of a smaller sigma is not well described by its samples."""

ROWS_AT_ONCE = 192
"""That a thread subtracts at a time: they stay in the cache from one plane to the next."""

Grid = Literal["centered", "shifted", "printed"]
"""Where an octave has its samples; see `gaussian_scale_space`."""


class Workspace:
    """Memory that is used again: getting it anew took a third of the time of a scale space.

    What is made in it holds until the next image is.
    """

    def __init__(self) -> None:
        self._memory: dict[tuple[str, int], Float32Array] = {}

    def array(self, name: str, number: int, shape: tuple[int, ...]) -> Float32Array:
        """An array with arbitrary content, in the memory of a name and number."""
        size = prod(shape)
        memory = self._memory.get((name, number))
        if memory is None or memory.size < size:
            memory = np.empty(size, np.float32)
            self._memory[name, number] = memory
        return memory[:size].reshape(shape)


@dataclass(frozen=True, eq=False, repr=False)
class ScaleSpace:
    """An image under growing blur, sampled half as densely from octave to octave (B.2-B.3)."""

    octaves: tuple[Float32Array, ...]
    """Each (s + 3, h, w): plane i is blurred 2**(i / s) times as much as the first. The first
    octave may have more scales than the others."""
    origin: FloatArray
    """(octaves, 2) image pixel (x, y) on which the first sample of each octave is said to lie."""
    spacing: FloatArray
    """(octaves,) image pixels from one sample to the next."""

    def __repr__(self) -> str:
        shapes = ", ".join("x".join(map(str, octave.shape)) for octave in self.octaves)
        return f"ScaleSpace({len(self.octaves)} octaves: {shapes})"


def gaussian_scale_space(
    gray: Float32Array,
    *,
    first_octave: int = -1,
    octaves: int = 0,
    intervals: int = 3,
    extra_intervals: int = 0,
    base_sigma: float = 1.6,
    density: float = 1.0,
    camera_sigma: float = 0.5,
    kernel_radius: float = 4.0,
    grid: Grid = "centered",
    smallest_side: int = SMALLEST_SIDE,
    workspace: Workspace | None = None,
    threads: int = 1,
) -> ScaleSpace:
    """The Gaussian scale space of a grey image.

    Args:
        gray: (H, W).
        first_octave: -1 starts at the scales of a doubled image, 0 at those of the image.
        octaves: how many at most; 0 for as many as the image has room for.
        intervals: s, the scales to an octave.
        extra_intervals: scales more in the first octave; the others begin as much later.
        base_sigma: blur of the first plane of the first octave, in samples of density 1.
        density: 1 or 0.5, samples to a side for each that Lowe takes. With 0.5 and
            `first_octave` -1 the first octave has the image's own pixels.
        camera_sigma: blur that the image is assumed to have, in pixels.
        kernel_radius: where the Gaussian kernel is cut, in sigmas.
        grid: "centered" lays the samples of every octave evenly about the middle of the
            image, so that a mirrored image has the mirrored scale space. "shifted" does
            as OpenCV: doubling moves the image by a quarter pixel to the right and down,
            and every octave starts at the upper left sample of the one before. "printed" does
            the same, and keeps the last sample of an odd side, which OpenCV leaves out.
        smallest_side: octaves narrower than this are left out.
        workspace: where the octaves are made; None for memory of their own.
        threads: how many work at a time.

    Returns:
        Octaves of float32 planes; none where the image is smaller than `smallest_side`.

    Source: Lowe (2004), section 3; equations B.2-B.3.
    """
    workspace = Workspace() if workspace is None else workspace
    spacing = 2.0**first_octave / density
    count = intervals + extra_intervals  # of the first octave
    sigmas = [density * base_sigma * 2 ** (i / intervals) for i in range(count + 3)]
    blur = sqrt(max(sigmas[0] ** 2 - (camera_sigma / spacing) ** 2, 0.01))
    plane, origin = first_plane(gray, spacing, blur, kernel_radius, grid, threads)

    stacks: list[Float32Array] = []
    origins, spacings = [], []
    limit = octaves or int(log2(max(plane.shape))) + 1
    while len(stacks) < limit and min(plane.shape) >= smallest_side:
        stack = workspace.array("octave", len(stacks), (count + 3, *plane.shape))
        stack[0] = plane
        for i, (before, after) in enumerate(pairwise(sigmas)):
            blurred(
                stack[i],
                sqrt(after**2 - before**2),
                kernel_radius,
                corrected=grid == "centered",
                out=stack[i + 1],
                threads=threads,
            )  # B.2
        stacks.append(stack)
        origins.append(origin)
        spacings.append(spacing)
        if grid == "centered":
            step = sqrt(sigmas[count] ** 2 - sigmas[count - 1] ** 2)
            plane, start = halve(stack[count - 1], stack[count], step, kernel_radius, threads)
            origin = origin + spacing * start
        else:
            height, width = plane.shape if grid == "printed" else np.array(plane.shape) // 2 * 2
            plane = stack[count, :height:2, :width:2]
        spacing *= 2
        sigmas = [sigmas[count] / 2 * 2 ** (i / intervals) for i in range(intervals + 3)]
        count = intervals
    return ScaleSpace(
        tuple(stacks), np.array(origins).reshape(-1, 2), np.array(spacings, np.float64)
    )


def first_plane(
    gray: Float32Array,
    spacing: float,
    blur: float,
    kernel_radius: float,
    grid: Grid,
    threads: int,
) -> tuple[Float32Array, FloatArray]:
    """An image sampled every 0.5, 1 or 2 pixels, under a blur of `blur` such samples.

    Returns:
        The plane and the (2,) pixel (x, y) of its first sample.
    """
    if spacing > 1:
        plane = blurred(gray, spacing * blur, kernel_radius, corrected=True, threads=threads)
        return halve(gray, plane, spacing * blur, kernel_radius, threads)
    if spacing < 1:
        gray = double(gray) if grid == "centered" else double_shifted(gray)
    corrected = grid == "centered"
    plane = blurred(gray, blur, kernel_radius, corrected=corrected, threads=threads)
    return plane, np.zeros(2)


def difference_of_gaussians(
    octave: Float32Array, workspace: Workspace | None = None, threads: int = 1
) -> Float32Array:
    """(s + 2, h, w): each plane of an octave taken from the next (B.1).

    In a workspace the differences of one octave take the place of those of the last.
    """
    workspace = Workspace() if workspace is None else workspace
    planes, height, width = octave.shape
    differences = workspace.array("differences", 0, (planes - 1, height, width))

    def subtract(rows: slice) -> None:
        np.subtract(octave[1:, rows], octave[:-1, rows], out=differences[:, rows])

    run_in_blocks(subtract, height, ROWS_AT_ONCE, threads)
    return differences


def double(gray: Float32Array) -> Float32Array:
    """(2H - 1, 2W - 1): every pixel in its place, and linear means halfway between."""
    height, width = gray.shape
    doubled = np.empty((2 * height - 1, 2 * width - 1), np.float32)
    doubled[::2, ::2] = gray
    doubled[::2, 1::2] = (gray[:, :-1] + gray[:, 1:]) * np.float32(0.5)
    doubled[1::2] = (doubled[:-2:2] + doubled[2::2]) * np.float32(0.5)
    return doubled


def double_shifted(gray: Float32Array) -> Float32Array:
    """(2H, 2W), aligned at the image's edges: sample X lies at pixel X / 2 - 1 / 4."""
    height, width = gray.shape
    doubled = np.empty((2 * height, 2 * width), np.float32)
    cv2.resize(gray, (2 * width, 2 * height), dst=doubled)
    return doubled


def halve(
    before: Float32Array,
    plane: Float32Array,
    step: float,
    kernel_radius: float,
    threads: int = 1,
) -> tuple[Float32Array, FloatArray]:
    """Every second sample of a plane, laid evenly about its middle.

    A side of odd length keeps samples, an odd number of them so that the next octave can
    do the same. On a side of even length they would lie off the middle: there means of
    two are taken, of a plane that is less blurred by as much as the mean blurs.

    Args:
        before: (h, w) the plane that `plane` was made from.
        plane: (h, w).
        step: sigma of the blur that led from `before` to `plane`.
        kernel_radius: where the Gaussian kernel is cut, in sigmas.
        threads: how many work at a time.

    Returns:
        (h', w') plane and the (2,) place (x, y) of its first sample, in samples of `plane`.
    """
    mean_of_two = 0.25  # variance
    even = [side % 2 == 0 for side in plane.shape]
    if any(even):
        down, across = (sqrt(max(step**2 - mean_of_two * e, 0.01)) for e in even)
        plane = blurred(
            before, across, kernel_radius, sigma_y=down, corrected=True, threads=threads
        )
    start = [0.5, 0.5]
    for axis, side in enumerate(plane.shape):
        lines = np.moveaxis(plane, axis, 0)
        if even[axis]:
            lines = (lines[::2] + lines[1::2]) * np.float32(0.5)
        else:
            first = (side + 1) // 2 % 2 == 0
            start[axis] = float(first)
            lines = lines[int(first) :: 2]
        plane = np.moveaxis(lines, 0, axis)
    return plane, np.array(start[::-1])


def blurred(
    plane: Float32Array,
    sigma: float,
    kernel_radius: float,
    *,
    sigma_y: float | None = None,
    corrected: bool = False,
    out: Float32Array | None = None,
    threads: int = 1,
) -> Float32Array:
    """A plane under a Gaussian that is cut at `kernel_radius` sigmas, mirrored outside.

    Args:
        plane: (h, w).
        sigma: of the Gaussian, in samples.
        kernel_radius: where it is cut, in sigmas.
        sigma_y: sigma down the columns where it differs.
        corrected: give the kernel the variance of the Gaussian, which sampling and cutting
            change; otherwise the kernel samples the Gaussian itself.
        out: (h, w) takes the result.
        threads: how many work at a time; the result does not depend on it.
    """
    across = gaussian_kernel(sigma, kernel_radius, corrected)
    down = across
    if sigma_y is not None:
        down = gaussian_kernel(sigma_y, kernel_radius, corrected)
    height, reach = len(plane), len(down) // 2
    result = np.empty(plane.shape, np.float32) if out is None else out

    def blur(rows: slice) -> None:
        first, last = max(rows.start - reach, 0), min(rows.stop + reach, height)
        part = cv2.sepFilter2D(
            plane[first:last], -1, across, down, borderType=cv2.BORDER_REFLECT_101
        )
        result[rows] = part[rows.start - first : rows.stop - first]

    if threads > 1 and height >= ROWS_AT_ONCE:
        run_in_blocks(blur, height, -(-height // threads), threads)
    else:
        cv2.sepFilter2D(plane, -1, across, down, dst=result, borderType=cv2.BORDER_REFLECT_101)
    return result


@cache
def gaussian_kernel(sigma: float, kernel_radius: float, corrected: bool) -> Float32Array:
    """(n,) samples of a Gaussian, cut at `kernel_radius` sigmas.

    Sampling and cutting change its variance. `corrected`, a narrow kernel has the Gaussian's
    moments up to the sixth, and a wide one samples a Gaussian that has the right variance
    when it is sampled.
    """
    if corrected and sigma < NARROW:
        return kernel_of_moments(sigma)
    radius = (round(2 * kernel_radius * sigma + 1) | 1) // 2
    squares = np.arange(-radius, radius + 1) ** 2

    def excess(candidate: float) -> float:
        return float(samples_of_gaussian(squares, candidate) @ squares) - sigma**2

    # Where it is cut so short that none has the variance, it is left as it is.
    if corrected and excess(2 * sigma) > 0:
        sigma = root(excess, sigma / 2, 2 * sigma)
    return samples_of_gaussian(squares, sigma).astype(np.float32)


def root(rising: Callable[[float], float], low: float, high: float) -> float:
    """Where a function goes through 0, by halving: SciPy's would take a second to import."""
    while low < (middle := (low + high) / 2) < high:
        low, high = (low, middle) if rising(middle) > 0 else (middle, high)
    return middle


def kernel_of_moments(sigma: float) -> Float32Array:
    """(7,) weights that have a Gaussian's moments up to the sixth."""
    taps = np.arange(4)
    even = np.vander(taps**2, 4, increasing=True).T.astype(np.float64)  # k^0, k^2, k^4, k^6
    half = np.linalg.solve(even, [1, sigma**2, 3 * sigma**4, 15 * sigma**6])
    return np.concatenate([half[:0:-1] / 2, half[:1], half[1:] / 2]).astype(np.float32)


def samples_of_gaussian(squares: IntArray, sigma: float) -> FloatArray:
    """Those at places whose squares are given; their sum is 1."""
    weights = np.exp(-squares / (2 * sigma**2))
    return np.asarray(weights / weights.sum(), np.float64)
