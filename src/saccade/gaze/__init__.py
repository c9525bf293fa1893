"""Where a robot looks next, by its map: image -> attention -> landmarks -> map, and back."""

from saccade.gaze.gazer import POLICIES, Gazer, Look, Policy
from saccade.gaze.messages import gimbal_pitch_yaw, joint_trajectory, point_head_goal, ptz_goal

__all__ = [
    "POLICIES",
    "Gazer",
    "Look",
    "Policy",
    "gimbal_pitch_yaw",
    "joint_trajectory",
    "point_head_goal",
    "ptz_goal",
]
