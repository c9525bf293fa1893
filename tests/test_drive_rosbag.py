"""Bags as ROS 1 and 2 write them, made with rosbags' own writers."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from refusals import refuses
from saccade.datasets import load_drive
from saccade.errors import DriveError, ImageError

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


@pytest.fixture(params=[1, 2])
def bag(request, tmp_path):
    """A function that writes lists of (topic, type, seconds, message) and gives the path."""
    store = STORES[request.param]

    def write(make):
        path = tmp_path / ("way.bag" if request.param == 1 else "way")
        writer = Writer1(path) if request.param == 1 else Writer2(path, version=9)
        with writer:
            connections = {}
            for topic, kind, seconds, message in make(Messages(store)):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                to_bytes = store.serialize_ros1 if request.param == 1 else store.serialize_cdr
                # recorded a little later than it was taken
                stamp = round((seconds + 0.003) * SECOND)
                writer.write(connections[topic], stamp, to_bytes(message, kind))
        return path

    return write


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


def test_a_stereo_bag(bag):
    drive = load_drive("auto", bag(stereo))
    assert len(drive) == FRAMES
    assert drive.camera.baseline == pytest.approx(0.2)
    np.testing.assert_allclose(drive.camera.place, [0.1, 0, 0.7], atol=1e-12)
    ahead = drive.camera.rotation @ [0, 0, 1]  # the optical axis looks to the robot's left
    np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(drive.camera.rotation @ [0, 1, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(drive.time, np.arange(FRAMES) / 10, atol=1e-6)
    for i in (3, 0, 5):
        np.testing.assert_array_equal(drive.load(i).image, pictures()[0, i])
        np.testing.assert_array_equal(drive.load(i).right, pictures()[1, i])
    assert drive.load(4).right is None
    np.testing.assert_allclose(drive.control, [[0.2, 0, 0]] * 5, atol=1e-6)
    np.testing.assert_allclose(drive.start, [1, 2, 0], atol=1e-6)
    np.testing.assert_allclose(drive.truth.at(drive.time)[:, 0], 1 + 0.16 * np.arange(FRAMES))


def test_a_bag_is_read_by_any_thread(bag):
    drive = load_drive("auto", bag(stereo))
    with ThreadPoolExecutor(1) as other:
        np.testing.assert_array_equal(other.submit(drive.load, 3).result().image, pictures()[0, 3])
    np.testing.assert_array_equal(drive.load(5).image, pictures()[0, 5])


def test_a_bag_with_depth_and_colours(bag):
    color = np.random.default_rng(4).integers(0, 255, (48, 64, 3), np.uint8)
    depth = np.full((48, 64), 1500, np.uint16)
    depth[0] = 0

    def make(messages):
        for i in range(3):
            t = 7 + i / 10
            image = messages.image(t, color, "bgr8")
            yield "/camera/rgb/image_raw", "sensor_msgs/msg/Image", t, image
            yield "/camera/rgb/camera_info", "sensor_msgs/msg/CameraInfo", t, messages.info(t)
            deep = messages.image(t + 0.004, depth, "16UC1")
            yield "/camera/depth/image_raw", "sensor_msgs/msg/Image", t, deep

    frame = load_drive("rosbag", bag(make)).load(1)
    np.testing.assert_array_equal(frame.image, color[..., ::-1])
    assert np.isnan(frame.depth[0]).all()
    assert (frame.depth[1:] == 1.5).all()


def test_what_is_broken_is_named(bag):
    def unknown(messages):
        broken = messages.image(1.0, pictures()[0, 0], "yuv9")
        yield "/image", "sensor_msgs/msg/Image", 1.0, broken
        yield "/camera_info", "sensor_msgs/msg/CameraInfo", 1.0, messages.info(1.0)

    with refuses(ImageError, "way", "/image, frame 0: expected one of mono8", "found 'yuv9'"):
        load_drive("rosbag", bag(unknown)).load(0)


def test_a_bag_without_images_is_none(bag):
    def make(messages):
        yield "/odom", "nav_msgs/msg/Odometry", 1.0, messages.odometry(1.0, 0.0, 0.0, 0.0)

    with refuses(DriveError, "expected a topic of images, found /odom"):
        load_drive("rosbag", bag(make))


def test_what_is_no_bag_is_refused(tmp_path):
    (tmp_path / "way.bag").write_bytes(b"no bag at all")
    with refuses(DriveError, "way.bag: expected a ROS bag"):
        load_drive("auto", tmp_path / "way.bag")
