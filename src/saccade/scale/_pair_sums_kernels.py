"""Sums over the pairs of gradients about each pixel, compiled: see `saccade.scale.pair_sums`."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

MARGIN = 1
"""Outermost pixels, which take part in no pair: half of their gradient lies beyond the border."""
UNSIGNED = np.uintp
"""The kernels' indices: Numba need not check whether these count from the end."""


class PairKernel(NamedTuple):
    """The pairs about a pixel and their weights; each pair stands once."""

    offsets: IntArray
    """(n, 2) dx and dy from the pixel to the first of the pair; the second lies opposite."""
    directions: Float32Array
    """(n, 2) unit vectors along the line through the pair."""
    weights: Float32Array
    """(n,) by their distance."""

    def scaled(self) -> "PairKernel":
        """With directions scaled by the square root of the weight."""
        return self._replace(directions=self.directions * np.sqrt(self.weights)[:, None])


class Gradients(NamedTuple):
    """The gradients of a channel."""

    strength: Float32Array
    """(h, w) float32, as the others: log(1 + gain m), m the magnitude by 3x3 Sobel filters."""
    cosine: Float32Array
    """(h, w) of the direction; 0, as the sine is, where there is none."""
    sine: Float32Array
    """(h, w) of the direction, from x towards y."""


@kernel(fastmath=("contract",))
def add_isotropic(gradients: Gradients, pairs: PairKernel, out: Float32Array) -> None:
    """Add to each pixel the terms of its `PairKernel.scaled` pairs."""
    strength, cosine, sine = gradients
    offsets, directions = pairs.offsets, pairs.directions
    height, width = strength.shape
    for y in range(height):
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + MARGIN
            if not (y - dy >= MARGIN and y + dy < height - MARGIN and 2 * edge < width):
                continue
            e_x, e_y = directions[k]
            row, up, down = UNSIGNED(y), UNSIGNED(y + dy), UNSIGNED(y - dy)
            start, first, second = UNSIGNED(edge), UNSIGNED(edge + dx), UNSIGNED(edge - dx)
            for x in range(UNSIGNED(width - 2 * edge)):
                i, j = first + x, second + x
                p = e_x * (cosine[up, i] - cosine[down, j]) + e_y * (sine[up, i] - sine[down, j])
                out[row, start + x] += strength[up, i] * strength[down, j] * (p * p)


@kernel(fastmath=("contract",))
def add_radial(gradients: Gradients, pairs: PairKernel, out: Float32Array) -> None:
    """Add to each pixel the terms of its scaled pairs, weighted by the angle from the strongest.

    Since sin^2(phi - phi_max) = (1 - cos(2 phi) cos(2 phi_max) - sin(2 phi) sin(2 phi_max)) / 2,
    one pass over the pairs is enough: it sums terms, and terms times cos and sin of 2 phi, and
    keeps the strongest.
    """
    strength, cosine, sine = gradients
    offsets, directions = pairs.offsets, pairs.directions
    height, width = strength.shape
    rows = np.empty((6, width), np.float32)
    total, total_cos, total_sin, highest, highest_cos, highest_sin = rows
    for y in range(height):
        for sums in rows:
            for column in range(width):
                sums[column] = 0
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + MARGIN
            if not (y - dy >= MARGIN and y + dy < height - MARGIN and 2 * edge < width):
                continue
            e_x, e_y = directions[k]
            up, down, start = UNSIGNED(y + dy), UNSIGNED(y - dy), UNSIGNED(edge)
            first, second = UNSIGNED(edge + dx), UNSIGNED(edge - dx)
            for x in range(UNSIGNED(width - 2 * edge)):
                i, j, center = first + x, second + x, start + x
                c_i, s_i, c_j, s_j = cosine[up, i], sine[up, i], cosine[down, j], sine[down, j]
                p = e_x * (c_i - c_j) + e_y * (s_i - s_j)
                term = strength[up, i] * strength[down, j] * (p * p)
                cos, sin = c_i * c_j - s_i * s_j, s_i * c_j + c_i * s_j
                total[center] += term
                total_cos[center] += term * cos
                total_sin[center] += term * sin
                if term > highest[center]:
                    highest[center] = term
                    highest_cos[center], highest_sin[center] = cos, sin
        for x in range(width):
            along = total_cos[x] * highest_cos[x] + total_sin[x] * highest_sin[x]
            out[y, x] += np.float32(0.5) * (total[x] - along)
