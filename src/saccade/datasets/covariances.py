"""Covariances as the columns of a table: the upper triangle, row by row."""

from itertools import combinations_with_replacement
from math import isqrt

import numpy as np

from saccade.types import FloatArray


def covariance_names(names: tuple[str, ...]) -> list[str]:
    """Column names of a covariance: "cov_x_x", "cov_x_y", ..."""
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(names, 2)]


def symmetric_columns(names: tuple[str, ...], matrices: FloatArray) -> dict[str, FloatArray]:
    """The upper triangles of covariances (n, d, d) as columns: "cov_x_x", "cov_x_y", ..."""
    return dict(zip(covariance_names(names), upper_triangle(matrices).T, strict=True))


def upper_triangle(matrices: FloatArray) -> FloatArray:
    """(n, d (d + 1) / 2) entries of symmetric matrices (n, d, d)."""
    return np.asarray(matrices[:, *np.triu_indices(matrices.shape[1])])


def from_upper_triangle(entries: FloatArray) -> FloatArray:
    """(n, d, d) symmetric matrices from their entries (n, d (d + 1) / 2)."""
    d = (isqrt(8 * entries.shape[1] + 1) - 1) // 2
    rows, columns = np.triu_indices(d)
    matrices = np.zeros((len(entries), d, d))
    matrices[:, rows, columns] = matrices[:, columns, rows] = entries
    return matrices
