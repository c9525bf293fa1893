"""Drives from bags of ROS 1 and 2."""

import shutil
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from saccade.datasets import load_drive
from saccade.datasets.ros.bags import TRUTH, has_word
from saccade.errors import DriveError, ImageError
from saccade.frames import AHEAD
from support.error_checks import refuses
from support.landmark_bags import START, TRANSFORMS, odometry
from support.ros_bags import FRAMES, pictures, stereo, write_bag


@pytest.fixture(params=[1, 2])
def bag(request, tmp_path):
    """A function that writes lists of (topic, type, seconds, message) and gives the path."""
    return lambda make: write_bag(tmp_path, request.param, make)


def test_a_stereo_bag(bag):
    drive = load_drive("auto", bag(stereo))
    assert len(drive) == FRAMES
    assert drive.camera.baseline == pytest.approx(0.2)
    np.testing.assert_allclose(drive.camera.position, [0.1, 0, 0.7], atol=1e-12)
    ahead = drive.camera.rotation @ [0, 0, 1]  # the optical axis looks to the robot's left
    np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(drive.camera.rotation @ [0, 1, 0], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(drive.time, 100 + np.arange(FRAMES) / 10, atol=1e-6)
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


def turning(messages, rotation_at, arm=0.0):
    """A camera on a mount that turns, published between the images, on a robot that drives.

    `rotation_at` is that of the mount at a time in seconds; the camera is `arm` ahead of its axis.
    """
    optical = ("head", "camera", *(Rotation.from_matrix(AHEAD), (arm, 0.0, 0.0)), START)
    yield "/tf_static", TRANSFORMS, START, messages.transforms(optical)
    yield from odometry(messages)
    for i in range(-1, 24):
        seconds, turn = 0.07 * i, Rotation.from_euler("z", 0.1 * i)
        head = ("base_link", "head", rotation_at(seconds), (0.1, 0.0, 0.9), START + seconds)
        robot = ("odom", "base_link", turn, (0.1 * i, 0.0, 0.0), START + seconds)
        yield "/tf", TRANSFORMS, START + seconds, messages.transforms(robot, head)
    for i in range(FRAMES):
        time = START + i / 5
        image = messages.image(time, pictures()[0, i], "mono8")
        yield "/camera/image", "sensor_msgs/msg/Image", time, image
        yield "/camera/camera_info", "sensor_msgs/msg/CameraInfo", time, messages.info(time)


def pan_and_tilt(seconds):
    """Rotation of a mount that pans at a constant rate, tilted and rolled by constant angles."""
    return Rotation.from_euler("ZYX", [0.8 * seconds - 0.3, -0.2, 0.15])


def nod(seconds):
    return Rotation.from_euler("ZYX", [0.5, 0.4 * seconds, 0.15])


@pytest.mark.parametrize("rotation_at", [pan_and_tilt, nod])
def test_a_camera_that_pans_and_tilts_has_a_turn_in_each_frame(bag, rotation_at):
    drive = load_drive("auto", bag(lambda messages: turning(messages, rotation_at)))
    np.testing.assert_allclose(drive.camera.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(drive.camera.position, [0.1, 0, 0.9], atol=1e-9)
    for i in range(FRAMES):
        turn = drive.load(i).turn
        pan, pitch, _ = rotation_at(i / 5).as_euler("ZYX")
        np.testing.assert_allclose(turn[:3], (pan, -pitch, 0.0), atol=1e-6)
        expected = rotation_at(i / 5).as_matrix() @ AHEAD
        np.testing.assert_allclose(drive.camera.turned(turn).rotation, expected, atol=1e-6)
    assert drive.assumptions == ()


def test_a_camera_without_a_transform_is_told(bag):
    def make(messages):
        return (each for each in turning(messages, nod) if each[1] != TRANSFORMS)

    (told,) = load_drive("auto", bag(make)).assumptions
    assert "no transform from base_link to camera" in told
    assert "camera.toml" in told


def test_an_optical_center_off_the_axis_is_told(bag):
    drive = load_drive("auto", bag(lambda messages: turning(messages, pan_and_tilt, arm=0.2)))
    (told,) = drive.assumptions
    assert "/camera/image: the optical center moves by up to 0.0" in told


def test_a_camera_that_rolls_is_refused(bag):
    def roll(seconds):
        return Rotation.from_euler("x", 0.5 * seconds)

    with refuses(DriveError, "/camera/image: expected a camera that pans and tilts, found", "0.5"):
        load_drive("auto", bag(lambda messages: turning(messages, roll)))


def lens(kind, topic, bent=(0.0,) * 5, baseline=0.2):
    """A camera, or a pair of {side} cameras, of a lens model."""

    def make(messages):
        for side in ("left", "right") if "{side}" in topic else ("",):
            for i in range(3):
                info = messages.info(i, baseline if side == "right" else 0.0, bent, kind)
                image = messages.image(i, pictures()[0, i], "mono8")
                name = topic.format(side=side)
                yield name, "sensor_msgs/msg/Image", i, image
                yield (
                    f"{name.rpartition('/')[0]}/camera_info",
                    "sensor_msgs/msg/CameraInfo",
                    i,
                    info,
                )

    return make


BENT = (-0.3, 0.1, 0.001, 0.0, 0.0)


@pytest.mark.parametrize(
    ("topic", "model"),
    [
        *[("/camera/image_rect", "plumb_bob"), ("/camera/image_rect_color", "equidistant")],
        *[("/camera/imageRect", "plumb_bob"), ("/undistorted/image", "equidistant")],
        ("/stereo/{side}/image_rect", "plumb_bob"),
        ("/zed/rgb_{side}/image_rect_color", "equidistant"),
    ],
)
def test_rectified_images_have_the_projection_and_no_distortion(bag, topic, model):
    """By the documentation of CameraInfo: P is of rectified images, K and D are of raw ones."""
    drive = load_drive("auto", bag(lens(model, topic, BENT)))
    np.testing.assert_array_equal(drive.load(1).image, pictures()[0, 1])
    assert drive.camera.baseline == (0.2 if "{side}" in topic else 0)


@pytest.mark.parametrize("topic", ["/camera/image_raw", "/direct/image", "/rectangle/image"])
def test_raw_images_are_undistorted(bag, topic):
    drive = load_drive("auto", bag(lens("plumb_bob", topic, BENT)))
    expected = cv2.undistort(
        pictures()[0, 1], np.array([[50.0, 0, 32], [0, 51.0, 24], [0, 0, 1]]), np.array(BENT)
    )
    found = drive.load(1).image.astype(float)
    assert np.abs(found - expected).mean() < 4
    assert np.abs(found - pictures()[0, 1]).mean() > 20


def test_raw_images_of_a_pair_are_refused(bag):
    with refuses(DriveError, "expected rectified images of a stereo pair"):
        load_drive("auto", bag(lens("plumb_bob", "/{side}/image_raw", BENT)))


@pytest.mark.parametrize(
    ("model", "bent"), [("fov", BENT[:4]), ("new", (0.0,) * 4), ("equidistant", BENT)]
)
def test_other_lens_models_are_refused(bag, model, bent):
    with refuses(DriveError, "/camera_info: expected the lens pinhole with", model):
        load_drive("auto", bag(lens(model, "/camera/image_raw", bent)))


def test_higher_coefficients_that_are_zero_are_none(bag):
    drive = load_drive("auto", bag(lens("rational_polynomial", "/image", (0.0,) * 8)))
    np.testing.assert_array_equal(drive.load(1).image, pictures()[0, 1])


@pytest.mark.parametrize(
    ("topic", "pattern", "expected"),
    [
        *((topic, TRUTH, True) for topic in ("/gt/odom", "/gt_pose", "/robot1/poseGT", "/GTPose")),
        *((topic, TRUTH, True) for topic in ("/groundtruth", "/ground_truth/odom", "/gt0")),
        *((topic, TRUTH, True) for topic in ("/vicon/jackal/jackal", "/mocapNode/pose")),
        *((topic, TRUTH, False) for topic in ("/length/odom", "/gtsam/odom", "/width/weightth")),
        *((topic, TRUTH, False) for topic in ("/straightto/odom", "/odom")),
        *((topic, "right.*", True) for topic in ("/right/image", "/rightCamera", "/cam_right0")),
        *((topic, "right.*", False) for topic in ("/bright/image", "/upright_camera/image")),
    ],
)
def test_words_of_topics_are_whole(topic, pattern, expected):
    assert has_word(topic, pattern) == expected


@pytest.mark.parametrize("storage", ["mcap", "db3"])
@pytest.mark.parametrize("form", ["file", "folder"])
def test_files_of_a_bag_need_no_metadata(tmp_path, storage, form):
    whole = load_drive("auto", write_bag(tmp_path, 2, stereo, storage))
    part = tmp_path / "part"
    part.mkdir()
    (file,) = (tmp_path / "way").glob(f"*.{storage}")
    file.rename(part / f"run.{storage}")
    drive = load_drive("auto", part / f"run.{storage}" if form == "file" else part)
    np.testing.assert_array_equal(drive.control, whole.control)
    np.testing.assert_array_equal(drive.load(5).image, pictures()[0, 5])


def test_parts_of_a_bag_are_one_and_bags_are_not(tmp_path):
    def some(first):
        return lambda messages: (each for each in stereo(messages) if (each[2] < 100.3) == first)

    (tmp_path / "parts").mkdir()
    for number, first in ((9, True), (10, False)):
        path = write_bag(tmp_path, 2, some(first), "mcap")
        next(path.glob("*.mcap")).rename(tmp_path / f"parts/way_{number}.mcap")
        shutil.rmtree(path)
    drive = load_drive("auto", tmp_path / "parts")
    np.testing.assert_allclose(drive.time, 100 + np.arange(FRAMES) / 10, atol=1e-6)
    (tmp_path / "parts/way_9.mcap").rename(tmp_path / "parts/other.mcap")
    with refuses(DriveError, "parts: expected one bag, found other.mcap, way_10.mcap"):
        load_drive("auto", tmp_path / "parts")


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


@pytest.mark.parametrize("definition", ["uint64 other", "string header\nuint32 height"])
def test_a_definition_that_is_not_that_of_ros_is_refused(tmp_path, definition):
    kind = "sensor_msgs/msg/Image"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, kind))
    with Writer(tmp_path / "way.bag") as writer:
        image = writer.add_connection("/image", kind, typestore=store)
        writer.write(image, 1, bytes(8))
    with refuses(DriveError, "way.bag: expected messages as ROS defines them"):
        load_drive("rosbag", tmp_path / "way.bag")
