"""Errors of an estimated trajectory and map against the truth."""

from math import isfinite

import numpy as np

from saccade.types import BoolArray, FloatArray, LandmarkMap, Trajectory

TRIMMED_ITERATIONS = 30
"""Iterations of the trimmed alignment."""


def align(points: FloatArray, onto: FloatArray, inliers: BoolArray | None = None) -> FloatArray:
    """Rigid least-squares alignment of points (n, 2) with their correspondences.

    Args:
        points: points to be moved.
        onto: (n, 2) their correspondences.
        inliers: (n,) mask of the pairs that determine the alignment; None for all.

    Source: Umeyama (1991), without scale.
    """
    inliers = np.ones(len(points), bool) if inliers is None else inliers
    mean, target_mean = points[inliers].mean(0), onto[inliers].mean(0)
    U, _, Vt = np.linalg.svd((points[inliers] - mean).T @ (onto[inliers] - target_mean))
    flip = np.diag([1.0, np.sign(np.linalg.det(U @ Vt))])
    return np.asarray((points - mean) @ (U @ flip @ Vt) + target_mean)


def position_rmse(trajectory: Trajectory, truth: Trajectory, keep: float = 1.0) -> float:
    """Root mean square position error after alignment (ATE), in metres.

    Args:
        trajectory: estimated poses.
        truth: true positions, at times of their own.
        keep: fraction of the nearest positions that count and determine the alignment; under 1
            for a truth with outliers, such as GPS among trees.

    Returns:
        The error over the common time span, at the times of the trajectory that has fewer; NaN
        for fewer than two.
    """
    start = max(trajectory.time[0], truth.time[0])
    end = min(trajectory.time[-1], truth.time[-1])
    coarse = min(trajectory, truth, key=len)
    time = coarse.time[(coarse.time >= start) & (coarse.time <= end)]
    return _rmse(_positions(trajectory, time), _positions(truth, time), keep)


def landmark_rmse(landmarks: LandmarkMap, truth: LandmarkMap) -> float:
    """Root mean square error of the landmarks in both maps after alignment, in metres.

    NaN where there are fewer than two.
    """
    _, ours, theirs = np.intersect1d(landmarks.id, truth.id, return_indices=True)
    return _rmse(landmarks.xy[ours], truth.xy[theirs])


def none_if_nan(value: float) -> float | None:
    """A finite number, else None: JSON has neither NaN nor infinity."""
    return value if isfinite(value) else None


def _positions(trajectory: Trajectory, time: FloatArray) -> FloatArray:
    columns = [np.interp(time, trajectory.time, trajectory.pose[:, i]) for i in (0, 1)]
    return np.stack(columns, 1)


def _rmse(points: FloatArray, truth: FloatArray, keep: float = 1.0) -> float:
    if len(points) < 2:
        return float("nan")
    inliers = np.ones(len(points), bool)
    for _ in range(TRIMMED_ITERATIONS if keep < 1 else 1):
        error = np.hypot(*(align(points, truth, inliers) - truth).T)
        inliers = error <= np.quantile(error, keep)
    return float(np.sqrt(np.square(error[inliers]).mean()))
