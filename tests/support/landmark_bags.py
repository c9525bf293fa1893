"""A robot that drives an arc among landmarks, as bags of ROS 1 and 2 with exact messages."""

import re

import numpy as np
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from support.ros_bags import STORES, xyzw

START = 1_700_000_000.0
"""Seconds of the first stamp, as large as those of clocks are."""
LANDMARKS = np.array([[4.0, 1.0, 0.5], [1.0, 5.0, 1.2], [-2.0, 2.0, 0.3], [3.0, -3.0, 0.9]])
NAMES = np.array([7, 3, 12, 40])
SPEED, TURN_RATE = 0.5, 0.3
MOUNTED = Rotation.from_euler("ZYX", [0.7, 0.3, -0.2]), np.array([0.3, -0.1, 0.8])
"""Rotation and position of the mast in the frame of the robot."""
OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.05, 0.02, 0.0])
"""The same of the camera on the mast."""
DEFINITIONS = """
apriltag_ros/AprilTagDetection: int32[] id; float64[] size;
    geometry_msgs/PoseWithCovarianceStamped pose
apriltag_ros/AprilTagDetectionArray: std_msgs/Header header;
    apriltag_ros/AprilTagDetection[] detections
apriltag_msgs/Point: float64 x; float64 y
apriltag_msgs/AprilTagDetection: string family; int32 id; int32 hamming; float32 goodness;
    float32 decision_margin; apriltag_msgs/Point centre; apriltag_msgs/Point[4] corners;
    float64[9] homography
apriltag_msgs/AprilTagDetectionArray: std_msgs/Header header;
    apriltag_msgs/AprilTagDetection[] detections
ar_track_alvar_msgs/AlvarMarker: std_msgs/Header header; uint32 id; uint32 confidence;
    geometry_msgs/PoseStamped pose
ar_track_alvar_msgs/AlvarMarkers: std_msgs/Header header; ar_track_alvar_msgs/AlvarMarker[] markers
aruco_msgs/Marker: std_msgs/Header header; uint32 id; geometry_msgs/PoseWithCovariance pose;
    float64 confidence
aruco_msgs/MarkerArray: std_msgs/Header header; aruco_msgs/Marker[] markers
aruco_opencv_msgs/MarkerPose: uint16 marker_id; geometry_msgs/Pose pose
aruco_opencv_msgs/ArucoDetection: std_msgs/Header header; aruco_opencv_msgs/MarkerPose[] markers
fiducial_msgs/FiducialTransform: int32 fiducial_id; geometry_msgs/Transform transform;
    float64 image_error; float64 object_error; float64 fiducial_area
fiducial_msgs/FiducialTransformArray: std_msgs/Header header; int32 image_seq;
    fiducial_msgs/FiducialTransform[] transforms
vision_msgs/ObjectHypothesis: string class_id; float64 score
vision_msgs/ObjectHypothesisWithPose: vision_msgs/ObjectHypothesis hypothesis;
    geometry_msgs/PoseWithCovariance pose
vision_msgs/BoundingBox3D: geometry_msgs/Pose center; geometry_msgs/Vector3 size
vision_msgs/Detection3D: std_msgs/Header header; vision_msgs/ObjectHypothesisWithPose[] results;
    vision_msgs/BoundingBox3D bbox; string id
vision_msgs/Detection3DArray: std_msgs/Header header; vision_msgs/Detection3D[] detections
"""
"""Messages that rosbags does not know: a type, and its fields."""
for store in STORES.values():
    for name, fields in re.findall(r"^(\S+): (.*(?:\n    .*)*)", DEFINITIONS, re.MULTILINE):
        kind = name.replace("/", "/msg/")
        if kind not in store.fielddefs:
            store.register(get_types_from_msg(re.sub(r";\s*", "\n", fields), kind))
TRANSFORMS = "tf2_msgs/msg/TFMessage"


def pose_at(seconds):
    """x, y and heading of the robot on its arc."""
    heading, radius = TURN_RATE * seconds, SPEED / TURN_RATE
    return np.array([radius * np.sin(heading), radius * (1 - np.cos(heading)), heading])


def on_robot(seconds):
    """Positions (n, 3) of the landmarks in the frame of the robot."""
    x, y, heading = pose_at(seconds)
    return Rotation.from_euler("z", heading).inv().apply(LANDMARKS - [x, y, 0.0])


