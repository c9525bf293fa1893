"""Weights, densities and samples of `saccade.attention.scanpath_model`."""

from math import exp
from typing import NamedTuple

import numpy as np

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray

EARLY = 6
"""Index of the factor that decreases with the fixation number."""


@kernel()
def fill_logits(
    fields: FloatArray, tables: FloatArray, anchors: IntArray, factors: FloatArray, out: FloatArray
) -> None:
    """Fills `out` (h, w) with the fields plus the tables centered at their anchors (T, 2)."""
    h, w = out.shape
    for i in range(h):
        for j in range(w):
            out[i, j] = fields[0, i, j] + factors[EARLY] * fields[1, i, j]
        for t in range(len(factors)):
            factor = factors[t]
            if factor != 0:
                row = i - anchors[t, 0] + h - 1
                first = w - 1 - anchors[t, 1]
                for j in range(w):
                    out[i, j] += factor * tables[t, row, first + j]


MAX_EXPONENT = 20.0
"""Maximum exponent of an evaluated Gaussian; smaller values, below 3e-9, are set to 0."""


class Dynamics(NamedTuple):
    """Constants of the model; lengths are fractions of the longer side of the image."""

    amplitude_scale: float
    amplitude_exponent: float
    horizontal: float
    persistence: float
    inhibition: float
    inhibition_sigma: float
    inhibition_decay: float
    """Factor on the inhibition per fixation."""


class Grid(NamedTuple):
    """The cells of a map, row by row; each array is (h w,)."""

    x: FloatArray
    """Centers in fractions of the longer side of the image."""
    y: FloatArray
    mass: FloatArray
    """Factor of the weights of the dynamics at each cell; it sums to 1."""
    width: float
    """Width of a cell, in the same unit."""
    height: float


@kernel()
def _saccade_weight(model: Dynamics, x: float, y: float, path: FloatArray) -> float:
    """Saccade kernel from the last row of `path` (k, 2) to a point; in (0, 1]."""
    last = len(path) - 1
    dx, dy = x - path[last, 0], y - path[last, 1]
    squared = dx * dx + dy * dy
    scaled = squared / (model.amplitude_scale * model.amplitude_scale)
    weight: float = (1 + scaled) ** -model.amplitude_exponent
    if squared == 0:
        return weight
    weight *= 1 + model.horizontal * (dx * dx - dy * dy) / squared
    if last > 0:
        px, py = path[last, 0] - path[last - 1, 0], path[last, 1] - path[last - 1, 1]
        length = (px * px + py * py) * squared
        if length > 0:
            weight *= 1 + model.persistence * (dx * px + dy * py) / length**0.5
    return weight / ((1 + abs(model.horizontal)) * (1 + abs(model.persistence)))


@kernel()
def _inhibition_weight(model: Dynamics, x: float, y: float, path: FloatArray) -> float:
    """Inhibition-of-return factor of the fixations `path` (k, 2) at a point; in (0, 1]."""
    weight, strength = 1.0, model.inhibition
    width = 2 * model.inhibition_sigma * model.inhibition_sigma
    for k in range(len(path) - 1, -1, -1):
        dx, dy = x - path[k, 0], y - path[k, 1]
        scaled = (dx * dx + dy * dy) / width
        if scaled < MAX_EXPONENT:
            weight *= 1 - strength * exp(-scaled)
        strength *= model.inhibition_decay
    return weight


@kernel()
def fill_density(model: Dynamics, grid: Grid, path: FloatArray, density: FloatArray) -> None:
    """Fills the probability (h w,) of each cell to be fixated next after `path` (k, 2)."""
    total = 0.0
    for i in range(len(density)):
        x, y = grid.x[i], grid.y[i]
        weight = _saccade_weight(model, x, y, path) * _inhibition_weight(model, x, y, path)
        density[i] = grid.mass[i] * weight
        total += density[i]
    for i in range(len(density)):
        density[i] /= total


@kernel()
def draw_paths(
    model: Dynamics,
    grid: Grid,
    cumulative: FloatArray,
    rng: np.random.Generator,
    max_trials: int,
    paths: FloatArray,
    cells: IntArray,
) -> None:
    """Samples scanpaths: fills `paths` (p, n, 2) after their first row, and `cells` (p, n).

    Rejection sampling: a cell is proposed with its mass and accepted with its weight. After
    `max_trials` rejections it is drawn from the full density, which gives the same distribution.
    `cumulative` (h w,) is the cumulative mass of the cells and ends at 1.
    """
    density = np.empty(len(grid.mass))
    for p in range(len(paths)):
        for k in range(1, paths.shape[1]):
            path = paths[p, :k]
            cell = -1
            for _ in range(max_trials):
                proposed = int(np.searchsorted(cumulative, rng.random(), side="right"))
                x, y, u = grid.x[proposed], grid.y[proposed], rng.random()
                weight = _saccade_weight(model, x, y, path)
                if u < weight and u < weight * _inhibition_weight(model, x, y, path):
                    cell = proposed
                    break
            if cell < 0:
                fill_density(model, grid, path, density)
                u, total = rng.random(), 0.0
                for cell in range(len(density)):
                    total += density[cell]
                    if total >= u:
                        break
            cells[p, k] = cell
            paths[p, k, 0] = grid.x[cell] + (rng.random() - 0.5) * grid.width
            paths[p, k, 1] = grid.y[cell] + (rng.random() - 0.5) * grid.height
