"""Basis functions of the saccade to the next fixation, whose weights `saccade fit` finds.

The logarithm of the density of the next fixation is a weighted sum of features of the image and of
these functions of the way from earlier fixations, so that its likelihood is convex (a conditional
logit, McFadden 1974). Lengths are fractions of the longer side of the image.
"""

import numpy as np

from saccade.types import FloatArray, IntArray

SCALES = (0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
"""Standard deviations of the Gaussians about an earlier fixation."""
NEAR = (0.03, 0.1)
"""Distances from which a direction counts."""
LAGS = (1, 1, 1, 1, 1, 1, 1, 1, 2, 3, 4, 5, 6, 7, 8)
"""The earlier fixation to which each table belongs, counted back from the next."""
FUNCTIONS = 53
"""Their number."""


def saccade_tables(shape: tuple[int, int], image_shape: tuple[int, int]) -> FloatArray:
    """(T, 2 h - 1, 2 w - 1, m) the functions by table and offset in cells; the middle is 0, 0.

    Args:
        shape: (h, w) of the map.
        image_shape: (H, W) of the image.
    """
    (h, w), side = shape, max(image_shape)
    x = np.arange(1 - w, w) * image_shape[1] / side / w
    y = np.arange(1 - h, h)[:, None] * image_shape[0] / side / h
    x, y = np.broadcast_arrays(x, y)
    r = np.hypot(x, y)
    radial = [np.exp(-((r / s) ** 2) / 2) for s in SCALES]
    radial += [np.log1p((r / NEAR[0]) ** 2), r]
    away = [1 - np.exp(-((r / s) ** 2) / 2) for s in NEAR]
    cos, sin = x / np.maximum(r, 1e-9), y / np.maximum(r, 1e-9)
    cos2, sin2 = cos**2 - sin**2, 2 * sin * cos
    zeros = np.zeros_like(r)
    ahead = [[each * a for a in (*away, r)] for each in (cos, sin)]
    twice = [[each * a for a in away] for each in (cos2, sin2)]
    still = [*radial, *(cos2 * a for a in away), cos**8 * away[1], y, sin * away[0]]
    blocks = [
        {0: still},
        {1: ahead[0], 2: ahead[1]},
        {3: twice[0], 4: twice[1]},
        {5: radial[1:7]},
        {6: radial[1:7]},
        {7: [*radial[1:7], cos2 * away[0], y]},
        {8: radial[:7]},
        dict.fromkeys((9, 10, 11), radial[1:5]),
        dict.fromkeys((12, 13, 14), radial[1:5]),
    ]
    columns = [
        np.stack([block.get(t, [zeros] * len(first))[k] for t in range(len(LAGS))])
        for block in blocks
        for first in [next(iter(block.values()))]
        for k in range(len(first))
    ]
    return np.stack(columns, axis=-1)


def path_terms(
    xy: FloatArray, shape: tuple[int, ...], image_shape: tuple[int, int]
) -> tuple[IntArray, FloatArray]:
    """What the fixation after a path depends on.

    Args:
        xy: (n, 2) fixations so far in pixels, at least one; the last is the current one.
        shape: (h, w) of the map.
        image_shape: (H, W) of the image.

    Returns:
        (T, 2) row and column of the fixation of each table, and (T,) its factor, which is 0
        where no such fixation was.
    """
    n = len(xy)
    cells = np.floor((xy[:, ::-1] + 0.5) / image_shape * shape).astype(np.int64)
    anchors = cells.clip(0, np.array(shape) - 1)[[max(n - lag, 0) for lag in LAGS]]
    cos, sin, size = 0.0, 0.0, 0.0
    if n > 1:
        dx, dy = (xy[-1] - xy[-2]) / max(image_shape)
        amplitude = float(np.hypot(dx, dy))
        cos, sin = dx / (amplitude or 1.0), dy / (amplitude or 1.0)
        size = np.log(amplitude + NEAR[0])
    of_last = [1.0, cos, sin, cos**2 - sin**2, 2 * cos * sin, size, 1 / n, float(n == 1)]
    return anchors, np.array([*of_last, *(float(n >= lag) for lag in LAGS[8:])])
