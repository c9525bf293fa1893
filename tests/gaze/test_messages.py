"""Messages that turn a camera: signs and units of each convention."""

import runpy
from math import cos, isnan, pi, sin
from types import SimpleNamespace

import numpy as np
import pytest

from saccade.gaze import Look, gimbal_pitch_yaw, joint_trajectory, point_head_goal, ptz_goal
from support.paths import ROOT

LOOK = Look(pi / 2, pi / 6, (1.0, 2.0), "to the left and up")


def test_a_mavlink_gimbal_turns_up_and_to_the_right_in_degrees():
    command = gimbal_pitch_yaw(LOOK, device=154)
    assert command["command"] == 1000
    assert command["param1"] == pytest.approx(30)
    assert command["param2"] == pytest.approx(-90)
    assert isnan(command["param3"])
    assert isnan(command["param4"])
    assert command["param5"] == 32  # GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME, in common.xml
    assert command["param7"] == 154
    assert len(command) == 8
    assert gimbal_pitch_yaw(Look(5.0, 0.0, (0.0, 0.0), ""))["param2"] == pytest.approx(
        73.52, abs=0.01
    )


def test_a_ptz_action_turns_clockwise_and_up_in_radians():
    assert ptz_goal(LOOK, zoom=2.0) == {"ptz": {"pan": -pi / 2, "tilt": pi / 6, "zoom": 2.0}}


def test_a_joint_trajectory_turns_to_the_left_and_up_in_radians():
    trajectory = joint_trajectory(LOOK, ("head_pan", "head_tilt"), 1.25)
    assert trajectory["joint_names"] == ["head_pan", "head_tilt"]
    (point,) = trajectory["points"]
    assert point["positions"] == [pi / 2, pi / 6]
    assert point["time_from_start"] == {"sec": 1, "nanosec": 250_000_000}


def test_a_head_points_at_the_target_in_the_map():
    goal = point_head_goal(LOOK, "map", "camera_optical_frame", height=1.2)
    assert goal["target"] == {
        "header": {"frame_id": "map"},
        "point": {"x": 1.0, "y": 2.0, "z": 1.2},
    }
    assert goal["pointing_axis"]["z"] == 1.0
    assert goal["pointing_frame"] == "camera_optical_frame"


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
