"""A robot that goes round in a circle: the world in which filters and smoothers are tried."""

import numpy as np

from saccade.slam import compose, observe, turn_then_translate
from saccade.types import LandmarkLog


def simulate(rng, motion="compose", steps=300, noise=1.0, reach=8.0):
    """A robot on a circle of 6 m among twenty landmarks; its log and the truth."""
    world = rng.uniform(-10, 10, (20, 2))
    move, size = (turn_then_translate, 2) if motion == "turn_then_translate" else (compose, 3)
    control = (
        np.array([0.25, 0.04]) if motion == "turn_then_translate" else np.array([0.25, 0.01, 0.04])
    )
    U = np.diag([0.02, 0.01] if motion == "turn_then_translate" else [0.02, 0.01, 0.01]) ** 2
    R = np.diag([0.1, 0.02]) ** 2
    truth = [np.array([6.0, 0.0, np.pi / 2])]
    controls, seen = [], []
    for step in range(steps + 1):
        z, _ = observe(truth[-1], world)
        for landmark in np.flatnonzero(z[:, 0] < reach):
            error = noise * rng.normal(size=2) * np.sqrt(np.diag(R))
            seen.append((step, landmark, *(z[landmark] + error)))
        truth.append(move(truth[-1], control)[0])
        controls.append(control + noise * rng.normal(size=size) * np.sqrt(np.diag(U)))
    seen = np.array(seen).reshape(-1, 4)
    log = LandmarkLog(
        name="circle",
        start=truth[0],
        time=np.arange(steps + 1.0),
        range_errors=(1e-3, 1e-3),
        motion=motion,
        control=np.array(controls[:-1]),
        control_covariance=np.tile(U, (steps, 1, 1)),
        observation_pose=seen[:, 0].astype(np.int64),
        observation=np.stack([np.abs(seen[:, 2]), seen[:, 3]], 1),
        observation_covariance=np.tile(R, (len(seen), 1, 1)),
        landmark=seen[:, 1].astype(np.int64),
    )
    return log, np.array(truth[:-1]), world
