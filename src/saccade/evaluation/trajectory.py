"""Errors of an estimated trajectory and map against the truth."""

from math import isfinite
from typing import NamedTuple

import numpy as np

from saccade.landmark_names import renumber
from saccade.types import BoolArray, FloatArray, LandmarkMap, Trajectory

TRIMMED_ITERATIONS = 30
"""Iterations of the trimmed alignment."""
MIN_SPREAD = 1e-12
"""Least singular value of points that span a dimension, as a fraction of the largest."""


class Similarity(NamedTuple):
    """A similarity transformation; rigid for scale 1."""

    rotation: FloatArray
    """(d, d)."""
    translation: FloatArray
    """(d,)."""
    scale: float
    rank: int
    """Dimensions of space that the points span; under d - 1 they do not determine the rotation."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """The transformed points (n, d)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def umeyama(points: FloatArray, onto: FloatArray, with_scale: bool = False) -> Similarity:
    """Least-squares alignment of points (n, d) with their correspondences (n, d).

    Args:
        points: points to be moved.
        onto: their correspondences.
        with_scale: whether the scale is estimated too; else it is 1.

    Source: Umeyama (1991).
    """
    mean, target_mean = points.mean(0), onto.mean(0)
    centered = points - mean
    U, values, Vt = np.linalg.svd((onto - target_mean).T @ centered)
    signs = np.ones(len(values))
    signs[-1] = np.sign(np.linalg.det(U @ Vt))
    rotation = (U * signs) @ Vt
    spread = np.square(centered).sum()
    scale = float((values * signs).sum() / spread) if with_scale and spread > 0 else 1.0
    rank = int((values > MIN_SPREAD * max(values[0], 1e-300)).sum())
    return Similarity(rotation, target_mean - scale * rotation @ mean, scale, rank)


def align(points: FloatArray, onto: FloatArray, inliers: BoolArray | None = None) -> FloatArray:
    """Points (n, 2) after rigid least-squares alignment with their correspondences (n, 2).

    Args:
        points: points to be moved.
        onto: their correspondences.
        inliers: (n,) mask of the pairs that determine the alignment; None for all.
    """
    inliers = np.ones(len(points), bool) if inliers is None else inliers
    return umeyama(points[inliers], onto[inliers])(points)


def position_rmse(
    trajectory: Trajectory, truth: Trajectory, keep: float = 1.0, aligned: bool = True
) -> float:
    """Root mean square position error (ATE), in metres.

    Args:
        trajectory: estimated poses.
        truth: true positions, at times of their own.
        keep: fraction of the nearest positions that count and determine the alignment; under 1
            for a truth with outliers, such as GPS among trees.
        aligned: whether the trajectory is aligned with the truth first; False for one in the frame
            of the truth.

    Returns:
        The error over the common time span, at the times of the trajectory that has fewer; NaN
        for fewer than two.
    """
    start = max(trajectory.time[0], truth.time[0])
    end = min(trajectory.time[-1], truth.time[-1])
    coarse = min(trajectory, truth, key=len)
    time = coarse.time[(coarse.time >= start) & (coarse.time <= end)]
    return _rmse(_positions(trajectory, time), _positions(truth, time), keep, aligned)


def landmark_rmse(landmarks: LandmarkMap, truth: LandmarkMap, aligned: bool = True) -> float:
    """Root mean square error of the landmarks in both maps, in metres; NaN for fewer than two.

    Args:
        landmarks: the estimates.
        truth: true positions of landmarks of the same names.
        aligned: whether they are aligned with the truth first.
    """
    ids, _ = renumber(truth.id, truth.text_names, landmarks.text_names)
    _, ours, theirs = np.intersect1d(landmarks.id, ids, return_indices=True)
    return _rmse(landmarks.xy[ours], truth.xy[theirs], aligned=aligned)


def none_if_nan(value: float) -> float | None:
    """A finite number, else None: JSON has neither NaN nor infinity."""
    return value if isfinite(value) else None


def _positions(trajectory: Trajectory, time: FloatArray) -> FloatArray:
    columns = [np.interp(time, trajectory.time, trajectory.pose[:, i]) for i in (0, 1)]
    return np.stack(columns, 1)


def _rmse(points: FloatArray, truth: FloatArray, keep: float = 1.0, aligned: bool = True) -> float:
    if len(points) < 2:
        return float("nan")
    inliers = np.ones(len(points), bool)
    for _ in range(TRIMMED_ITERATIONS if keep < 1 else 1):
        moved = align(points, truth, inliers) if aligned else points
        error = np.hypot(*(moved - truth).T)
        inliers = error <= np.quantile(error, keep)
    return float(np.sqrt(np.square(error[inliers]).mean()))