def camera_pose(turn=None):
    """Rotation and position of the camera on the robot; the mast may be turned."""
    rotation = MOUNTED[0] if turn is None else MOUNTED[0] * turn
    return rotation * OPTICAL[0], MOUNTED[1] + rotation.apply(OPTICAL[1])


def in_camera(points, turn=None):
    """Positions (n, 3) in the frame of the camera."""
    rotation, position = camera_pose(turn)
    return rotation.inv().apply(points - position)


def range_bearing(seconds):
    x, y, _ = on_robot(seconds).T
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], 1)


class Builder:
    """Messages of landmarks in the frame of a sensor, by the `Messages` of one of the two."""

    def __init__(self, messages):
        self.messages = messages

    def array(self, kind, stamp, points, names=NAMES, frame="camera", covariances=None, **more):
        """A message of one of `KINDS` with landmarks at points (k, 3), and more fields."""
        if covariances is None:
            covariances = np.zeros((len(points), 3, 3))
        name = KINDS[kind][1]
        *others, field = (each for each, _ in self.messages.store.fielddefs[name][1])
        header = self.messages.header(stamp, frame)
        seen = zip(points, names.tolist(), covariances, strict=True)
        values = {field: [landmark(kind, header, *each) for each in seen]}
        values |= {"header": header} if "header" in others else {}
        return self.messages(name, **values | more)


def landmark(kind, header, point, name, covariance):
    """The fields of a landmark in a message of one of `KINDS`."""
    pose = {"position": xyzw(*point), "orientation": xyzw(0.0, 0.0, 0.6, 0.8)}
    whole = np.zeros((6, 6))
    whole[:3, :3] = covariance
    uncertain = {"pose": pose, "covariance": whole.ravel()}
    numbers = {"id": np.array([name], np.int32), "size": np.array([0.1])}
    moved = {"translation": xyzw(*point), "rotation": xyzw(0.0, 0.0, 0.0, 1.0)}
    return {
        "ros1_tags": {**numbers, "pose": {"header": header, "pose": uncertain}},
        "ros2_tags": {"family": "tag36h11", "id": name, "decision_margin": 50.0},
        "alvar": {"header": header, "id": name, "pose": {"pose": pose}},
        "aruco": {"header": header, "id": name, "pose": uncertain},
        "aruco_opencv": {"marker_id": name, "pose": pose},
        "fiducials": {"fiducial_id": name, "transform": moved},
        "detections": {"header": header, "id": str(name), "results": [{"pose": uncertain}]},
        "poses": pose,
    }[kind]


KINDS = {
    "ros1_tags": ("/tag_detections", "apriltag_ros/msg/AprilTagDetectionArray"),
    "ros2_tags": ("/detections", "apriltag_msgs/msg/AprilTagDetectionArray"),
    "alvar": ("/ar_pose_marker", "ar_track_alvar_msgs/msg/AlvarMarkers"),
    "aruco": ("/marker_publisher/markers", "aruco_msgs/msg/MarkerArray"),
    "aruco_opencv": ("/aruco_detections", "aruco_opencv_msgs/msg/ArucoDetection"),
    "fiducials": ("/fiducial_transforms", "fiducial_msgs/msg/FiducialTransformArray"),
    "detections": ("/tags", "vision_msgs/msg/Detection3DArray"),
    "poses": ("/trees", "geometry_msgs/msg/PoseArray"),
}
"""Topic and type of each."""


def static(messages):
    mast = ("base_link", "mast", *MOUNTED, START)
    return messages.transforms(mast, ("mast", "camera", *OPTICAL, START))


def odometry(messages, count=41, step=0.1):
    """Exact odometry, as messages of /odom."""
    for i in range(count):
        time = START + i * step
        message = messages.odometry(time, *pose_at(i * step).tolist())
        yield "/odom", "nav_msgs/msg/Odometry", time, message


def drive(messages, kind, scans=8, step=0.5):
    """Landmarks of a type seen by the camera of the robot, while it drives."""
    build = Builder(messages)
    yield "/tf_static", TRANSFORMS, START, static(messages)
    yield from odometry(messages)
    for i in range(scans):
        points, time = in_camera(on_robot(i * step)), START + i * step
        yield *KINDS[kind], time, build.array(kind, time, points)
        if kind == "ros2_tags":
            turn = Rotation.from_euler("x", 0.3)
            tags = [
                ("camera", f"tag36h11:{name}", turn, point, time)
                for name, point in zip(NAMES, points, strict=True)
            ]
            yield "/tf", TRANSFORMS, time, messages.transforms(*tags)
