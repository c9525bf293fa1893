"""A robot among groups of landmarks that are closer than its odometry is certain."""

import numpy as np

from saccade.slam import compose, observe
from saccade.types import FloatArray, LandmarkLog, Trajectory

SIGMA = np.array([0.05, 0.012])
"""Metres and radians, of observations."""


def clustered_world(seed: int, spacing: float = 0.2, steps: int = 900) -> LandmarkLog:
    """A log with names and truth: five groups of two and three landmarks, and blind stretches.

    Args:
        seed: of landmarks, course and noise.
        spacing: metres between neighbors in a group.
        steps: of a quarter of a second.
    """
    rng = np.random.default_rng(seed)
    centers = 3.0 * np.stack([np.cos(a := np.arange(5) * 0.4 * np.pi), np.sin(a)], 1)
    landmarks = np.concatenate([c + _group(rng, 2 + i % 2, spacing) for i, c in enumerate(centers)])
    pose, blind = np.array([0.0, -1.5, 0.0]), 0
    poses, controls, covariances, rows = [pose], [], [], []
    for step in range(1, steps + 1):
        control = np.array([0.06, 0.0, 0.04 + 0.03 * np.sin(step / 40)])
        pose = compose(pose, control)[0]
        U = np.diag([0.03**2 * 0.06, 1e-8, 0.05**2 * 0.06])
        poses.append(pose)
        controls.append(control + rng.normal(size=3) * np.sqrt(U.diagonal()))
        covariances.append(U)
        blind = int(rng.integers(20, 60)) if rng.uniform() < 0.01 else blind - 1
        z = observe(pose, landmarks)[0]
        seen = (np.abs(z[:, 1]) < 0.5) & (rng.uniform(size=len(z)) < 0.4) & (blind <= 0)
        names = np.flatnonzero(seen)
        noisy = z[names] + rng.normal(size=(len(names), 2)) * SIGMA
        rows.append(np.column_stack([np.full(len(names), step), noisy, names]))
    table, time = np.concatenate(rows), 0.25 * np.arange(steps + 1.0)
    return LandmarkLog(
        name=f"clustered world {seed}",
        start=poses[0],
        time=time,
        motion="compose",
        control=np.array(controls),
        control_covariance=np.array(covariances),
        observation_pose=table[:, 0].astype(np.int64),
        observation=table[:, 1:3].copy(),
        observation_covariance=np.tile(np.diag(SIGMA**2), (len(table), 1, 1)),
        landmark=table[:, 3].astype(np.int64),
        truth=Trajectory(time, np.array(poses)),
    )


def _group(rng: np.random.Generator, size: int, spacing: float) -> FloatArray:
    """(size, 2) corners of a triangle, in a random direction."""
    angles = rng.uniform(0, 2 * np.pi) + np.arange(size) * 2 * np.pi / 3
    return spacing / np.sqrt(3) * np.stack([np.cos(angles), np.sin(angles)], 1)
