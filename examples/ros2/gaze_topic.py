"""Turn the camera of a ROS 2 robot to where its map tells most.

    gazer = Gazer(slam, fov=radians(50), max_range=8.0, period=0.2, pan_sigma=0.002)
    turn = GazePublisher(node, "pan_tilt_controller/joint_trajectory")

and for each image, with ranges and bearings z in the frame of the camera and their covariances R:

    pan = pan_of(buffer, "base_link", "camera_optical", stamp)
    slam.step(time, control, U, z + np.array([0.0, pan]), gazer.add_pan_error(R), labels)
    gazer.record(pan=pan, labels=labels)
    turn(gazer.next(plan))

The controller of the pan-tilt unit turns the joints `pan` and `tilt`: radians to the left and up,
from how the camera is mounted.
"""

from math import atan2
from typing import Any

from saccade.gaze import Look


class GazePublisher:
    """Publishes looks as joint trajectories.

    Args:
        node: an `rclpy` node.
        topic: of the controller.
        joints: names of the joints of pan and tilt.
    """

    def __init__(self, node: Any, topic: str, joints: tuple[str, str] = ("pan", "tilt")) -> None:
        from rosidl_runtime_py import set_message_fields  # of a sourced ROS 2 environment
        from trajectory_msgs.msg import JointTrajectory

        self._message, self._fill, self._joints = JointTrajectory, set_message_fields, joints
        self._publisher = node.create_publisher(JointTrajectory, topic, 10)

    def __call__(self, look: Look) -> None:
        """Turn to a look."""
        message = self._message()
        arrival = {"sec": 0, "nanosec": 200_000_000}
        point = {"positions": [look.pan, look.tilt], "time_from_start": arrival}
        self._fill(message, {"joint_names": list(self._joints), "points": [point]})
        self._publisher.publish(message)


def pan_of(buffer: Any, robot: str, camera: str, stamp: Any) -> float:
    """Pan of an optical frame on the robot at a time, by a `tf2_ros` buffer, in radians."""
    q = buffer.lookup_transform(robot, camera, stamp).transform.rotation
    x, y = 2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x)  # of the optical axis, z
    return atan2(y, x)
