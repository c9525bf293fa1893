"""Symmetry saliency: local mirror symmetry of gradients about every pixel, at several scales.

After Reisfeld, Wolfson & Yeshurun (1995) and Kootstra, de Boer & Schomaker (2011). About every
pixel of every level, the pairs (i, j) of gradients that lie opposite each other contribute:

    alpha      direction of the line from i to j, point-symmetric about the pixel
    gamma      theta - alpha, with the direction theta of a gradient
    phase      (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j))
    strength   log(1 + m_i) log(1 + m_j), with the magnitude m of a gradient
    distance   exp(-d^2 / (2 sigma^2)) / (sigma sqrt(2 pi)), with the distance d of i and j
    symmetry   the sum over the pairs of the product of the three

The authors' release of 2010, inferred from its output alone, differs in the following:

- The weights of red and blue in gray are exchanged, and gray is rounded to 8 bit and divided by
  256. Without the former the maps of colored images correlate by .84 at worst.
- A level is the previous one filtered by [1 2 1] / 4 along both axes and resized bilinearly. Its
  sides are half of the previous, rounded down up to the finest level that counts, and from there on
  to the nearest integer, ties to even.
- Gradients reflect about the center of the outermost pixel.
- The ring of pairs reaches from 3 to 7 pixels: the given radius of 8 is exclusive.

Left out are its tables of logarithms and cosines: they cost at most 4e-4 of correlation, where
all symmetries are the faint ones of a flat background.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal, Self

import cv2
import numpy as np
import numpy.typing as npt

from saccade.attention.channels import intensity, whitened
from saccade.attention.maps import SaliencyMaps
from saccade.attention.normalize import rescale, sharpen, smooth
from saccade.errors import ImageError, Settings, require, setting
from saccade.io.image import check_image, in_unit_range
from saccade.scale._pair_sums_kernels import BORDER_WIDTH
from saccade.scale.pair_sums import (
    Gradients,
    PairKernel,
    fraction_inside,
    gradients_of,
    isotropic_sums,
    pair_kernel,
    radial_sums,
)
from saccade.scale.pyramid import (
    MAX_LEVEL,
    FloatMap,
    cell_centers,
    coarser_levels,
    half_shape,
    halve,
    level_shape,
    resize,
)
from saccade.types import Float32Array, Image, SymmetricPairs

Kind = Literal["isotropic", "radial"]
Channels = Literal["whitened", "gray"]
Border = Literal["average", "missing"]
Variant = Literal["mirrored", "kootstra2010"]

SUMS = {"isotropic": isotropic_sums, "radial": radial_sums}

RADIAL_FRACTION = 1.4
"""Exponent of the border correction for radial symmetry: with a fraction f of the pairs inside the
image, the radial sum on noise is f to this power of the full sum. Measured for rings of 1 to 4 and
of 3 to 7 pixels."""

SWAPPED_LUMA = (0.114, 0.587, 0.299)
"""Weights of red, green and blue in the gray of the release of 2010."""


@dataclass(frozen=True)
class SymmetryConfig(Settings):
    """Kind, scales and kernel of the symmetry transform.

    The default predicts human fixations best; docs/symmetry.md describes how it was chosen.
    """

    kind: Kind = "radial"
    """Weighting of the pairs' axes: "isotropic" weights all equally; "radial" (Reisfeld, Wolfson &
    Yeshurun 1995) gives the least weight to axes parallel to the strongest axis."""
    channels: Channels = "whitened"
    """Channels of the gradients: three decorrelated color channels of unit variance, or the
    intensity of a gray image."""
    levels: tuple[int, ...] = (1, 2, 3, 4, 5)
    """Pyramid levels; the image is level 0."""
    level_weights: tuple[float, ...] = (3.0, 2.0, 1.0, 1.0, 1.0)
    """Weight of each of `levels`."""
    inner: int = setting(1, 1)
    """Minimum distance of a pair from its center, along x or y, in pixels of the level."""
    outer: int = setting(4, 1, 100)
    """Maximum distance of a pair from its center, along x or y, in pixels of the level."""
    sigma: float = setting(4.0, 0.1)
    """Standard deviation of the Gaussian weight of the pair's distance, in pixels of the level."""
    gain: float = setting(18.0, above=0, maximum=1e6)
    """Gain of the gradient strength log(1 + gain m), with the Sobel magnitude m, which is 4 at an
    edge between black and white."""
    border: Border = "average"
    """Value of pairs that extend beyond the image: the "average" of the level, or 0 with "missing",
    which causes a center bias."""
    map_level: int = setting(4, 0, MAX_LEVEL)
    """Pyramid level that sets the size of the saliency."""
    smoothing: float = setting(0.75, 0)
    """Standard deviation, in cells, of the Gaussian that smooths the sum over the levels."""
    sharpening: float = setting(2.0, above=0, maximum=100)
    """Exponent applied to the saliency scaled to [0, 1]."""
    viewing_size: int | None = setting(800, 1)
    """Reference length in pixels of the longer side of an image. Doubling the image size makes
    every level one coarser and halving it one finer; None uses the levels unchanged."""
    variant: Variant = "mirrored"
    """Computation of the levels: "mirrored" reflects the image at its borders;
    `saccade.attention.symmetry` describes "kootstra2010"."""

    def __post_init__(self) -> None:
        super().__post_init__()
        inside = all(0 <= level <= MAX_LEVEL for level in self.levels)
        rising = all(finer < coarser for finer, coarser in pairwise(self.levels))
        expected = f"rising levels from 0 to {MAX_LEVEL}"
        require(len(self.levels) > 0 and inside and rising, "levels", expected, self.levels)
        require(
            len(self.level_weights) == len(self.levels)
            and all(0 < weight < np.inf for weight in self.level_weights),
            "level_weights",
            f"a finite weight above 0 for each of the {len(self.levels)} levels",
            self.level_weights,
        )
        require(self.inner <= self.outer, "inner", f"1 px to {self.outer}", self.inner)
        expected = '"gray" for the variant kootstra2010'
        possible = self.variant != "kootstra2010" or self.channels == "gray"
        require(possible, "channels", expected, self.channels)

    def at_size(self, shape: tuple[int, int]) -> "SymmetryConfig":
        """Returns the configuration with its levels adapted to an image of (H, W) pixels.

        No level becomes finer than the image itself, and no map finer than level 1.
        """
        if self.viewing_size is None:
            return self
        coarser = coarser_levels(shape, self.viewing_size, self.levels[0], self.map_level)
        return _coarser(self, coarser)

    @classmethod
    def kootstra2010(cls) -> Self:
        """The authors' release of 2010: gray, levels 3 to 5, map at level 3.

        `kind="radial"` gives their radial symmetry. If the levels change, set `map_level` too.
        """
        return cls(
            kind="isotropic",
            channels="gray",
            levels=(3, 4, 5),
            level_weights=(1.0, 1.0, 1.0),
            inner=3,
            outer=7,
            sigma=16.0,
            gain=1.0,
            border="missing",
            map_level=3,
            smoothing=0.0,
            sharpening=1.0,
            viewing_size=None,
            variant="kootstra2010",
        )


