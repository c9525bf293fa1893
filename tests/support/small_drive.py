"""A drive of five small images."""

import numpy as np

from saccade.frames import Camera, Drive, Frame
from saccade.types import Trajectory


def small_drive(n=5, baseline=0.2, load=None):
    rng = np.random.default_rng(1)
    time = np.arange(n) * 0.1 + 3
    pictures = rng.integers(0, 255, (2, n, 24, 32), np.uint8)
    root = rng.normal(size=(n - 1, 3, 3))
    pose = np.cumsum(rng.normal(size=(n, 3)) * 0.1, 0)
    return Drive(
        name="small",
        camera=Camera(32, 24, 30.0, 31.0, 15.5, 12.0, baseline, np.array([0.3, 0, 1.0])),
        time=time,
        control=rng.normal(size=(n - 1, 3)),
        control_covariance=root @ root.transpose(0, 2, 1),
        load=load or (lambda i: Frame(time[i], pictures[0, i], pictures[1, i])),
        start=pose[0],
        odometry_bias=(0.03, 0.001, 0.0),
        truth=Trajectory(time, pose),
    )
