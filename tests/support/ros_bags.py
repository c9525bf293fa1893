"""Bags as ROS 1 and 2 write them, made with rosbags' own writers."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FRAMES = 6
SECOND = 10**9


class Messages:
    """Messages of one of the two."""

    def __init__(self, store):
        self.store = store
        self.kinds = store.types
        self.old = store is STORES[1]

    def header(self, seconds, frame="camera"):
        whole = int(seconds)
        time = self.kinds["builtin_interfaces/msg/Time"](whole, round((seconds - whole) * SECOND))
        number = {"seq": 0} if self.old else {}
        return self.kinds["std_msgs/msg/Header"](**number, stamp=time, frame_id=frame)

    def image(self, seconds, pixels, encoding, step=None):
        data = np.ascontiguousarray(pixels)
        row = data.view(np.uint8).reshape(len(data), -1)
        return self.kinds["sensor_msgs/msg/Image"](
            header=self.header(seconds),
            height=data.shape[0],
            width=data.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=step or row.shape[1],
            data=row.ravel(),
        )

    def info(self, seconds, baseline=0.0, bent=(0.0,) * 5, model="plumb_bob"):
        K = np.array([50.0, 0, 32, 0, 51.0, 24, 0, 0, 1])
        P = np.array([50.0, 0, 32, -50 * baseline, 0, 51.0, 24, 0, 0, 0, 1, 0])
        names = "DKRP" if self.old else "dkrp"
        values = dict(zip(names, (np.array(bent), K, np.eye(3).ravel(), P), strict=True))
        region = self.kinds["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        return self.kinds["sensor_msgs/msg/CameraInfo"](
            header=self.header(seconds),
            height=48,
            width=64,
            distortion_model=model,
            **values,
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    def pose(self, x, y, heading):
        return self.kinds["geometry_msgs/msg/Pose"](
            self.kinds["geometry_msgs/msg/Point"](x, y, 0.0),
            self.kinds["geometry_msgs/msg/Quaternion"](
                0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)
            ),
        )

    def odometry(self, seconds, x, y, heading):
        vector = self.kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = self.kinds["geometry_msgs/msg/Twist"](vector, vector)
        covariance = np.zeros(36)
        return self.kinds["nav_msgs/msg/Odometry"](
            self.header(seconds, "odom"),
            "base_link",
            self.kinds["geometry_msgs/msg/PoseWithCovariance"](
                self.pose(x, y, heading), covariance
            ),
            self.kinds["geometry_msgs/msg/TwistWithCovariance"](twist, covariance),
        )

    def transform(self, parent, child, place, turn):
        return self.kinds["geometry_msgs/msg/TransformStamped"](
            self.header(0.0, parent),
            child,
            self.kinds["geometry_msgs/msg/Transform"](
                self.kinds["geometry_msgs/msg/Vector3"](*map(float, place)),
                self.kinds["geometry_msgs/msg/Quaternion"](*map(float, turn)),
            ),
        )

    def true(self, seconds, x, y, heading):
        return self.kinds["geometry_msgs/msg/PoseStamped"](
            self.header(seconds, "world"), self.pose(x, y, heading)
        )


STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
STORES[1].register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)


def write_bag(folder, version, make):
    """Write (topic, type, seconds, message), which `make` gives; gives the path of the bag."""
    store = STORES[version]
    path = folder / ("way.bag" if version == 1 else "way")
    writer = Writer1(path) if version == 1 else Writer2(path, version=9)
    with writer:
        connections = {}
        for topic, kind, seconds, message in make(Messages(store)):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            to_bytes = store.serialize_ros1 if version == 1 else store.serialize_cdr
            # recorded a little later than it was taken
            stamp = round((seconds + 0.003) * SECOND)
            writer.write(connections[topic], stamp, to_bytes(message, kind))
    return path


def pictures():
    return np.random.default_rng(3).integers(0, 255, (2, FRAMES, 48, 64), np.uint8)


def mounted(make):
    """On a mast that is turned to the left, a camera whose z axis is the mast's x axis."""
    mast = make.transform("base_link", "mast", (0.2, 0.0, 0.7), (0, 0, np.sqrt(0.5), np.sqrt(0.5)))
    camera = make.transform("mast", "camera", (0.0, 0.1, 0.0), (-0.5, 0.5, -0.5, 0.5))
    return make.kinds["tf2_msgs/msg/TFMessage"]([mast, camera])


def stereo(make):
    yield "/tf_static", "tf2_msgs/msg/TFMessage", 100.0, mounted(make)
    for i, (left, right) in enumerate(zip(*pictures(), strict=True)):
        t = 100 + i / 10
        yield "/stereo/left/image", "sensor_msgs/msg/Image", t, make.image(t, left, "mono8")
        if i != 4:
            yield "/stereo/right/image", "sensor_msgs/msg/Image", t, make.image(t, right, "mono8")
        for side, baseline in (("left", 0.0), ("right", 0.2)):
            info = make.info(t, baseline)
            yield f"/stereo/{side}/camera_info", "sensor_msgs/msg/CameraInfo", t, info
    for i in range(-1, 4 * FRAMES):
        t = 100 + i / 40
        way = make.odometry(t, 0.0, 0.05 * i, np.pi / 2)
        yield "/odom", "nav_msgs/msg/Odometry", t, way
        true = make.true(t, 1.0 + 0.04 * i, 2.0, 0.0)
        yield "/ground_truth/pose", "geometry_msgs/msg/PoseStamped", t, true
