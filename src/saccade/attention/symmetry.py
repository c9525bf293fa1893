"""Symmetry saliency: local mirror symmetry of gradients about every pixel, at several scales.

After Reisfeld, Wolfson & Yeshurun (1995), Heidemann (2004) and Kootstra, de Boer & Schomaker
(2011). About every pixel of every level, the pairs (i, j) of gradients that lie opposite each
other contribute:

    alpha      direction of the line from i to j, point-symmetric about the pixel
    gamma      theta - alpha, with the direction theta of a gradient
    phase      (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j))
    strength   log(1 + m_i) log(1 + m_j), with the magnitude m of a gradient
    distance   exp(-d^2 / (2 sigma^2)) / (sigma sqrt(2 pi)), with the distance d of i and j
    symmetry   the sum over the pairs of the product of the three
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import OPPONENT, whitened
from saccade.attention.models import SaliencyMaps
from saccade.attention.normalize import rescale, sharpen, smooth
from saccade.attention.symmetry_2010 import Kootstra2010Pyramid
from saccade.attention.symmetry_config import SymmetryConfig
from saccade.errors import ImageError
from saccade.io.image import check_image, in_unit_range
from saccade.scale._pair_sums_kernels import MARGIN
from saccade.scale.pair_sums import (
    Gradients,
    PairKernel,
    color_sums,
    fraction_inside,
    gradients_of,
    isotropic_sums,
    pair_kernel,
    radial_sums,
)
from saccade.scale.pyramid import FloatMap, half_shape, halve, level_shape, resize
from saccade.types import Float32Array, Image

__all__ = ["SymmetryConfig", "SymmetryMaps", "symmetry_saliency"]

SUMS = {"isotropic": isotropic_sums, "radial": radial_sums, "color": color_sums}

RADIAL_FRACTION = 1.4
"""Where a fraction of the pairs lies inside the image their axes are similar, and on noise the
radial sum is that fraction to this power of the full sum; measured for rings of 1 to 4 and of 3 to
7 pixels."""


@dataclass(frozen=True, eq=False, repr=False)
class SymmetryMaps(SaliencyMaps):
    """Saliency and the symmetry of each level.

    The maps are float32, and their cells tile the image: see `saccade.scale.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) in [0, 1]."""
    levels: Mapping[int, FloatMap]
    """By number of the pyramid level: (h, w) symmetry, not negative, not scaled."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""


def symmetry_saliency(
    image: Image, config: SymmetryConfig | None = None, *, bgr: bool = False
) -> SymmetryMaps:
    """Saliency from local symmetry.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: kind, scales and kernel; presets name their source.
        bgr: whether the image has OpenCV's order of colors, as `cv2.imread` returns it.

    Returns:
        Saliency (h, w), h = H / 2**map_level rounded up, with the level of
        `config.at_size((H, W))`, and the symmetry at each level.

    Raises:
        ImageError: not an image, not finite, or too small for a pair at the finest level.

    Source: Kootstra, de Boer & Schomaker (2011); the phase weight is that of Reisfeld,
    Wolfson & Yeshurun (1995).
    """
    pixels = check_image(image, bgr=bgr)  # (H, W) or (H, W, 3)
    shape = pixels.shape[:2]
    config = (config or SymmetryConfig()).at_size(shape)
    pyramid = pyramid_of(config)
    pairs = pair_kernel(config.inner, config.outer, config.sigma)
    symmetry = {
        number: symmetry_at(gradients, pairs, config)
        for number, gradients in gradient_pyramid(pixels, config, pyramid).items()
    }
    summed = np.zeros(pyramid.level_shape(shape, config.map_level), np.float32)  # (h, w)
    for number, weight in zip(config.levels, config.level_weights, strict=True):
        if number in symmetry:
            summed += np.float32(weight) * resize(symmetry[number], summed.shape)
    saliency = sharpen(rescale(smooth(summed, config.smoothing)), config.sharpening)
    return SymmetryMaps(saliency, symmetry, shape)


def gradient_pyramid(
    pixels: npt.NDArray[Any], config: SymmetryConfig, pyramid: "Pyramid"
) -> dict[int, list[Gradients]]:
    """The gradients of each channel by level, for the levels that the image has."""
    levels = existing_levels(pixels.shape[:2], config, pyramid)
    return {
        number: [
            gradients_of(channel, config.gain, pyramid.border)
            for channel in np.moveaxis(channels, 2, 0)
        ]
        for number, channels in pyramid.channels(pixels, levels).items()
    }


def symmetry_at(
    gradients: list[Gradients], pairs: PairKernel, config: SymmetryConfig
) -> Float32Array:
    """(h, w) symmetry of a level."""
    sums = SUMS[config.kind](gradients, pairs)
    if config.border == "missing":
        return sums
    fraction = fraction_inside(sums.shape, pairs)
    return complete(sums, fraction**RADIAL_FRACTION if config.kind == "radial" else fraction)


def complete(sums: Float32Array, fraction: Float32Array) -> Float32Array:
    """The sums, with the average of the level for the pairs that reach beyond the border.

    Args:
        sums: (h, w) over the pairs inside the image.
        fraction: (h, w) the fraction of the full sum that these would be in a uniform image.
    """
    average = sums.sum(dtype=np.float64) / fraction.sum(dtype=np.float64)
    return sums + (1 - fraction) * np.float32(average)


def existing_levels(
    shape: tuple[int, int], config: SymmetryConfig, pyramid: "Pyramid"
) -> tuple[int, ...]:
    """The levels on which an image of this shape has a pixel with a pair about it."""
    min_longer, min_shorter = 2 * (config.inner + MARGIN) + 1, 2 * MARGIN + 1

    def has_pairs(shape: tuple[int, int]) -> bool:
        return max(shape) >= min_longer and min(shape) >= min_shorter

    levels = tuple(n for n in config.levels if has_pairs(pyramid.level_shape(shape, n)))
    if not levels or max(pyramid.level_shape(shape, config.map_level)) == 1:
        finest = config.levels[0]
        side = next(
            n
            for n in count(1)
            if has_pairs(pyramid.level_shape((n, n), finest))
            and pyramid.level_shape((n, n), config.map_level)[0] > 1
        )
        raise ImageError(
            f"image: expected at least {side} x {side} px for a pair at level {finest} and a map "
            f"at level {config.map_level}, found {shape[1]} x {shape[0]} px; "
            "enlarge it, or set finer levels"
        )
    return levels


@dataclass(frozen=True)
class MirroredPyramid:
    """The channels of an image that is mirrored at its borders, level by level."""

    config: SymmetryConfig
    border: ClassVar[int] = cv2.BORDER_REFLECT

    level_shape = staticmethod(level_shape)

    def channels(self, pixels: npt.NDArray[Any], levels: tuple[int, ...]) -> dict[int, FloatMap]:
        """(h, w, c) channels by level.

        The image is halved to the finest level before it is converted: linear channels commute
        with that, and in 8 bit it is a quarter as large.
        """
        colors = pixels
        for _ in range(levels[0]):
            colors = halve(colors)
        plane = self.split(in_unit_range(colors))
        planes = {}
        for number in range(levels[0], levels[-1] + 1):
            if number > levels[0]:
                plane = halve(plane).reshape(*half_shape(plane.shape[:2]), -1)
            if number in levels:
                planes[number] = plane
        return planes

    def split(self, colors: FloatMap) -> FloatMap:
        """(h, w, c) channels of gray, or of RGB in [0, 1]."""
        if self.config.channels == "whitened":
            return whitened(colors)
        if colors.ndim == 2:
            return colors[:, :, None]
        if self.config.channels == "rgb":
            return colors
        transform = OPPONENT if self.config.channels == "opponent" else OPPONENT[:1]
        return cv2.transform(colors, transform).reshape(*colors.shape[:2], -1)


Pyramid: TypeAlias = MirroredPyramid | Kootstra2010Pyramid


def pyramid_of(config: SymmetryConfig) -> Pyramid:
    """The pyramid of the arithmetic that the configuration names."""
    source = config.arithmetic == "kootstra2010"
    return Kootstra2010Pyramid(config) if source else MirroredPyramid(config)
