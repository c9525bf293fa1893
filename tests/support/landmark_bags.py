"""A robot that drives an arc among landmarks, as bags of ROS 1 and 2 with exact messages."""

import numpy as np
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from support.ros_bags import STORES

START = 1_700_000_000.0
"""Seconds of the first stamp, as large as those of clocks are."""
LANDMARKS = np.array([[4.0, 1.0, 0.5], [1.0, 5.0, 1.2], [-2.0, 2.0, 0.3], [3.0, -3.0, 0.9]])
NAMES = np.array([7, 3, 12, 40])
SPEED, TURN_RATE = 0.5, 0.3
MOUNTED = Rotation.from_euler("ZYX", [0.7, 0.3, -0.2]), np.array([0.3, -0.1, 0.8])
"""Rotation and position of the mast in the frame of the robot."""
OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.05, 0.02, 0.0])
"""The same of the camera on the mast."""
DEFINITIONS = {
    "apriltag_ros/msg/AprilTagDetection": (
        "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose"
    ),
    "apriltag_ros/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections"
    ),
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections"
    ),
    "ar_track_alvar_msgs/msg/AlvarMarker": (
        "std_msgs/Header header\nuint32 id\nuint32 confidence\ngeometry_msgs/PoseStamped pose"
    ),
    "ar_track_alvar_msgs/msg/AlvarMarkers": (
        "std_msgs/Header header\nar_track_alvar_msgs/AlvarMarker[] markers"
    ),
    "aruco_msgs/msg/Marker": (
        "std_msgs/Header header\nuint32 id\ngeometry_msgs/PoseWithCovariance pose\n"
        "float64 confidence"
    ),
    "aruco_msgs/msg/MarkerArray": "std_msgs/Header header\naruco_msgs/Marker[] markers",
    "aruco_opencv_msgs/msg/MarkerPose": "uint16 marker_id\ngeometry_msgs/Pose pose",
    "aruco_opencv_msgs/msg/ArucoDetection": (
        "std_msgs/Header header\naruco_opencv_msgs/MarkerPose[] markers"
    ),
    "mrpt_msgs/msg/SingleRangeBearingObservation": (
        "float64 range\nfloat64 yaw\nfloat64 pitch\nint32 id"
    ),
    "mrpt_msgs/msg/ObservationRangeBearing": (
        "std_msgs/Header header\ngeometry_msgs/Pose sensor_pose_on_robot\n"
        "float64 min_sensor_distance\nfloat64 max_sensor_distance\nfloat64 sensor_std_range\n"
        "float64 sensor_std_yaw\nfloat64 sensor_std_pitch\n"
        "mrpt_msgs/SingleRangeBearingObservation[] sensed_data"
    ),
    "fiducial_msgs/msg/FiducialTransform": (
        "int32 fiducial_id\ngeometry_msgs/Transform transform\nfloat64 image_error\n"
        "float64 object_error\nfloat64 fiducial_area"
    ),
    "fiducial_msgs/msg/FiducialTransformArray": (
        "std_msgs/Header header\nint32 image_seq\nfiducial_msgs/FiducialTransform[] transforms"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection3DArray": (
        "std_msgs/Header header\nvision_msgs/Detection3D[] detections"
    ),
}
for store in STORES.values():
    for name, fields in DEFINITIONS.items():
        if name not in store.fielddefs:
            store.register(get_types_from_msg(fields, name))
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

    def pose(self, point):
        make = self.messages
        place, turn = make.vector(point, "Point"), make.quaternion((0.0, 0.0, 0.6, 0.8))
        return make("geometry_msgs/Pose", position=place, orientation=turn)

    def with_covariance(self, point, covariance):
        whole = np.zeros((6, 6))
        whole[:3, :3] = covariance
        kind = "geometry_msgs/PoseWithCovariance"
        return self.messages(kind, pose=self.pose(point), covariance=whole.ravel())

    def array(self, kind, stamp, points, names=NAMES, frame="camera", covariances=None):
        """A message of a type without package, with landmarks at points (k, 3)."""
        if covariances is None:
            covariances = np.zeros((len(points), 3, 3))
        header = self.messages.header(stamp, frame)
        items = [*zip(points, names.tolist(), covariances, strict=True)]
        if kind == "ranges":
            return self.ranges(header, items)
        name = KINDS[kind][1].replace("/msg/", "/")
        field = self.messages.store.fielddefs[KINDS[kind][1]][1][-1][0]  # the last of all
        made = {field: [getattr(self, kind)(header, *item) for item in items]}
        if kind not in ("alvar", "markers"):
            made["header"] = header
        return self.messages(name, **made)

    def ros1_tags(self, header, point, name, covariance):
        pose = self.messages(
            "geometry_msgs/PoseWithCovarianceStamped",
            header=header,
            pose=self.with_covariance(point, covariance),
        )
        numbers = {"id": np.array([name], np.int32), "size": np.array([0.1])}
        return self.messages("apriltag_ros/AprilTagDetection", pose=pose, **numbers)

    def ros2_tags(self, header, point, name, covariance):
        told = {"family": "tag36h11", "id": name, "decision_margin": 50.0}
        return self.messages("apriltag_msgs/AprilTagDetection", **told)

    def alvar(self, header, point, name, covariance):
        pose = self.messages("geometry_msgs/PoseStamped", pose=self.pose(point))
        return self.messages("ar_track_alvar_msgs/AlvarMarker", header=header, id=name, pose=pose)

    def aruco(self, header, point, name, covariance):
        pose = self.with_covariance(point, covariance)
        return self.messages("aruco_msgs/Marker", header=header, id=name, pose=pose)

    def aruco_opencv(self, header, point, name, covariance):
        kind = "aruco_opencv_msgs/MarkerPose"
        return self.messages(kind, marker_id=name, pose=self.pose(point))

    def ranges(self, header, items, sigma=(0.0, 0.0, 0.0)):
        seen = [
            self.messages(
                "mrpt_msgs/SingleRangeBearingObservation",
                range=float(np.linalg.norm(point)),
                yaw=np.arctan2(point[1], point[0]),
                pitch=-np.arctan2(point[2], np.hypot(point[0], point[1])),
                id=name,
            )
            for point, name, _ in items
        ]
        parts = ("range", "yaw", "pitch")
        spread = {f"sensor_std_{part}": each for part, each in zip(parts, sigma, strict=True)}
        return self.messages(
            "mrpt_msgs/ObservationRangeBearing",
            header=header,
            sensor_pose_on_robot=self.pose((0, 0, 0)),
            max_sensor_distance=30.0,
            sensed_data=seen,
            **spread,
        )

    def fiducials(self, header, point, name, covariance):
        make = self.messages
        turn = make.quaternion((0.0, 0.0, 0.0, 1.0))
        moved = make("geometry_msgs/Transform", translation=make.vector(point), rotation=turn)
        return make("fiducial_msgs/FiducialTransform", fiducial_id=name, transform=moved)

    def detections(self, header, point, name, covariance):
        found = self.messages(
            "vision_msgs/ObjectHypothesisWithPose", pose=self.with_covariance(point, covariance)
        )
        return self.messages(
            "vision_msgs/Detection3D", header=header, results=[found], id=str(name)
        )

    def markers(self, header, point, name, covariance):
        return self.marker(header, point, name)

    def marker(self, header, point, name, **changed):
        values = {"header": header, "ns": "poles", "id": name, "type": 3, "pose": self.pose(point)}
        return self.messages("visualization_msgs/Marker", **values | changed)

    def poses(self, header, point, name, covariance):
        return self.pose(point)


