"""Publish the gaze of visual SLAM to a ROS 2 topic.

    publisher = GazePublisher(node, "pan_tilt/command")
    control = GazeControl(POLICIES["informative"](0), candidates, limits, publisher)
    pipeline = Pipeline(drive, VisualConfig(), gaze=control)

Each decision is a `sensor_msgs/JointState` with the positions of the joints `pan` and `tilt` in
radians: pan to the left, tilt up, from how the camera is mounted. `drive.load` gives each frame the
turn of its own time, `Frame(..., turn=CameraTurn(pan, tilt, sigma))`, from the joint states that
the driver of the unit publishes.
"""

from typing import Any

from saccade.visual.gaze import Gaze


class GazePublisher:
    """Publishes gazes; what `GazeControl` calls to turn the camera.

    Args:
        node: an `rclpy` node.
        topic: of the commands.
        joints: names of the joints of pan and tilt.
    """

    def __init__(self, node: Any, topic: str, joints: tuple[str, str] = ("pan", "tilt")) -> None:
        from sensor_msgs.msg import JointState  # of a sourced ROS 2 environment

        self._message, self._joints = JointState, joints
        self._publisher = node.create_publisher(JointState, topic, 10)
        self._clock = node.get_clock()

    def __call__(self, time: float, gaze: Gaze) -> None:
        """Publish where to look; `time` is that of the frame, in seconds."""
        message = self._message()
        message.header.stamp = self._clock.now().to_msg()
        message.name = list(self._joints)
        message.position = [float(gaze.pan), float(gaze.tilt)]
        self._publisher.publish(message)
