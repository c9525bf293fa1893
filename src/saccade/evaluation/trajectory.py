"""How far an estimated drive and map are from the true ones."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from saccade.types import FloatArray, LandmarkMap, Trajectory

BoolArray: TypeAlias = npt.NDArray[np.bool_]
TRIMS = 30
"""Rounds in which the nearest are chosen and aligned anew."""


def aligned(points: FloatArray, onto: FloatArray, by: BoolArray | None = None) -> FloatArray:
    """Points (n, 2) turned and shifted onto their partners with the least squares.

    Args:
        points: to be moved.
        onto: (n, 2) their partners.
        by: (n,) which pairs decide; all unless told otherwise.

    Source: Umeyama (1991), without scale.
    """
    by = np.ones(len(points), bool) if by is None else by
    here, there = points[by].mean(0), onto[by].mean(0)
    U, _, Vt = np.linalg.svd((points[by] - here).T @ (onto[by] - there))
    flip = np.diag([1.0, np.sign(np.linalg.det(U @ Vt))])
    return np.asarray((points - here) @ (U @ flip @ Vt) + there)


def position_rmse(trajectory: Trajectory, truth: Trajectory, keep: float = 1.0) -> float:
    """Root mean square distance from the truth after alignment, in metres.

    Args:
        trajectory: poses at times of their own.
        truth: places at times of their own.
        keep: share of the nearest places that count, and that decide the alignment; under 1 for
            a truth that has outliers, such as GPS among trees.

    Returns:
        Over the times that both have, those of the coarser one; NaN where they are fewer than two.
    """
    low, high = (end(trajectory.time[i], truth.time[i]) for end, i in ((max, 0), (min, -1)))
    coarse = min(trajectory, truth, key=len)
    at = coarse.time[(coarse.time >= low) & (coarse.time <= high)]
    ours, true = (_places(each, at) for each in (trajectory, truth))
    return _rmse(ours, true, keep)


def landmark_rmse(landmarks: LandmarkMap, truth: LandmarkMap) -> float:
    """Root mean square distance of the landmarks that both maps have, after alignment, in metres.

    NaN where there are fewer than two.
    """
    _, ours, theirs = np.intersect1d(landmarks.id, truth.id, return_indices=True)
    return _rmse(landmarks.xy[ours], truth.xy[theirs])


def _places(trajectory: Trajectory, at: FloatArray) -> FloatArray:
    columns = [np.interp(at, trajectory.time, trajectory.pose[:, i]) for i in (0, 1)]
    return np.stack(columns, 1)


def _rmse(points: FloatArray, true: FloatArray, keep: float = 1.0) -> float:
    if len(points) < 2:
        return float("nan")
    near = np.ones(len(points), bool)
    for _ in range(TRIMS if keep < 1 else 1):
        apart = np.hypot(*(aligned(points, true, near) - true).T)
        near = apart <= np.quantile(apart, keep)
    return float(np.sqrt(np.square(apart[near]).mean()))
