"""The pan of a camera by the transforms of ROS 2."""

import runpy
from math import cos, sin
from types import SimpleNamespace

import numpy as np
import pytest

from support.paths import ROOT


@pytest.mark.parametrize("pan", [-2.0, -0.3, 0.0, 1.2, 3.0])
@pytest.mark.parametrize("tilt", [-0.4, 0.0, 0.5])
def test_the_pan_of_an_optical_frame_is_that_of_its_axis(pan, tilt):
    ahead = np.array([0.5, -0.5, 0.5, -0.5])  # x, y, z, w: z ahead, x to the right, y down
    turn = np.array([0.0, 0.0, sin(pan / 2), cos(pan / 2)])
    up = np.array([0.0, sin(-tilt / 2), 0.0, cos(tilt / 2)])
    x, y, z, w = product(turn, product(up, ahead))
    rotation = SimpleNamespace(x=x, y=y, z=z, w=w)
    asked = []

    def lookup_transform(target, source, stamp):
        asked.append((target, source, stamp))
        return SimpleNamespace(transform=SimpleNamespace(rotation=rotation))

    pan_of = runpy.run_path(str(ROOT / "examples" / "ros2" / "gaze_topic.py"))["pan_of"]
    buffer = SimpleNamespace(lookup_transform=lookup_transform)
    assert pan_of(buffer, "base_link", "camera_optical", 7) == pytest.approx(pan)
    assert asked == [("base_link", "camera_optical", 7)]


def product(a, b):
    """Hamilton's product of two quaternions x, y, z, w: the rotation b, then a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