DEFAULT = SymmetryConfig()
"""The default settings, validated once."""


@lru_cache(maxsize=64)
def _coarser(config: SymmetryConfig, levels: int) -> SymmetryConfig:
    """The configuration with coarser levels, cached since validation takes a third of a ms."""
    return replace(
        config,
        levels=tuple(level + levels for level in config.levels),
        map_level=config.map_level + levels,
        viewing_size=None,
    )


@dataclass(frozen=True, eq=False, repr=False)
class SymmetryMaps(SaliencyMaps):
    """Saliency in [0, 1] and the symmetry of each level; (h, w) float32."""

    levels: Mapping[int, FloatMap]
    """(h, w) symmetry by pyramid level, nonnegative and unscaled."""


def symmetry_saliency(
    image: Image, config: SymmetryConfig | None = None, *, bgr: bool = False
) -> SymmetryMaps:
    """Symmetry saliency: local mirror symmetry at several scales.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        config: kind, scales and kernel; the presets cite their sources.
        bgr: True for an image in OpenCV's channel order, as `cv2.imread` returns it.

    Returns:
        Saliency (h, w), with h = H / 2**map_level rounded up and `map_level` taken from
        `config.at_size((H, W))`, and the symmetry at each level.

    Raises:
        ImageError: the input is not an image, not finite, or too small for a pair at the finest
            level.

    Source: Kootstra, de Boer & Schomaker (2011); phase weight from Reisfeld, Wolfson & Yeshurun
    (1995).
    """
    return symmetry_maps(check_image(image, bgr=bgr), config)


def symmetry_maps(pixels: npt.NDArray[Any], config: SymmetryConfig | None = None) -> SymmetryMaps:
    """Symmetry saliency of a validated image; see `symmetry_saliency`."""
    shape = pixels.shape[:2]
    config = (config or DEFAULT).at_size(shape)
    pairs = pair_kernel(config.inner, config.outer, config.sigma)
    symmetry = {
        number: symmetry_at(gradients, pairs, config)
        for number, gradients in gradient_pyramid(pixels, config).items()
    }
    summed = np.zeros(shape_of_level(shape, config.map_level, config), np.float32)  # (h, w)
    for number, weight in zip(config.levels, config.level_weights, strict=True):
        if number in symmetry:
            summed += np.float32(weight) * resize(symmetry[number], summed.shape)
    saliency = sharpen(rescale(smooth(summed, config.smoothing)), config.sharpening)
    return SymmetryMaps(saliency, shape, symmetry)


