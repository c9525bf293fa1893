"""Slow and plain twins of the kernels of `saccade.keypoints`: formulas, for a person to read."""

import numpy as np


def cross():
    """The 10 neighbors in a 3x3x3 cube, and its middle."""
    chosen = np.zeros((3, 3, 3), bool)
    chosen[1] = True
    chosen[:, 1, 1] = True
    return chosen


def extrema(dog, threshold, border, neighbors=26):
    """(plane, row, column) of every first highest or first lowest sample of its 3x3x3 cube.

    Of 10 neighbors, those diagonal to the middle between planes do not count, and in the first
    and last plane that is searched the one beyond may be a hundredth higher.
    """
    planes, height, width = dog.shape
    counts = cross() if neighbors == 10 else np.ones((3, 3, 3), bool)
    beyond = np.zeros((planes, 3, 3, 3))
    if neighbors == 10:
        beyond[1, 0], beyond[planes - 2, 2] = 0.01, 0.01
    found = []
    for p in range(1, planes - 1):
        for r in range(border, height - border):
            for c in range(border, width - border):
                cube = dog[p - 1 : p + 2, r - 1 : r + 2, c - 1 : c + 2]
                cube = cube - beyond[p] * dog[p, r, c]
                top, bottom = np.where(counts, cube, -np.inf), np.where(counts, cube, np.inf)
                highest = dog[p, r, c] > threshold and top.argmax() == 13
                lowest = dog[p, r, c] < -threshold and bottom.argmin() == 13
                if highest or lowest:
                    found.append((p, r, c))
    return found


def quadratic(cube):
    """Offset (x, y, plane), value, trace and determinants at the middle of a 3x3x3 cube."""
    cube = cube.astype(np.float64)
    middle = np.array([1, 1, 1])
    axes = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]])  # x, y, plane

    def at(*steps):
        return cube[tuple(middle + sum(steps))]

    gradient = np.array([(at(e) - at(-e)) / 2 for e in axes])
    hessian = np.array(
        [
            [
                at(a) - 2 * at(0 * a) + at(-a)
                if i == j
                else (at(a, b) - at(a, -b) - at(-a, b) + at(-a, -b)) / 4
                for j, b in enumerate(axes)
            ]
            for i, a in enumerate(axes)
        ]
    )
    offset = -np.linalg.solve(hessian, gradient)
    plane = hessian[:2, :2]
    value = cube[1, 1, 1] + gradient @ offset / 2
    return offset, value, np.trace(plane), np.linalg.det(plane), np.linalg.det(hessian)


def gradients(plane):
    """Gradient by central differences, and which samples have one: not those at the edge."""
    dx, dy = np.zeros(plane.shape), np.zeros(plane.shape)
    dx[:, 1:-1] = plane[:, 2:] - plane[:, :-2]
    dy[1:-1] = plane[2:] - plane[:-2]
    inside = np.zeros(plane.shape, bool)
    inside[1:-1, 1:-1] = True
    return np.hypot(dx, dy) * inside, np.arctan2(dy, dx)


def tent(distance):
    return np.maximum(1 - np.abs(distance), 0)


def circular(distance, period):
    return (distance + period / 2) % period - period / 2


def sampled(plane, x, y, sigma, spacing):
    """Which samples are looked at: evenly about the one nearest to the point."""
    stride = max(np.floor(spacing * sigma + 0.5), 1)
    row, column = np.indices(plane.shape)
    return ((row - np.rint(y)) % stride == 0) & ((column - np.rint(x)) % stride == 0)


def orientation_bins(plane, x, y, sigma, *, linear, subpixel, spacing=0):
    """(36,) gradients within 4.5 sigma, each way, under a Gaussian of 1.5 sigma."""
    radius = 4.5 * sigma
    if not subpixel:
        x, y, radius = np.rint(x), np.rint(y), np.rint(radius)
    magnitude, direction = gradients(plane)
    row, column = np.indices(plane.shape)
    near = (np.abs(column - x) <= radius) & (np.abs(row - y) <= radius)
    near &= sampled(plane, x, y, sigma, spacing)
    weight = np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * (1.5 * sigma) ** 2))
    place = direction / (2 * np.pi) * 36
    if not linear:
        place = np.floor(place + 0.5)
    return np.array(
        [(near * weight * magnitude * tent(circular(place - bin_, 36))).sum() for bin_ in range(36)]
    )


def descriptor(plane, x, y, sigma, angle, *, window_sigma, subpixel, spacing=0):
    """(128,) gradients shared among 4x4 cells of 3 sigma and 8 directions, not normalized."""
    if not subpixel:
        x, y = np.rint(x), np.rint(y)
    magnitude, direction = gradients(plane)
    row, column = np.indices(plane.shape)
    u = (np.cos(angle) * (column - x) + np.sin(angle) * (row - y)) / (3 * sigma)
    v = (np.cos(angle) * (row - y) - np.sin(angle) * (column - x)) / (3 * sigma)
    weight = magnitude * np.exp(-(u**2 + v**2) / (2 * (4 * window_sigma) ** 2))
    weight = weight * sampled(plane, x, y, sigma, spacing)
    turn = (angle - direction) / (2 * np.pi) * 8
    return np.array(
        [
            (weight * tent(v - i) * tent(u - j) * tent(circular(turn - k, 8))).sum()
            for i in (-1.5, -0.5, 0.5, 1.5)
            for j in (-1.5, -0.5, 0.5, 1.5)
            for k in range(8)
        ]
    )


def quantized(raw, *, root):
    """Unit rows, cut at 0.2, unit again or the root of their shares; 512 to the unit."""
    raw = raw.astype(float)
    unit = np.minimum(raw / np.linalg.norm(raw, axis=1, keepdims=True), 0.2)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    if root:
        unit = np.sqrt(unit / unit.sum(axis=1, keepdims=True))
    return np.minimum(512 * unit, 255)
