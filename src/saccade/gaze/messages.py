"""What turns a camera, by a look: the fields of messages as dictionaries, without any middleware.

`rosidl_runtime_py.set_message_fields` fills a ROS 2 message from such a dictionary.
"""

from math import degrees, nan
from typing import Any

from saccade.gaze.gazer import Look
from saccade.slam.models import wrap

GIMBAL_MANAGER_PITCHYAW = 1000
"""Number of the MAVLink command MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW."""
YAW_IN_VEHICLE_FRAME = 32
"""MAVLink's flag of a yaw relative to the heading of the vehicle, instead of north."""


def joint_trajectory(
    look: Look, joints: tuple[str, str] = ("pan", "tilt"), seconds: float = 0.2
) -> dict[str, Any]:
    """A ROS `trajectory_msgs/JointTrajectory` that arrives after some seconds."""
    whole = int(seconds)
    duration = {"sec": whole, "nanosec": round(1e9 * (seconds - whole))}
    point = {"positions": [look.pan, look.tilt], "time_from_start": duration}
    return {"joint_names": list(joints), "points": [point]}


def point_head_goal(
    look: Look, map_frame: str, camera_frame: str, height: float = 0.0, rate: float = 0.0
) -> dict[str, Any]:
    """A goal of the ROS action `control_msgs/PointHead`.

    Args:
        look: its target is looked at.
        map_frame: of the target.
        camera_frame: optical frame of the camera, whose z axis is pointed.
        height: of a target without one, in metres.
        rate: greatest speed in radians per second; 0 for none.
    """
    x, y, z = (*look.target, height)[:3]
    target = {"header": {"frame_id": map_frame}, "point": {"x": x, "y": y, "z": z}}
    axis = {"x": 0.0, "y": 0.0, "z": 1.0}
    return {
        "target": target,
        "pointing_axis": axis,
        "pointing_frame": camera_frame,
        "max_velocity": rate,
    }


def ptz_goal(look: Look, zoom: float = 1.0) -> dict[str, Any]:
    """A goal of the ROS action `ptz_action_server_msgs/PtzMove`: radians clockwise and up."""
    return {"ptz": {"pan": -float(wrap(look.pan)), "tilt": look.tilt, "zoom": zoom}}


def gimbal_pitch_yaw(look: Look, device: int = 0) -> dict[str, float]:
    """MAVLink's `COMMAND_LONG` for a gimbal that follows the vehicle: degrees up and to the right.

    Args:
        look: where to.
        device: of the gimbal; 0 for all.
    """
    angles = degrees(look.tilt), -degrees(float(wrap(look.pan)))
    rates, unused = (nan, nan), 0.0
    parameters = (*angles, *rates, float(YAW_IN_VEHICLE_FRAME), unused, float(device))
    numbered = {f"param{i}": value for i, value in enumerate(parameters, 1)}
    return {"command": GIMBAL_MANAGER_PITCHYAW, **numbered}
