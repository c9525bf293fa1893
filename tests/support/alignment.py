"""Comparing paths and maps that are known up to a turn and a shift."""

import numpy as np


def align(points, onto, by=None):
    """Points (n, 2) turned and shifted onto their partners with the least squares (Umeyama).

    `by` (n,) says which pairs decide; all unless told otherwise.
    """
    by = np.ones(len(points), bool) if by is None else by
    here, there = points[by].mean(0), onto[by].mean(0)
    U, _, Vt = np.linalg.svd((points[by] - here).T @ (onto[by] - there))
    flip = np.diag([1, np.sign(np.linalg.det(U @ Vt))])
    return (points - here) @ (U @ flip @ Vt) + there


def interpolate(trajectory, truth):
    """Places of a trajectory at its times within those of the truth, and the true ones."""
    inside = (trajectory.time >= truth.time[0]) & (trajectory.time <= truth.time[-1])
    at = trajectory.time[inside]
    true = np.stack([np.interp(at, truth.time, truth.pose[:, i]) for i in (0, 1)], 1)
    return trajectory.pose[inside, :2], true