def gradient_pyramid(
    pixels: npt.NDArray[Any], config: SymmetryConfig
) -> dict[int, list[Gradients]]:
    """Gradients of each channel by level, for the levels that exist in the image."""
    levels = existing_levels(pixels.shape[:2], config)
    mirrored = config.variant == "mirrored"
    border = cv2.BORDER_REFLECT if mirrored else cv2.BORDER_REFLECT_101
    channels = mirrored_channels if mirrored else gray_levels_2010
    return {
        number: [
            gradients_of(channel, config.gain, border) for channel in np.moveaxis(planes, 2, 0)
        ]
        for number, planes in channels(pixels, levels, config).items()
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
    """Corrects the sums at the border, where pairs are missing, by the average of the level.

    Args:
        sums: (h, w) sums over the pairs inside the image.
        fraction: (h, w) sums as fractions of the full sum in a uniform image.
    """
    average = sums.sum(dtype=np.float64) / fraction.sum(dtype=np.float64)
    return sums + (1 - fraction) * np.float32(average)


def existing_levels(shape: tuple[int, int], config: SymmetryConfig) -> tuple[int, ...]:
    """Levels on which an image of this shape is large enough for a pair."""
    min_longer, min_shorter = 2 * (config.inner + BORDER_WIDTH) + 1, 2 * BORDER_WIDTH + 1

    def has_pairs(shape: tuple[int, int]) -> bool:
        return max(shape) >= min_longer and min(shape) >= min_shorter

    levels = tuple(n for n in config.levels if has_pairs(shape_of_level(shape, n, config)))
    if not levels or max(shape_of_level(shape, config.map_level, config)) == 1:
        raise ImageError(
            f"image: expected more pixels for level {config.levels[0]} and map level "
            f"{config.map_level}, found {shape[1]} x {shape[0]} px; enlarge it, or set finer levels"
        )
    return levels


def shape_of_level(shape: tuple[int, int], level: int, config: SymmetryConfig) -> tuple[int, int]:
    """Shape of a level; the image is level 0."""
    if config.variant == "mirrored":
        return level_shape(shape, level)
    height, width = shape
    for number in range(1, level + 1):
        floor = number <= config.levels[0]
        height, width = (side // 2 if floor else round(side / 2) for side in (height, width))
    return height, width


def mirrored_channels(
    pixels: npt.NDArray[Any], levels: tuple[int, ...], config: SymmetryConfig
) -> dict[int, FloatMap]:
    """(h, w, c) channels by level, with mirrored image borders.

    The image is halved to the finest level before conversion, which commutes with linear channels;
    an 8-bit image takes a quarter of the memory.
    """
    colors = pixels
    for _ in range(levels[0]):
        colors = halve(colors)
    plane = split_channels(in_unit_range(colors), config.channels)
    planes = {}
    for number in range(levels[0], levels[-1] + 1):
        if number > levels[0]:
            plane = halve(plane).reshape(*half_shape(plane.shape[:2]), -1)
        if number in levels:
            planes[number] = plane
    return planes


def split_channels(colors: FloatMap, channels: Channels) -> FloatMap:
    """(h, w, c) channels of a gray or RGB image in [0, 1]."""
    if channels == "whitened":
        return whitened(colors)
    return (colors if colors.ndim == 2 else intensity(colors))[:, :, None]


def gray_levels_2010(
    pixels: npt.NDArray[Any], levels: tuple[int, ...], config: SymmetryConfig
) -> dict[int, FloatMap]:
    """(h, w, 1) gray levels as in the release of 2010, by level."""
    gray = in_unit_range(pixels)
    if gray.ndim == 3:
        gray = cv2.transform(gray, np.array([SWAPPED_LUMA]))
    plane = np.rint(255 * gray) / np.float32(256)
    planes = {}
    for number in range(levels[-1] + 1):
        if number > 0:
            plane = cv2.GaussianBlur(plane, (3, 3), 0, borderType=cv2.BORDER_REPLICATE)
            shape = shape_of_level(pixels.shape[:2], number, config)
            plane = resize(plane, shape, cv2.INTER_LINEAR)
        if number in levels:
            planes[number] = plane[:, :, None]
    return planes


def symmetric_pairs(
    image: Image,
    xy: tuple[float, float],
    config: SymmetryConfig | None = None,
    *,
    radius: float = 0.0,
    max_pairs: int = 4,
) -> SymmetricPairs:
    """Strongest symmetric pairs of gradients around a position, at each level.

    Pairs are ranked by phase, strength and distance, times the weight of the level. The axis weight
    of radial symmetry is left out, since it would hide the strongest pairs.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        xy: position in image pixels.
        config: as for `symmetry_saliency`.
        radius: search radius in pixels around the position; each level uses the most symmetric cell
            within it, or the nearest cell.
        max_pairs: maximum number of pairs per level.

    Returns:
        The pairs, strongest first; fewer than `max_pairs`, or none, where symmetry is absent.

    Raises:
        ImageError: as `symmetry_saliency`, or the position lies outside the image.
    """
    return symmetric_pairs_at(image, [xy], config, radius=radius, max_pairs=max_pairs)[0]


def symmetric_pairs_at(
    image: Image,
    positions: Iterable[tuple[float, float]],
    config: SymmetryConfig | None = None,
    *,
    radius: float = 0.0,
    max_pairs: int = 4,
) -> list[SymmetricPairs]:
    """Symmetric pairs at each position; the symmetry of the image is computed once."""
    require(max_pairs >= 1, "max_pairs", "at least 1", max_pairs)
    require(radius >= 0, "radius", "0 px or more", radius)
    pixels, positions = check_image(image), list(positions)
    shape = pixels.shape[:2]
    for xy in positions:
        if not (-0.5 <= xy[0] < shape[1] - 0.5 and -0.5 <= xy[1] < shape[0] - 0.5):
            raise ImageError(f"position: expected inside {shape[1]} x {shape[0]} px, found {xy}")
    config = (config or DEFAULT).at_size(shape)
    kernel = pair_kernel(config.inner, config.outer, config.sigma)
    weights = dict(zip(config.levels, config.level_weights, strict=True))
    selected: list[list[SymmetricPairs]] = [[] for _ in positions]
    for number, gradients in gradient_pyramid(pixels, config).items():
        symmetry = symmetry_at(gradients, kernel, config)
        for xy, parts in zip(positions, selected, strict=True):
            cell = most_symmetric(symmetry, xy, radius, shape)
            pairs = pairs_about(cell, gradients, kernel, number, weights[number], shape)
            parts.append(strongest_first(pairs)[:max_pairs])
    return [strongest_first(SymmetricPairs.concatenate(parts)) for parts in selected]


def strongest_first(pairs: SymmetricPairs) -> SymmetricPairs:
    """The pairs of nonzero strength in descending order of strength."""
    order = np.argsort(-pairs.strength, kind="stable")
    return pairs[order[pairs.strength[order] > 0]]


def most_symmetric(
    symmetry: FloatMap, xy: tuple[float, float], radius: float, shape: tuple[int, int]
) -> tuple[int, int]:
    """Row and column of the highest cell with its center within a radius, or the nearest cell."""
    rows, columns = (index.ravel() for index in np.indices(symmetry.shape))
    distance = np.hypot(*(cell_centers(rows, columns, symmetry.shape, shape) - xy).T)
    near = distance <= max(radius, float(distance.min()))
    best = int(np.argmax(np.where(near, symmetry.ravel(), -1)))
    return int(rows[best]), int(columns[best])


def pairs_about(
    cell: tuple[int, int],
    channels: list[Gradients],
    kernel: PairKernel,
    level: int,
    level_weight: float,
    image_shape: tuple[int, int],
) -> SymmetricPairs:
    """The pairs around a cell (row, column), in the order of channels and kernel."""
    row, column = cell
    height, width = shape = channels[0].strength.shape
    dx, dy = kernel.offsets.T
    inside = (row - dy >= BORDER_WIDTH) & (row + dy < height - BORDER_WIDTH)
    inside &= (column - abs(dx) >= BORDER_WIDTH) & (column + abs(dx) < width - BORDER_WIDTH)
    dx, dy, (e_x, e_y) = dx[inside], dy[inside], kernel.directions[inside].T
    weight = level_weight * kernel.weights[inside].astype(np.float64)
    i, j = (row + dy, column + dx), (row - dy, column - dx)
    parts = []
    for strength, cosine, sine in channels:
        p = e_x * (cosine[i] - cosine[j]) + e_y * (sine[i] - sine[j])
        parts.append(
            SymmetricPairs(
                first=cell_centers(*i, shape, image_shape),
                second=cell_centers(*j, shape, image_shape),
                first_angle=np.arctan2(sine[i], cosine[i]),
                second_angle=np.arctan2(sine[j], cosine[j]),
                strength=weight * strength[i] * strength[j] * p**2,
                level=np.full(len(p), level),
            )
        )
    return SymmetricPairs.concatenate(parts)
