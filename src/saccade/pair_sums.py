"""What pairs of gradients that face each other across a pixel add up to, at one scale.

The phase weight of Reisfeld, Wolfson & Yeshurun (1995) is a square: with gamma the angle of a
gradient from the line that joins the pair, and p = cos(gamma),

    (1 - cos(gamma_i + gamma_j)) (1 - cos(gamma_i - gamma_j)) = (p_i - p_j)^2

so that neither an angle nor a cosine need be computed. That of Heidemann (2004) is a square too,
with q = sin(gamma),

    (cos(gamma_i + gamma_j) cos(gamma_i) cos(gamma_j))^2 = (p_i^2 p_j^2 - p_i q_i p_j q_j)^2

whose terms are products of one number of i and one of j: the sum over all pairs of channels is
the product of two sums over channels.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from saccade._jit import kernel
from saccade.pyramid import FloatMap
from saccade.types import Float32Array, FloatArray, IntArray

MARGIN = 1
"""Outermost pixels, which take part in no pair: half of their gradient lies beyond the border."""

Offsets: TypeAlias = npt.NDArray[np.int64]


class PairKernel(NamedTuple):
    """Which pairs count for a pixel, and how much: each pair once."""

    offsets: Offsets
    """(n, 2) dx and dy from the pixel to the first of the pair; the second lies opposite."""
    directions: Float32Array
    """(n, 2) unit vectors along the line that joins them."""
    weights: Float32Array
    """(n,) by their distance."""


class Gradients(NamedTuple):
    """The gradients of a channel."""

    strength: FloatMap
    """(h, w) float32, as the others: log(1 + gain m), m the magnitude by 3x3 Sobel filters."""
    cosine: FloatMap
    """(h, w) of the direction; 0, as the sine is, where there is none."""
    sine: FloatMap
    """(h, w) of the direction, from x towards y."""


def pair_kernel(inner: int, outer: int, sigma: float) -> PairKernel:
    """The pairs on a square ring, weighted by the normal density at their distance.

    Args:
        inner: the least distance from the pixel, along x or y, in pixels.
        outer: the largest, likewise.
        sigma: of the normal density, for the distance between the two.
    """
    offsets = np.array(
        [
            (dx, dy)
            for dy in range(outer + 1)
            for dx in range(-outer, outer + 1)
            if max(abs(dx), dy) >= inner and (dy > 0 or dx > 0)
        ]
    )
    radii = np.hypot(*offsets.T)
    density = np.exp(-((2 * radii) ** 2) / (2 * sigma**2)) / (sigma * np.sqrt(2 * np.pi))
    directions = offsets / radii[:, None]
    return PairKernel(offsets, directions.astype(np.float32), density.astype(np.float32))


def gradients_of(channel: FloatMap, gain: float, border: int = cv2.BORDER_REFLECT) -> Gradients:
    """Direction and strength of the gradients of a channel.

    Args:
        channel: (h, w), its values about 1 apart at most.
        gain: how soon the strength saturates.
        border: how the channel goes on beyond its border, as OpenCV calls it.
    """
    plane = np.ascontiguousarray(channel, np.float32)
    cosine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 1, 0, borderType=border)
    sine: FloatMap = cv2.Sobel(plane, cv2.CV_32F, 0, 1, borderType=border)
    strength = np.empty_like(plane)
    split_gradients(np.float32(gain), cosine, sine, strength)
    return Gradients(np.log1p(strength, out=strength), cosine, sine)


def isotropic_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) sum over the pairs inside the image, and over the channels.

    Args:
        channels: gradients of equal shape.
        pairs: which count.
    """
    return sums_of(add_isotropic, channels, pairs)


def radial_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """The same, with each pair weighted by how far its axis is from that of the strongest.

    The axis of a pair is phi = (theta_i + theta_j) / 2, its weight sin^2(phi - phi_max): a pixel
    with a single axis of symmetry gets nothing.
    """
    return sums_of(add_radial, channels, pairs)


