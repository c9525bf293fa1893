"""Images at many scales, shared by attention and interest points."""

from dataclasses import dataclass
from math import log2, sqrt

import cv2
import numpy as np

from saccade.types import Float32Array

SMALLEST_SIDE = 8
"""Samples: an octave narrower than this shows the borders' reflection, not the image."""


@dataclass(frozen=True, eq=False, repr=False)
class ScaleSpace:
    """An image under growing blur, sampled half as densely from octave to octave (B.1-B.2)."""

    octaves: tuple[Float32Array, ...]
    """Each (s + 3, h, w): plane i is blurred by `base_sigma * 2**(i / s)` samples."""
    first_octave: int
    """-1 where the first octave is the doubled image, 0 where it is the image itself."""
    intervals: int
    """s, the planes to a doubling of the blur."""
    base_sigma: float
    """Blur of the first plane of every octave, in samples of that octave."""

    def __repr__(self) -> str:
        return f"ScaleSpace({len(self.octaves)} octaves of {self.intervals} intervals)"

    def sample_distance(self, octave: int) -> float:
        """Image pixels from one sample of `octaves[octave]` to the next."""
        return 2.0 ** (octave + self.first_octave)


def gaussian_scale_space(
    gray: Float32Array,
    *,
    first_octave: int = -1,
    octaves: int = 0,
    intervals: int = 3,
    base_sigma: float = 1.6,
    camera_sigma: float = 0.5,
    kernel_radius: float = 4.0,
    shifted: bool = False,
    smallest_side: int = SMALLEST_SIDE,
) -> ScaleSpace:
    """The Gaussian scale space of a grey image.

    Args:
        gray: (H, W).
        first_octave: -1 to double the image first, 0 to start from the image.
        octaves: how many at most; 0 for as many as the image has room for.
        intervals: s, the scales to an octave.
        base_sigma: blur of the first plane of every octave, in its own samples.
        camera_sigma: blur that the image is assumed to have, in pixels.
        kernel_radius: where the Gaussian kernel is cut, in sigmas.
        shifted: double by `cv2.resize`, which moves the image by a quarter pixel.
        smallest_side: octaves narrower than this are left out.

    Returns:
        Octaves of float32 planes; none where the image is smaller than `smallest_side`.

    Source: Lowe (2004), section 3; equations B.1-B.2.
    """
    plane = gray
    blur = camera_sigma
    if first_octave < 0:
        plane = double_shifted(gray) if shifted else double(gray)
        blur = 2 * camera_sigma
    sigmas = [base_sigma * 2 ** (i / intervals) for i in range(intervals + 3)]
    steps = [sqrt(after**2 - before**2) for before, after in zip(sigmas, sigmas[1:], strict=False)]

    stacks: list[Float32Array] = []
    limit = octaves or int(log2(max(plane.shape))) + 1
    while len(stacks) < limit and min(plane.shape) >= smallest_side:
        stack = np.empty((intervals + 3, *plane.shape), np.float32)
        if stacks:
            stack[0] = plane
        else:
            blur_into(stack[0], plane, sqrt(max(base_sigma**2 - blur**2, 0.01)), kernel_radius)
        for i, sigma in enumerate(steps):
            blur_into(stack[i + 1], stack[i], sigma, kernel_radius)           # B.2
        stacks.append(stack)
        plane = stack[intervals, ::2, ::2]
    return ScaleSpace(tuple(stacks), first_octave, intervals, base_sigma)


def difference_of_gaussians(octave: Float32Array) -> Float32Array:
    """(s + 2, h, w): each plane of an octave taken from the next (B.3)."""
    differences: Float32Array = np.diff(octave, axis=0)
    return differences


def double(gray: Float32Array) -> Float32Array:
    """(2H - 1, 2W - 1): every pixel in its place, and linear means halfway between.

    Sample (2x, 2y) lies exactly on pixel (x, y), so that places need only be halved.
    """
    height, width = gray.shape
    doubled = np.empty((2 * height - 1, 2 * width - 1), np.float32)
    doubled[::2, ::2] = gray
    doubled[::2, 1::2] = (gray[:, :-1] + gray[:, 1:]) * np.float32(0.5)
    doubled[1::2] = (doubled[:-2:2] + doubled[2::2]) * np.float32(0.5)
    return doubled


def double_shifted(gray: Float32Array) -> Float32Array:
    """(2H, 2W), aligned at the image's edges: sample X lies at pixel X / 2 - 1 / 4."""
    doubled: Float32Array = cv2.resize(gray, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    return doubled


def blur_into(out: Float32Array, plane: Float32Array, sigma: float, kernel_radius: float) -> None:
    """Fill `out` with `plane` under a Gaussian cut at `kernel_radius` sigmas, mirrored outside."""
    size = round(2 * kernel_radius * sigma + 1) | 1
    cv2.GaussianBlur(plane, (size, size), sigma, dst=out, borderType=cv2.BORDER_REFLECT_101)
