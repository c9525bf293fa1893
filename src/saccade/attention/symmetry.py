"""Symmetry saliency: what has the same on both sides draws the eye.

After Reisfeld, Wolfson & Yeshurun (1995), Heidemann (2004) and Kootstra, de Boer & Schomaker
(2011). Around every pixel of every level, gradients that face each other across it are sought:

    alpha      direction of the line from i to j, point-symmetric about the pixel
    gamma      theta - alpha, with the direction theta of a gradient
    phase      (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j))
    strength   log(1 + m_i) log(1 + m_j), with the magnitude m of a gradient
    distance   exp(-d^2 / (2 sigma^2)) / (sigma sqrt(2 pi)), with the distance d of i and j
    symmetry   the sum over the pairs of the product of the three
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade._pair_sums_kernels import MARGIN
from saccade.attention.normalize import rescale, sharpen, smooth
from saccade.attention.symmetry_2010 import Kootstra2010Steps
from saccade.attention.symmetry_config import SymmetryConfig
from saccade.errors import ImageError
from saccade.image import check_image, in_unit_range
from saccade.pair_sums import (
    PairKernel,
    color_sums,
    fraction_inside,
    gradients_of,
    isotropic_sums,
    pair_kernel,
    radial_sums,
)
from saccade.pyramid import FloatMap, half_shape, halve, level_shape, resize
from saccade.types import Float32Array, Image

__all__ = ["SymmetryConfig", "SymmetryMaps", "symmetry_saliency"]

SUMS = {"isotropic": isotropic_sums, "radial": radial_sums, "color": color_sums}

RADIAL_FRACTION = 1.4
"""Where a part of the pairs lies inside the image their axes are alike, and on noise the radial
sum is that part to this power of the whole; measured for rings of 1 to 4 and of 3 to 7 pixels."""

OPPONENT = np.array([[1 / 3, 1 / 3, 1 / 3], [1, -1, 0], [-0.5, -0.5, 1]])
"""Intensity (A.1), red-green and blue-yellow of red, green and blue, as rows."""


@dataclass(frozen=True, eq=False, repr=False)
class SymmetryMaps:
    """Saliency and the levels that it is made of.

    The maps are float32, and their cells tile the image: see `saccade.pyramid.cell_centers`.
    """

    saliency: FloatMap
    """(h, w) in [0, 1]."""
    levels: Mapping[int, FloatMap]
    """By number of the pyramid level: (h, w) symmetry, not negative, not scaled."""
    image_shape: tuple[int, int]
    """(H, W) of the image."""

    def __repr__(self) -> str:
        height, width = self.saliency.shape
        rows, columns = self.image_shape
        return f"SymmetryMaps({width} x {height} cells of a {columns} x {rows} image)"


def symmetry_saliency(image: Image, config: SymmetryConfig | None = None) -> SymmetryMaps:
    """Where local symmetry draws the eye.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: kind, scales and kernel; presets name their source.

    Returns:
        Saliency (h, w), h = H / 2**map_level rounded up, with the level of
        `config.at_size((H, W))`, and the symmetry at each level.

    Raises:
        ImageError: not an image, not finite, or too small for a pair at the finest level.

    Source: Kootstra, de Boer & Schomaker (2011); the phase weight is that of Reisfeld,
    Wolfson & Yeshurun (1995).
    """
    pixels = check_image(image)  # (H, W), (H, W, 3) or (H, W, 4)
    shape = pixels.shape[:2]
    config = (config or SymmetryConfig()).at_size(shape)
    steps = steps_of(config)
    levels = existing_levels(shape, config, steps)
    pairs = pair_kernel(config.inner, config.outer, config.sigma)
    symmetry = {
        number: symmetry_at(channels, pairs, config, steps)
        for number, channels in steps.channels(pixels, levels).items()
    }
    summed = np.zeros(steps.level_shape(shape, config.map_level), np.float32)  # (h, w)
    for number, weight in zip(config.levels, config.level_weights, strict=True):
        if number in symmetry:
            summed += np.float32(weight) * resize(symmetry[number], summed.shape)
    saliency = sharpen(rescale(smooth(summed, config.smoothing)), config.sharpening)
    return SymmetryMaps(saliency, symmetry, shape)


def symmetry_at(
    channels: FloatMap, pairs: PairKernel, config: SymmetryConfig, steps: Steps
) -> Float32Array:
    """(h, w) symmetry of a level, from its (h, w, c) channels."""
    gradients = [
        gradients_of(channels[:, :, i], config.gain, steps.border) for i in range(channels.shape[2])
    ]
    sums = SUMS[config.kind](gradients, pairs)
    if config.border == "missing":
        return sums
    fraction = fraction_inside(sums.shape, pairs)
    return complete(sums, fraction**RADIAL_FRACTION if config.kind == "radial" else fraction)


def complete(sums: Float32Array, fraction: Float32Array) -> Float32Array:
    """The sums as if the pairs that reach beyond the border made as much as the others.

    Args:
        sums: (h, w) over the pairs inside the image.
        fraction: (h, w) what they would be by those of all pairs if every place were alike.
    """
    average = sums.sum(dtype=np.float64) / fraction.sum(dtype=np.float64)
    return sums + (1 - fraction) * np.float32(average)


def existing_levels(
    shape: tuple[int, int], config: SymmetryConfig, steps: Steps
) -> tuple[int, ...]:
    """The levels on which an image of this shape has a pixel with a pair about it."""
    longer, shorter = 2 * (config.inner + MARGIN) + 1, 2 * MARGIN + 1

    def has_room(sides: tuple[int, int]) -> bool:
        return max(sides) >= longer and min(sides) >= shorter

    levels = tuple(n for n in config.levels if has_room(steps.level_shape(shape, n)))
    cells = max(steps.level_shape(shape, config.map_level))
    if not levels or cells == 1:
        finest = config.levels[0]
        least = next(
            side
            for side in count(1)
            if has_room(steps.level_shape((side, side), finest))
            and steps.level_shape((side, side), config.map_level)[0] > 1
        )
        raise ImageError(
            f"image: expected at least {least} x {least} px for a pair at level {finest} and a map "
            f"at level {config.map_level}, found {shape[1]} x {shape[0]} px; "
            "enlarge it, or set finer levels"
        )
    return levels


def steps_of(config: SymmetryConfig) -> Steps:
    """The arithmetic that the configuration names."""
    if config.arithmetic == "kootstra2010":
        return Kootstra2010Steps(config)
    return MirroredSteps(config)


@dataclass(frozen=True)
class MirroredSteps:
    """How levels are made of an image that is mirrored at its borders."""

    config: SymmetryConfig
    border: ClassVar[int] = cv2.BORDER_REFLECT

    level_shape = staticmethod(level_shape)

    def channels(self, pixels: npt.NDArray[Any], levels: tuple[int, ...]) -> dict[int, FloatMap]:
        """(h, w, c) channels by level.

        Channels of the coarser image are the coarser level of the channels, so that those of
        the finest level are made first, of what in 8 bit is small.
        """
        colors = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[:, :, :3])
        for _ in range(levels[0]):
            colors = halve(colors)
        plane = self.split(in_unit_range(colors))
        found = {}
        for number in range(levels[0], levels[-1] + 1):
            if number > levels[0]:
                plane = halve(plane).reshape(*half_shape(plane.shape[:2]), -1)
            if number in levels:
                found[number] = plane
        return found

    def split(self, colors: FloatMap) -> FloatMap:
        """(h, w, c) channels of grey or of RGB in [0, 1]; those that are flat are left out."""
        if colors.ndim == 2:
            return colors[:, :, None]
        if self.config.channels == "rgb":
            return colors
        mixed = OPPONENT if self.config.channels == "opponent" else OPPONENT[:1]
        return cv2.transform(colors, mixed).reshape(*colors.shape[:2], -1)


Steps: TypeAlias = MirroredSteps | Kootstra2010Steps
