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
        self.messages, self.kinds = messages, messages.kinds

    def pose(self, point):
        return self.kinds["geometry_msgs/msg/Pose"](
            self.kinds["geometry_msgs/msg/Point"](*map(float, point)),
            self.kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.6, 0.8),
        )

    def with_covariance(self, point, covariance):
        whole = np.zeros((6, 6))
        whole[:3, :3] = covariance
        return self.kinds["geometry_msgs/msg/PoseWithCovariance"](self.pose(point), whole.ravel())

    def array(self, kind, stamp, points, names=NAMES, frame="camera", covariances=None):
        """A message of a type without package, with landmarks at points (k, 3)."""
        if covariances is None:
            covariances = np.zeros((len(points), 3, 3))
        header = self.messages.header(stamp, frame)
        items = zip(points, names.tolist(), covariances, strict=True)
        make = getattr(self, kind)
        return make(header, [*items])

    def ros1_tags(self, header, items):
        kinds = self.kinds
        detections = [
            kinds["apriltag_ros/msg/AprilTagDetection"](
                np.array([name], np.int32),
                np.array([0.1]),
                kinds["geometry_msgs/msg/PoseWithCovarianceStamped"](
                    header, self.with_covariance(point, covariance)
                ),
            )
            for point, name, covariance in items
        ]
        return kinds["apriltag_ros/msg/AprilTagDetectionArray"](header, detections)

    def ros2_tags(self, header, items):
        kinds = self.kinds
        corner = kinds["apriltag_msgs/msg/Point"](1.0, 2.0)
        detections = [
            kinds["apriltag_msgs/msg/AprilTagDetection"](
                "tag36h11", name, 0, 0.0, 50.0, corner, [corner] * 4, np.eye(3).ravel()
            )
            for _, name, _ in items
        ]
        return kinds["apriltag_msgs/msg/AprilTagDetectionArray"](header, detections)

    def alvar(self, header, items):
        kinds, empty = self.kinds, self.messages.header(0.0, "")
        markers = [
            kinds["ar_track_alvar_msgs/msg/AlvarMarker"](
                header, name, 1, kinds["geometry_msgs/msg/PoseStamped"](empty, self.pose(point))
            )
            for point, name, _ in items
        ]
        return kinds["ar_track_alvar_msgs/msg/AlvarMarkers"](empty, markers)

    def aruco(self, header, items):
        markers = [
            self.kinds["aruco_msgs/msg/Marker"](
                header, name, self.with_covariance(point, covariance), 1.0
            )
            for point, name, covariance in items
        ]
        return self.kinds["aruco_msgs/msg/MarkerArray"](header, markers)

    def aruco_opencv(self, header, items):
        markers = [
            self.kinds["aruco_opencv_msgs/msg/MarkerPose"](name, self.pose(point))
            for point, name, _ in items
        ]
        return self.kinds["aruco_opencv_msgs/msg/ArucoDetection"](header, markers)

    def ranges(self, header, items, sigma=(0.0, 0.0, 0.0)):
        seen = []
        for (x, y, z), name, _ in items:
            yaw, pitch = np.arctan2(y, x), -np.arctan2(z, np.hypot(x, y))
            distance = float(np.linalg.norm([x, y, z]))
            seen.append(
                self.kinds["mrpt_msgs/msg/SingleRangeBearingObservation"](
                    distance, yaw, pitch, name
                )
            )
        kind = self.kinds["mrpt_msgs/msg/ObservationRangeBearing"]
        return kind(header, self.pose((0, 0, 0)), 0.1, 30.0, *sigma, seen)

    def fiducials(self, header, items):
        kinds = self.kinds
        transforms = [
            kinds["fiducial_msgs/msg/FiducialTransform"](
                name,
                kinds["geometry_msgs/msg/Transform"](
                    kinds["geometry_msgs/msg/Vector3"](*map(float, point)),
                    kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                ),
                *(0.1, 0.1, 900.0),
            )
            for point, name, _ in items
        ]
        return kinds["fiducial_msgs/msg/FiducialTransformArray"](header, 0, transforms)

    def detections(self, header, items):
        kinds = self.kinds
        size = kinds["geometry_msgs/msg/Vector3"](0.1, 0.1, 0.1)
        hypothesis = kinds["vision_msgs/msg/ObjectHypothesis"]("tree", 1.0)
        found = [
            kinds["vision_msgs/msg/Detection3D"](
                header,
                [
                    kinds["vision_msgs/msg/ObjectHypothesisWithPose"](
                        hypothesis, self.with_covariance(point, covariance)
                    )
                ],
                kinds["vision_msgs/msg/BoundingBox3D"](self.pose(point), size),
                str(name),
            )
            for point, name, covariance in items
        ]
        return kinds["vision_msgs/msg/Detection3DArray"](header, found)

    def markers(self, header, items):
        return self.kinds["visualization_msgs/msg/MarkerArray"](
            [self.marker(header, point, name) for point, name, _ in items]
        )

    def marker(self, header, point, name, **changed):
        kinds = self.kinds
        definition = kinds["visualization_msgs/msg/Marker"]
        values = {
            "header": header,
            **{"ns": "poles", "id": name, "type": 3, "action": 0, "pose": self.pose(point)},
            "scale": kinds["geometry_msgs/msg/Vector3"](0.1, 0.1, 1.0),
            "color": kinds["std_msgs/msg/ColorRGBA"](0.0, 1.0, 0.0, 1.0),
            "lifetime": kinds["builtin_interfaces/msg/Duration"](0, 0),
            **{"frame_locked": False, "points": [], "colors": [], "text": "", "mesh_resource": ""},
            "mesh_use_embedded_materials": False,
        }
        if "texture" in definition.__dataclass_fields__:
            image = kinds["sensor_msgs/msg/CompressedImage"](header, "", np.zeros(0, np.uint8))
            mesh = kinds["visualization_msgs/msg/MeshFile"]("", np.zeros(0, np.uint8))
            values |= {"texture_resource": "", "texture": image, "uv_coordinates": []}
            values |= {"mesh_file": mesh}
        return definition(**values | changed)

    def poses(self, header, items):
        poses = [self.pose(point) for point, _, _ in items]
        return self.kinds["geometry_msgs/msg/PoseArray"](header, poses)


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
    return messages.kinds[TRANSFORMS](made)


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