def sums_of(add: Callable[..., None], channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) what a kernel adds up; to it the weight of a pair is the square of its direction."""
    sums = np.zeros_like(channels[0].strength)
    weighted = pairs.directions * np.sqrt(pairs.weights)[:, None]
    for gradients in channels:
        add(*gradients, pairs.offsets, weighted, sums)
    return sums


def color_sums(channels: list[Gradients], pairs: PairKernel) -> Float32Array:
    """(h, w) sum over the pairs, with each of the two gradients from any of the channels.

    The phase weight has the period pi: a light side may face a dark one.

    Source: Heidemann, *Focus-of-attention from local color symmetries* (TPAMI 2004).
    """
    strength = np.sum([each.strength for each in channels], axis=0)
    double, fourfold = np.zeros((2, *strength.shape), np.complex64)
    for each in channels:
        turned = (each.cosine + 1j * each.sine) ** 2
        double += each.strength * turned
        fourfold += each.strength * turned * turned
    harmonics = np.stack([strength, double.real, double.imag, fourfold.real, fourfold.imag])
    turned = (pairs.directions[:, 0] + 1j * pairs.directions[:, 1]) ** 2
    turns = np.stack([turned.real, turned.imag, (turned**2).real, (turned**2).imag], axis=1)
    sums = np.zeros(strength.shape, np.float32)
    add_color(harmonics, pairs.offsets, turns.astype(np.float32), pairs.weights, sums)
    return sums


def fraction_inside(shape: tuple[int, ...], pairs: PairKernel) -> Float32Array:
    """(h, w) weight of the pairs that lie inside the image, as part of that of all."""
    reach = int(np.abs(pairs.offsets).max())
    room = np.arange(-MARGIN, reach + 1)  # between a pixel and the outermost that takes part
    fits = (room[:, None, None] >= pairs.offsets[:, 1]) & (
        room[None, :, None] >= np.abs(pairs.offsets[:, 0])
    )
    weights = pairs.weights.astype(np.float64)
    fraction = (fits @ weights / weights.sum()).astype(np.float32)
    y, x = (
        np.minimum(np.arange(side), np.arange(side)[::-1]).clip(0, reach + MARGIN) for side in shape
    )
    return np.asarray(fraction[np.ix_(y, x)])


UNSIGNED = np.uintp
"""The kernels' indices: of these Numba need not ask whether they count from the end."""


@kernel()
def split_gradients(
    gain: np.float32, cosine: Float32Array, sine: Float32Array, strength: Float32Array
) -> None:
    """Divide gradients by their magnitude, and fill it times the gain."""
    one, least = np.float32(1), np.float32(1e-30)
    for y in range(len(strength)):
        for x in range(strength.shape[1]):
            g_x, g_y = cosine[y, x], sine[y, x]
            magnitude = np.sqrt(g_x * g_x + g_y * g_y)
            inverse = one / max(magnitude, least)
            cosine[y, x], sine[y, x] = g_x * inverse, g_y * inverse
            strength[y, x] = gain * magnitude


@kernel(fastmath=("contract",))
def add_isotropic(
    strength: Float32Array,
    cosine: Float32Array,
    sine: Float32Array,
    offsets: Offsets,
    directions: Float32Array,
    out: Float32Array,
) -> None:
    """Add to each pixel the terms of its pairs; a pair's weight is the square of its direction."""
    height, width = strength.shape
    for y in range(height):
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + MARGIN
            if not (y - dy >= MARGIN and y + dy < height - MARGIN and 2 * edge < width):
                continue
            e_x, e_y = directions[k]
            here, up, down = UNSIGNED(y), UNSIGNED(y + dy), UNSIGNED(y - dy)
            left, first, second = UNSIGNED(edge), UNSIGNED(edge + dx), UNSIGNED(edge - dx)
            for x in range(UNSIGNED(width - 2 * edge)):
                i, j = first + x, second + x
                p = e_x * (cosine[up, i] - cosine[down, j]) + e_y * (sine[up, i] - sine[down, j])
                out[here, left + x] += strength[up, i] * strength[down, j] * (p * p)


@kernel(fastmath=("contract",))
def add_radial(
    strength: Float32Array,
    cosine: Float32Array,
    sine: Float32Array,
    offsets: Offsets,
    directions: Float32Array,
    out: Float32Array,
) -> None:
    """Add to each pixel the terms of its pairs, weighted by the angle from the strongest.

    Since sin^2(phi - phi_max) = (1 - cos(2 phi) cos(2 phi_max) - sin(2 phi) sin(2 phi_max)) / 2,
    one pass over the pairs does: it sums terms, terms times cos and sin of 2 phi, and follows
    the strongest.
    """
    height, width = strength.shape
    rows = np.empty((6, width), np.float32)
    total, total_cos, total_sin, highest, highest_cos, highest_sin = rows
    for y in range(height):
        rows[:] = 0
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + MARGIN
            if not (y - dy >= MARGIN and y + dy < height - MARGIN and 2 * edge < width):
                continue
            e_x, e_y = directions[k]
            up, down, left = UNSIGNED(y + dy), UNSIGNED(y - dy), UNSIGNED(edge)
            first, second = UNSIGNED(edge + dx), UNSIGNED(edge - dx)
            for x in range(UNSIGNED(width - 2 * edge)):
                i, j, here = first + x, second + x, left + x
                c_i, s_i, c_j, s_j = cosine[up, i], sine[up, i], cosine[down, j], sine[down, j]
                p = e_x * (c_i - c_j) + e_y * (s_i - s_j)
                term = strength[up, i] * strength[down, j] * (p * p)
                cos, sin = c_i * c_j - s_i * s_j, s_i * c_j + c_i * s_j
                total[here] += term
                total_cos[here] += term * cos
                total_sin[here] += term * sin
                if term > highest[here]:
                    highest[here], highest_cos[here], highest_sin[here] = term, cos, sin
        for x in range(width):
            along = total_cos[x] * highest_cos[x] + total_sin[x] * highest_sin[x]
            out[y, x] += np.float32(0.5) * (total[x] - along)


