"""A large map: `OMP_NUM_THREADS=1 uv run python benchmarks/large_map.py`.

A robot with a laser of 30 m and 180 degrees sweeps a field of 5000 trees, lane by lane, and comes
back across the lanes: 50 000 steps of half a metre. The filter runs over the log whole and, where
GTSAM is installed, its iSAM2 does, with the same association.
"""

import argparse
import os
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade import slam
from saccade.types import LandmarkLog, LandmarkMap, Trajectory

STEP, LANE, REACH = 0.5, 50.0, 30.0
"""Metres: of a step, between two lanes, of the laser."""
DENSITY = 0.005
"""Trees to the square metre."""
ODOMETRY = (0.01, np.deg2rad(0.1))
"""Standard deviations of the distance and the turn of a step: metres, radians."""
LASER = (0.1, np.deg2rad(0.5))
"""Of range and bearing: metres, radians."""


def sweep(steps: int, side: float) -> np.ndarray:
    """Controls (steps, 2) of distance and turn: along lanes, then back across them."""
    corner = [np.pi / 2 / 20] * 20
    straight = int((side - LANE) / STEP)
    across = int(LANE / STEP) - 26  # the two corners are some 13 m to the side
    turns: list[float] = []
    left = 1.0
    while len(turns) < steps:
        for _ in range(int(side / LANE) - 1):
            turns += [0.0] * straight + [left * each for each in corner]
            turns += [0.0] * across + [left * each for each in corner]
            left = -left
        turns += [0.0] * straight
        turns += [left * each for each in corner]  # the next sweep is across this one
    return np.column_stack([np.full(steps, STEP), turns[:steps]])


def world(steps: int, trees: int, seed: int) -> LandmarkLog:
    """The log with identities and ground truth."""
    rng = np.random.default_rng(seed)
    side = (trees / DENSITY) ** 0.5
    control = sweep(steps, side)
    pose, truth = np.zeros(3), [np.zeros(3)]
    for u in control:
        pose = slam.drive(pose, u)[0]
        truth.append(pose)
    path = np.array(truth)
    low, high = path[:, :2].min(0) - REACH / 2, path[:, :2].max(0) + REACH / 2
    xy = rng.uniform(low, high, (trees, 2))
    cells = np.floor((xy - low) / REACH).astype(int)
    by_cell: dict[tuple[int, int], list[int]] = {}
    for tree, cell in enumerate(map(tuple, cells.tolist())):
        by_cell.setdefault(cell, []).append(tree)
    which, poses, seen = [], [], []
    for i, at in enumerate(path):
        cx, cy = np.floor((at[:2] - low) / REACH).astype(int)
        near = [t for dx in (-1, 0, 1) for dy in (-1, 0, 1) for t in by_cell.get((cx + dx, cy + dy), ())]
        if not near:
            continue
        z = slam.observe(at, xy[near])[0]
        visible = np.flatnonzero((z[:, 0] < REACH) & (np.abs(z[:, 1]) < np.pi / 2))
        which += [near[k] for k in visible]
        poses += [i] * len(visible)
        seen.append(z[visible])
    z = np.concatenate(seen)
    z = z + rng.normal(size=z.shape) * LASER
    time_ = np.arange(steps + 1.0)
    return LandmarkLog(
        name="sweep",
        start=path[0],
        time=time_,
        motion="drive",
        control=control + rng.normal(size=control.shape) * ODOMETRY,
        control_covariance=np.tile(np.diag(np.square(ODOMETRY)), (steps, 1, 1)),
        observation_pose=np.array(poses),
        observation=z,
        observation_covariance=np.tile(np.diag(np.square(LASER)), (len(z), 1, 1)),
        landmark=np.array(which),
        truth=Trajectory(time_, path),
        landmark_truth=LandmarkMap(np.arange(trees), xy),
    )
