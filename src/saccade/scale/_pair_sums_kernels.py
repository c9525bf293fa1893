"""Compiled sums over symmetric pairs of gradients; see `saccade.scale.pair_sums`."""

from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.types import Float32Array, IntArray

BORDER_WIDTH = 1
"""Width of the border without pairs, where half of the gradient lies outside the image."""
UNSIGNED = np.uintp
"""Index type of the kernels, which spares Numba the check for negative indices."""


class PairKernel(NamedTuple):
    """Pairs around a pixel with their weights; each pair is listed once."""

    offsets: IntArray
    """(n, 2) dx and dy from the pixel to the first point of the pair; the second lies opposite."""
    directions: Float32Array
    """(n, 2) unit vectors along the line through the pair."""
    weights: Float32Array
    """(n,) weights by distance."""

    def scaled(self) -> "PairKernel":
        """The kernel with directions scaled by the square root of the weight."""
        return self._replace(directions=self.directions * np.sqrt(self.weights)[:, None])


class Gradients(NamedTuple):
    """The gradients of a channel."""

    strength: Float32Array
    """(h, w) float32 log(1 + gain m), with the magnitude m of 3x3 Sobel filters."""
    cosine: Float32Array
    """(h, w) cosine of the direction; cosine and sine are 0 without a direction."""
    sine: Float32Array
    """(h, w) sine of the direction, from x towards y."""


@kernel(fastmath=("contract",))
def add_isotropic(gradients: Gradients, pairs: PairKernel, out: Float32Array) -> None:
    """Adds to each pixel the terms of its `PairKernel.scaled` pairs."""
    strength, cosine, sine = gradients
    offsets, directions = pairs.offsets, pairs.directions
    height, width = strength.shape
    for y in range(height):
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + BORDER_WIDTH
            if not (y - dy >= BORDER_WIDTH and y + dy < height - BORDER_WIDTH and 2 * edge < width):
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
    """Adds to each pixel the terms of its scaled pairs, weighted by the angle to the strongest.

    Since sin^2(phi - phi_max) = (1 - cos(2 phi) cos(2 phi_max) - sin(2 phi) sin(2 phi_max)) / 2,
    a single pass over the pairs suffices: it sums the terms and the terms times cos and sin of 2
    phi, and records the strongest pair.
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
            edge = abs(dx) + BORDER_WIDTH
            if not (y - dy >= BORDER_WIDTH and y + dy < height - BORDER_WIDTH and 2 * edge < width):
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
