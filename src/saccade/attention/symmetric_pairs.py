"""The pairs of gradients that contribute most to the symmetry at a position."""

from collections.abc import Iterable
from dataclasses import fields

import numpy as np

from saccade.attention.symmetry import SymmetryConfig, gradient_pyramid, symmetry_at
from saccade.errors import ImageError, require
from saccade.io.image import check_image
from saccade.scale._pair_sums_kernels import MARGIN
from saccade.scale.pair_sums import Gradients, PairKernel, pair_kernel
from saccade.scale.pyramid import FloatMap, cell_centers
from saccade.types import Image, SymmetricPairs


def symmetric_pairs(
    image: Image,
    xy: tuple[float, float],
    config: SymmetryConfig | None = None,
    *,
    radius: float = 0.0,
    max_pairs: int = 4,
) -> SymmetricPairs:
    """The pairs of gradients that contribute most to the symmetry of a position at each level.

    A pair counts by its phase, strength and distance, times the weight of its level; the weight
    by which radial symmetry compares axes is left out, since it would hide the strongest.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        xy: position in image pixels.
        config: as for `symmetry_saliency`.
        radius: in pixels about the position; each level takes the most symmetric of its cells
            within it, or the nearest cell.
        max_pairs: maximum number of pairs per level.

    Returns:
        The pairs, the strongest first; fewer, or none, where nothing is symmetric.

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
    """`symmetric_pairs` at each position; the symmetry of the image is computed once."""
    require(max_pairs >= 1, "max_pairs", "at least 1", max_pairs)
    require(radius >= 0, "radius", "0 px or more", radius)
    pixels, positions = check_image(image), list(positions)
    shape = pixels.shape[:2]
    for xy in positions:
        if not (-0.5 <= xy[0] < shape[1] - 0.5 and -0.5 <= xy[1] < shape[0] - 0.5):
            raise ImageError(f"position: expected inside {shape[1]} x {shape[0]} px, found {xy}")
    config = (config or SymmetryConfig()).at_size(shape)
    kernel = pair_kernel(config.inner, config.outer, config.sigma)
    weights = dict(zip(config.levels, config.level_weights, strict=True))
    selected: list[list[SymmetricPairs]] = [[] for _ in positions]
    for number, gradients in gradient_pyramid(pixels, config).items():
        symmetry = symmetry_at(gradients, kernel, config)
        for xy, parts in zip(positions, selected, strict=True):
            cell = most_symmetric(symmetry, xy, radius, shape)
            pairs = pairs_about(cell, gradients, kernel, number, shape, config.kind == "color")
            strongest = pairs[np.argsort(-pairs.strength, kind="stable")[:max_pairs]]
            strongest.strength[:] *= weights[number]
            parts.append(strongest)
    return [strongest_first(concatenated(parts)) for parts in selected]


def strongest_first(pairs: SymmetricPairs) -> SymmetricPairs:
    """The pairs of any strength, ordered by it."""
    order = np.argsort(-pairs.strength, kind="stable")
    return pairs[order[pairs.strength[order] > 0]]


def concatenated(parts: list[SymmetricPairs]) -> SymmetricPairs:
    """All pairs of the parts, in their order."""
    names = [field.name for field in fields(SymmetricPairs)]
    return SymmetricPairs(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in names)
    )


def most_symmetric(
    symmetry: FloatMap, xy: tuple[float, float], radius: float, shape: tuple[int, int]
) -> tuple[int, int]:
    """Row and column of the highest cell whose center lies within a radius, or of the nearest."""
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
    image_shape: tuple[int, int],
    across_channels: bool,
) -> SymmetricPairs:
    """The pairs about a cell, in the order of the channels and of the kernel.

    Args:
        cell: row and column.
        channels: gradients of equal shape.
        kernel: the pairs.
        level: number of the pyramid level.
        image_shape: (H, W) of the image.
        across_channels: whether the two of a pair may come from different channels, as in color
            symmetry.
    """
    row, column = cell
    height, width = shape = channels[0].strength.shape
    dx, dy = kernel.offsets.T
    inside = (row - dy >= MARGIN) & (row + dy < height - MARGIN)
    inside &= (column - abs(dx) >= MARGIN) & (column + abs(dx) < width - MARGIN)
    dx, dy, weight = dx[inside], dy[inside], kernel.weights[inside]
    alpha = np.arctan2(dy, dx)
    first, second = (row + dy, column + dx), (row - dy, column - dx)
    parts = []
    for a in channels:
        for b in channels if across_channels else [a]:
            theta_i = np.arctan2(a.sine[first], a.cosine[first])
            theta_j = np.arctan2(b.sine[second], b.cosine[second])
            g_i, g_j = theta_i - alpha, theta_j - alpha
            if across_channels:
                phase = (np.cos(g_i + g_j) * np.cos(g_i) * np.cos(g_j)) ** 2
            else:
                phase = (1 - np.cos(g_i + g_j)) * (1 - np.cos(g_i - g_j))
            strength = phase * a.strength[first] * b.strength[second] * weight
            parts.append(
                SymmetricPairs(
                    first=cell_centers(*first, shape, image_shape),
                    second=cell_centers(*second, shape, image_shape),
                    first_angle=theta_i,
                    second_angle=theta_j,
                    strength=strength.astype(np.float64),
                    level=np.full(len(strength), level),
                )
            )
    return concatenated(parts)
