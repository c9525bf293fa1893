"""Local symmetry once more, slow and plain: angles, cosines and a loop over the pairs."""

from math import atan2, cos, exp, hypot, log, pi, sin, sqrt

import numpy as np
from scipy import ndimage

from support.oracles_attention import bilinear


def gradients(channel, mode):
    """Magnitude and direction by Sobel's filters, the whole weight of a side being 4."""
    gx, gy = (ndimage.sobel(channel.astype(float), axis, mode=mode) for axis in (1, 0))
    return np.hypot(gx, gy), np.arctan2(gy, gx)


def symmetry(channels, kind, inner, outer, sigma, gain, mode="reflect", offsets=None):
    """(h, w) from (h, w, c): at each pixel the pairs that lie inside, as their papers have them.

    The outermost pixels take no part; the offsets are a square ring where they are not given.
    """
    height, width, count = channels.shape
    m, theta = np.moveaxis([gradients(channels[:, :, c], mode) for c in range(count)], 1, 0)
    sums = np.zeros((height, width))
    for y, x in np.ndindex(height, width):
        for a in range(count):
            terms = []
            for dx, dy in offsets or half_ring(inner, outer):
                i, j = (y + dy, x + dx), (y - dy, x - dx)
                rows, columns = zip(i, j, strict=True)
                if min(*rows, *columns) < 1:
                    continue
                if max(rows) >= height - 1 or max(columns) >= width - 1:
                    continue
                t_i, t_j = theta[a][i], theta[a][j]
                d, alpha = hypot(2 * dx, 2 * dy), atan2(dy, dx)
                g_i, g_j = t_i - alpha, t_j - alpha
                phase = (1 - cos(g_i + g_j)) * (1 - cos(g_i - g_j))
                strength = log(1 + gain * m[a][i]) * log(1 + gain * m[a][j])
                distance = exp(-(d**2) / (2 * sigma**2)) / (sigma * sqrt(2 * pi))
                terms.append((phase * strength * distance, (t_i + t_j) / 2))
            if kind == "radial" and terms:
                phi_max = max(terms)[1]
                terms = [(term * sin(phi - phi_max) ** 2, phi) for term, phi in terms]
            sums[y, x] += sum(term for term, _ in terms)
    return sums


def half_ring(inner, outer):
    """One of each two opposite offsets on a square ring."""
    for dy in range(-outer, outer + 1):
        for dx in range(-outer, outer + 1):
            if max(abs(dx), abs(dy)) >= inner and (dy, dx) > (0, 0):
                yield dx, dy


def share_inside(shape, inner, outer, sigma):
    """The weight of a pixel's pairs that lie inside, by that of all."""
    inside = np.zeros(shape)
    whole = 0.0
    height, width = shape
    for dx, dy in half_ring(inner, outer):
        weight = exp(-(4 * dx**2 + 4 * dy**2) / (2 * sigma**2))
        whole += weight
        for y, x in np.ndindex(height, width):
            fits = 1 + dy <= y < height - 1 - dy
            fits &= 1 + abs(dx) <= x < width - 1 - abs(dx)
            inside[y, x] += weight * fits
    return inside / whole


def kootstra2010(gray, kind, levels):
    """The release of 2010 from 8-bit grey values: `levels` are consecutive."""
    plane = np.asarray(gray, float)
    maps = []
    for number in range(levels[-1] + 1):
        if number > 0:
            for axis in (0, 1):
                plane = ndimage.correlate1d(plane, [0.25, 0.5, 0.25], axis, mode="nearest")
            down = number <= levels[0]
            plane = bilinear(plane, [s // 2 if down else round(s / 2) for s in plane.shape])
        if number in levels:
            grey = plane[:, :, None] / 256
            maps.append(symmetry(grey, kind, 3, 7, 16, 1, mode="mirror"))
    total = sum(bilinear(m, maps[0].shape) for m in maps)
    return (total - total.min()) / np.ptp(total)
