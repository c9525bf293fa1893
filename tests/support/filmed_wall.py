"""A stereo rig that slides along a wall."""

import cv2
import numpy as np
import pytest

from saccade.frames import Camera, Drive, Frame


@pytest.fixture(scope="module")
def filmed():
    """A stereo rig that slides along a wall, without odometry."""
    rng = np.random.default_rng(5)
    wall = cv2.GaussianBlur(rng.integers(0, 255, (120, 400), np.uint8), (0, 0), 1.5)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)

    def load(i):
        left, right = (wall[:, x : x + 160].copy() for x in (3 * i, 3 * i + 8))
        return Frame(i / 10, left, right)

    n = 40
    return Drive(
        name="wall",
        camera=Camera(160, 120, 120.0, 120.0, 79.5, 59.5, 0.1),
        time=np.arange(n) / 10,
        control=np.zeros((n - 1, 3)),
        has_odometry=False,
        control_covariance=np.zeros((n - 1, 3, 3)),
        load=load,
    )
