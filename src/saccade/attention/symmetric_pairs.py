"""Which pairs of gradients make a place symmetric: for pictures, and to tell why a place won."""

import numpy as np

from saccade._pair_sums_kernels import MARGIN
from saccade.attention.symmetry import existing_levels, steps_of, symmetry_at
from saccade.attention.symmetry_config import SymmetryConfig
from saccade.errors import ImageError, require
from saccade.image import check_image
from saccade.pair_sums import Gradients, PairKernel, gradients_of, pair_kernel
from saccade.pyramid import FloatMap, cell_centers
from saccade.types import FloatArray, Image, IntArray, SymmetricPairs


def symmetric_pairs(
    image: Image,
    xy: tuple[float, float],
    config: SymmetryConfig | None = None,
    *,
    radius: float = 0.0,
    max_pairs: int = 4,
) -> SymmetricPairs:
    """The pairs of gradients that contribute most to the symmetry of a place at each level.

    A pair counts by its phase, strength and distance, times the weight of its level; the weight
    by which radial symmetry compares axes is left out, since it would hide the strongest.

    Args:
        image: (H, W) or (H, W, 3) RGB, any dtype that `saccade.types.Image` names.
        xy: the place in image pixels.
        config: as for `symmetry_saliency`.
        radius: radius in pixels about the place; each level takes the most symmetric of its
            cells there. At 0 it is the cell at the place.
        max_pairs: how many pairs of each level at most.

    Returns:
        The pairs, the strongest first; fewer, or none, where nothing is symmetric.

    Raises:
        ImageError: as `symmetry_saliency`, or the place lies outside the image.
    """
    require(max_pairs >= 1, "max_pairs", "at least 1", max_pairs)
    require(radius >= 0, "radius", "0 px or more", radius)
    pixels = check_image(image)
    shape = pixels.shape[:2]
    if not (-0.5 <= xy[0] < shape[1] - 0.5 and -0.5 <= xy[1] < shape[0] - 0.5):
        raise ImageError(f"place: expected inside {shape[1]} x {shape[0]} px, found {xy}")
    config = (config or SymmetryConfig()).at_size(shape)
    steps = steps_of(config)
    kernel = pair_kernel(config.inner, config.outer, config.sigma)
    weights = dict(zip(config.levels, config.level_weights, strict=True))
    found = []
    channels_at = steps.channels(pixels, existing_levels(shape, config, steps))
    for number, channels in channels_at.items():
        symmetry = symmetry_at(channels, kernel, config, steps)
        row, column = most_symmetric(symmetry, xy, radius, shape)
        gradients = [
            gradients_of(c, config.gain, steps.border) for c in np.moveaxis(channels, 2, 0)
        ]
        one, two, angle, other, strength = pairs_about(
            row, column, gradients, kernel, config.kind == "color"
        )
        first, second = (
            cell_centers(each[:, 0], each[:, 1], symmetry.shape, shape) for each in (one, two)
        )
        strongest = np.argsort(-strength, kind="stable")[:max_pairs]
        strength *= weights[number]
        level = np.full(len(strength), number)
        found.append(SymmetricPairs(first, second, angle, other, strength, level)[strongest])
    together = SymmetricPairs(
        *(np.concatenate(parts) for parts in zip(*(vars(p).values() for p in found), strict=True))
    )
    order = np.argsort(-together.strength, kind="stable")
    return together[order[together.strength[order] > 0]]


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
    row: int, column: int, channels: list[Gradients], kernel: PairKernel, across: bool
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Cells, angles and strengths of the pairs about a cell.

    Args:
        row: of the cell.
        column: of the cell.
        channels: gradients of equal shape.
        kernel: the pairs.
        across: whether the two of a pair may come from different channels, as color symmetry
            has it.

    Returns:
        (n, 2) row and column of the first and of the second, (n,) angles of their gradients,
        (n,) strengths.
    """
    height, width = channels[0].strength.shape
    dx, dy = kernel.offsets.T
    fits = (row - dy >= MARGIN) & (row + dy < height - MARGIN)
    fits &= (column - abs(dx) >= MARGIN) & (column + abs(dx) < width - MARGIN)
    dx, dy, weight = dx[fits], dy[fits], kernel.weights[fits]
    alpha = np.arctan2(dy, dx)
    first, second = (row + dy, column + dx), (row - dy, column - dx)
    found = []
    for a in channels:
        for b in channels if across else [a]:
            theta_i, theta_j = (
                np.arctan2(g.sine[at], g.cosine[at]) for g, at in ((a, first), (b, second))
            )
            g_i, g_j = theta_i - alpha, theta_j - alpha
            if across:
                phase = (np.cos(g_i + g_j) * np.cos(g_i) * np.cos(g_j)) ** 2
            else:
                phase = (1 - np.cos(g_i + g_j)) * (1 - np.cos(g_i - g_j))
            strength = phase * a.strength[first] * b.strength[second] * weight
            cells = np.stack(first, axis=1), np.stack(second, axis=1)
            found.append((*cells, theta_i, theta_j, strength.astype(np.float64)))
    one, two, angle, other, strength = (np.concatenate(each) for each in zip(*found, strict=True))
    return one, two, angle, other, strength
