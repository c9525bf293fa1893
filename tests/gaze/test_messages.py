"""Messages that turn a camera: signs and units of each convention."""

from math import isnan, pi

import pytest

from saccade.gaze import Look, gimbal_pitch_yaw, joint_trajectory, point_head_goal, ptz_goal

LOOK = Look(pi / 2, pi / 6, (1.0, 2.0), "to the left and up")


def test_a_mavlink_gimbal_turns_up_and_to_the_right_in_degrees():
    command = gimbal_pitch_yaw(LOOK, device=154)
    assert command["command"] == 1000
    assert command["param1"] == pytest.approx(30)
    assert command["param2"] == pytest.approx(-90)
    assert isnan(command["param3"])
    assert isnan(command["param4"])
    assert (command["param5"], command["param7"]) == (0, 154)
    assert len(command) == 8


def test_ros_turns_to_the_left_and_up_in_radians():
    assert ptz_goal(LOOK, zoom=2.0) == {"pan": pi / 2, "tilt": pi / 6, "zoom": 2.0}
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
