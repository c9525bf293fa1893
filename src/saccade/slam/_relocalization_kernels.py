"""Support of proposed poses, for relocalization."""

from math import cos, floor, inf, sin
from typing import NamedTuple

from saccade._jit import kernel
from saccade.types import FloatArray, IntArray


class Grid(NamedTuple):
    """Landmarks by the square cells in which they are."""

    low: FloatArray
    """(2,) meters: the corner of the first cell."""
    size: float
    """Meters: the side of a cell."""
    shape: tuple[int, int]
    """Cells along x and y."""
    start: IntArray
    """(cells + 1,) index in `xy` of the first landmark of each cell, row by row."""
    xy: FloatArray
    """(N, 2) meters, sorted by cell."""


@kernel()
def squared_distance_to_nearest(grid: Grid, x: float, y: float) -> float:
    """Square meters to the nearest landmark within one cell's side; infinite without any."""
    i, j = floor((x - grid.low[0]) / grid.size), floor((y - grid.low[1]) / grid.size)
    nx, ny = grid.shape
    least = inf
    if i < -1 or i > nx or j < -1 or j > ny:
        return least
    for column in range(max(i - 1, 0), min(i + 2, nx)):
        first = grid.start[column * ny + max(j - 1, 0)]
        last = grid.start[column * ny + min(j + 1, ny - 1) + 1]
        for k in range(first, last):
            dx, dy = grid.xy[k, 0] - x, grid.xy[k, 1] - y
            least = min(least, dx * dx + dy * dy)
    return least


@kernel()
def add_support(
    grid: Grid, poses: FloatArray, points: FloatArray, scale: FloatArray, support: FloatArray
) -> None:
    """Fill in the sum over points (k, 2) of 1 - distance^2 / scale to a landmark, where positive.

    For each of the poses (h, 3); scale (k,) is at most the squared side of a cell.
    """
    for h in range(len(poses)):
        c, s, total = cos(poses[h, 2]), sin(poses[h, 2]), 0.0
        for k in range(len(points)):
            x = poses[h, 0] + c * points[k, 0] - s * points[k, 1]
            y = poses[h, 1] + s * points[k, 0] + c * points[k, 1]
            total += max(1 - squared_distance_to_nearest(grid, x, y) / scale[k], 0.0)
        support[h] = total