@kernel(fastmath=("contract",))
def add_color(
    harmonics: Float32Array,
    offsets: Offsets,
    turns: Float32Array,
    weights: Float32Array,
    out: Float32Array,
) -> None:
    """Add A_i A_j - 2 B_i B_j + C_i C_j, the sums over channels of p^4, p^3 q and p^2 q^2."""
    height, width = out.shape
    rows = np.empty((6, width), np.float32)
    a_i, b_i, c_i, a_j, b_j, c_j = rows
    for y in range(height):
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            edge = abs(dx) + MARGIN
            if not (y - dy >= MARGIN and y + dy < height - MARGIN and 2 * edge < width):
                continue
            turn_harmonics(harmonics, y + dy, turns[k], a_i, b_i, c_i)
            turn_harmonics(harmonics, y - dy, turns[k], a_j, b_j, c_j)
            here, left = UNSIGNED(y), UNSIGNED(edge)
            first, second = UNSIGNED(edge + dx), UNSIGNED(edge - dx)
            for x in range(UNSIGNED(width - 2 * edge)):
                i, j = first + x, second + x
                skew = b_i[i] * b_j[j]
                term = a_i[i] * a_j[j] - skew - skew + c_i[i] * c_j[j]
                out[here, left + x] += weights[k] * term


@kernel(fastmath=("contract",))
def turn_harmonics(
    harmonics: Float32Array,
    y: int,
    turn: Float32Array,
    a: Float32Array,
    b: Float32Array,
    c: Float32Array,
) -> None:
    """Fill the sums of p^4, p^3 q and p^2 q^2 of a row, from their angular harmonics."""
    cos_2, sin_2, cos_4, sin_4 = turn
    once, double_cos, double_sin = harmonics[0, y], harmonics[1, y], harmonics[2, y]
    fourfold_cos, fourfold_sin = harmonics[3, y], harmonics[4, y]
    half, quarter, eighth = np.float32(0.5), np.float32(0.25), np.float32(0.125)
    for x in range(len(a)):
        c2 = double_cos[x] * cos_2 + double_sin[x] * sin_2
        s2 = double_sin[x] * cos_2 - double_cos[x] * sin_2
        c4 = fourfold_cos[x] * cos_4 + fourfold_sin[x] * sin_4
        s4 = fourfold_sin[x] * cos_4 - fourfold_cos[x] * sin_4
        a[x] = (half - eighth) * once[x] + half * c2 + eighth * c4
        b[x] = quarter * s2 + eighth * s4
        c[x] = eighth * (once[x] - c4)


@kernel()
def follow_strongest(
    strength: Float32Array,
    cosine: Float32Array,
    sine: Float32Array,
    offsets: Offsets,
    directions: Float32Array,
    spacing: float,
    cells: IntArray,
    strongest: FloatArray,
    radius: FloatArray,
) -> None:
    """Update the strongest term of the pairs about (n, 2) cells, and its radius in pixels.

    A pair's weight is the square of its direction.
    """
    height, width = strength.shape
    for n in range(len(cells)):
        x, y = min(max(cells[n, 0], 0), width - 1), min(max(cells[n, 1], 0), height - 1)
        room_x, room_y = min(x, width - 1 - x) - MARGIN, min(y, height - 1 - y) - MARGIN
        for k in range(len(offsets)):
            dx, dy = offsets[k]
            if abs(dx) <= room_x and dy <= room_y:
                i, j = (y + dy, x + dx), (y - dy, x - dx)
                p = directions[k, 0] * (cosine[i] - cosine[j])
                p += directions[k, 1] * (sine[i] - sine[j])
                term = strength[i] * strength[j] * p * p
                if term > strongest[n]:
                    strongest[n] = term
                    radius[n] = spacing * np.sqrt(float(dx * dx + dy * dy))
