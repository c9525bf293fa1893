"""Bags as ROS 1 and 2 write them, made with rosbags' own writers."""

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

FRAMES = 6
SECOND = 10**9


class Messages:
    """Messages of one of the two."""

    def __init__(self, store):
        self.store = store
        self.kinds = store.types
        self.old = store is STORES[1]

    def __call__(self, kind, **values):
        """A message of a type (package/Name); those inside may be dicts, what is left out is 0."""
        name = kind if "/msg/" in kind else kind.replace("/", "/msg/")
        fields = self.store.fielddefs[name][1]
        return self.kinds[name](**{each: self.field(*of, values.get(each)) for each, of in fields})

    def field(self, node, of, value):
        """What a field holds; `value` is None by default."""
        if node == Nodetype.NAME and (value is None or isinstance(value, dict)):
            return self(of, **(value or {}))
        if node in (Nodetype.NAME, Nodetype.BASE):
            empty = {"string": "", "bool": False}.get(of[0], 0.0 if "float" in of[0] else 0)
            return empty if value is None else value
        (inner, kind), length = of
        if inner == Nodetype.BASE:
            return np.zeros(length, kind[0]) if value is None else value
        return [self.field(inner, kind, each) for each in value or [None] * length]

    def header(self, seconds, frame="camera"):
        whole = int(seconds)
        nanoseconds = round((seconds - whole) * SECOND)
        stamp = self("builtin_interfaces/Time", sec=whole, nanosec=nanoseconds)
        return self("std_msgs/Header", stamp=stamp, frame_id=frame)

    def image(self, seconds, pixels, encoding, step=None):
        data = np.ascontiguousarray(pixels)
        row = data.view(np.uint8).reshape(len(data), -1)
        return self(
            "sensor_msgs/Image",
            header=self.header(seconds),
            height=data.shape[0],
            width=data.shape[1],
            encoding=encoding,
            step=step or row.shape[1],
            data=row.ravel(),
        )

    def info(self, seconds, baseline=0.0, bent=(0.0,) * 5, model="plumb_bob"):
        K = np.array([50.0, 0, 32, 0, 51.0, 24, 0, 0, 1])
        P = np.array([50.0, 0, 32, -50 * baseline, 0, 51.0, 24, 0, 0, 0, 1, 0])
        names = "DKRP" if self.old else "dkrp"
        values = dict(zip(names, (np.array(bent), K, np.eye(3).ravel(), P), strict=True))
        values |= {"header": self.header(seconds), "distortion_model": model}
        return self("sensor_msgs/CameraInfo", height=48, width=64, **values)

    def pose(self, x, y, heading):
        turn = (0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2))
        return {"position": xyzw(x, y, 0.0), "orientation": xyzw(*turn)}

    def odometry(self, seconds, x, y, heading):
        values = {
            "header": self.header(seconds, "odom"),
            "pose": {"pose": self.pose(x, y, heading)},
        }
        return self("nav_msgs/Odometry", child_frame_id="base_link", **values)

    def true(self, seconds, x, y, heading):
        header = self.header(seconds, "world")
        return self("geometry_msgs/PoseStamped", header=header, pose=self.pose(x, y, heading))

    def transforms(self, *stamped):
        """A TFMessage of (parent, child, rotation, position, seconds)."""
        made = [
            {
                "header": self.header(seconds, parent),
                "child_frame_id": child,
                "transform": {"translation": xyzw(*position), "rotation": xyzw(*turn.as_quat())},
            }
            for parent, child, turn, position, seconds in stamped
        ]
        return self("tf2_msgs/TFMessage", transforms=made)


def xyzw(*values):
    """Coordinates by name."""
    return dict(zip("xyzw", map(float, values), strict=False))


STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
STORES[1].register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)


def write_bag(folder, version, make, storage="db3"):
    """Write (topic, type, seconds, message), which `make` gives; gives the path of the bag."""
    store = STORES[version]
    path = folder / ("way.bag" if version == 1 else "way")
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=plugin)
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
    left, ahead = Rotation.from_euler("z", np.pi / 2), Rotation.from_quat((-0.5, 0.5, -0.5, 0.5))
    mast = ("base_link", "mast", left, (0.2, 0.0, 0.7), 0.0)
    return make.transforms(mast, ("mast", "camera", ahead, (0.0, 0.1, 0.0), 0.0))


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
