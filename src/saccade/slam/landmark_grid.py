"""Landmarks sorted into square cells."""

import numpy as np

from saccade.slam._relocalization_kernels import Grid
from saccade.types import FloatArray


def build_grid(landmarks: FloatArray, size: float) -> Grid:
    """A grid of landmarks (N, 2), N over 0, with cells of this side or larger."""
    low, extent = landmarks.min(0), np.ptp(landmarks, axis=0)
    size = max(size, float(extent.max()) / (2 * len(landmarks) ** 0.5 + 1), 1e-6)
    nx, ny = (int(n) + 1 for n in extent / size)
    cell = np.floor((landmarks - low) / size).astype(np.int64) @ [ny, 1]
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(nx * ny + 1))
    return Grid(low, size, (nx, ny), start, np.array(landmarks[order], np.float64))