KINDS = {
    "ros1_tags": ("/tag_detections", "apriltag_ros/msg/AprilTagDetectionArray"),
    "ros2_tags": ("/detections", "apriltag_msgs/msg/AprilTagDetectionArray"),
    "alvar": ("/ar_pose_marker", "ar_track_alvar_msgs/msg/AlvarMarkers"),
    "aruco": ("/marker_publisher/markers", "aruco_msgs/msg/MarkerArray"),
    "aruco_opencv": ("/aruco_detections", "aruco_opencv_msgs/msg/ArucoDetection"),
    "ranges": ("/landmark", "mrpt_msgs/msg/ObservationRangeBearing"),
    "fiducials": ("/fiducial_transforms", "fiducial_msgs/msg/FiducialTransformArray"),
    "detections": ("/tags", "vision_msgs/msg/Detection3DArray"),
    "markers": ("/poles", "visualization_msgs/msg/MarkerArray"),
    "poses": ("/trees", "geometry_msgs/msg/PoseArray"),
}
"""Topic and type by the method of `Builder`."""


def transforms(messages, *stamped):
    """A TFMessage of (parent, child, rotation, position, seconds)."""
    made = []
    for parent, child, rotation, position, seconds in stamped:
        transform = messages.transform(parent, child, position, rotation.as_quat())
        transform.header.stamp = messages.header(seconds).stamp
        made.append(transform)
    return messages("tf2_msgs/TFMessage", transforms=made)


def static(messages):
    mast = ("base_link", "mast", *MOUNTED, START)
    return transforms(messages, mast, ("mast", "camera", *OPTICAL, START))


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
            yield "/tf", TRANSFORMS, time, transforms(messages, *tags)
