"""Landmark logs from bags of ROS 1 and 2: a simulated robot's messages against its truth."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from saccade import LogWarning, slam
from saccade.datasets import load
from saccade.datasets.ros.messages import parse_labels
from saccade.errors import LogError
from support import landmark_bags as bags
from support.error_checks import refuses
from support.landmark_bags import KINDS, NAMES, START, TRANSFORMS, Builder
from support.ros_bags import write_bag


@pytest.fixture
def bag(tmp_path):
    """A function that writes lists of (topic, type, seconds, message) and gives the path."""
    return lambda make, version=2: write_bag(tmp_path, version, make)


def check_observations(log, scans=8, step=0.5, names=NAMES, atol=1e-9):
    expected = np.concatenate([bags.range_bearing(i * step) for i in range(scans)])
    np.testing.assert_allclose(log.observation[:, 0], expected[:, 0], atol=atol)
    turn = np.exp(1j * (log.observation[:, 1] - expected[:, 1]))
    np.testing.assert_allclose(turn, 1, atol=atol)
    seen = log.time[log.observation_pose] - START
    np.testing.assert_allclose(seen, np.repeat(np.arange(scans) * step, len(names)), atol=1e-6)
    np.testing.assert_array_equal(log.landmark, np.tile(names, scans))


@pytest.mark.parametrize(
    ("kind", "version"),
    [(kind, 1 + i % 2) for i, kind in enumerate(KINDS)]
    + [("detections", 1), ("ros2_tags", 1), ("ros1_tags", 2)],
)
def test_ranges_and_bearings_come_back_through_a_mount_with_rotation_and_offset(bag, kind, version):
    log = load("auto", bag(lambda messages: bags.drive(messages, kind), version))
    check_observations(log, names=NAMES if kind != "poses" else np.full(len(NAMES), -1))
    assert log.name == f"way, {KINDS[kind][0]} with /odom"
    pose = np.zeros(3)
    for control in log.control:
        pose = slam.compose(pose, control)[0]
    np.testing.assert_allclose(pose, bags.pose_at(4.0), atol=1e-6)


def test_the_transforms_of_a_mast_that_turns_are_those_at_the_time_of_a_message(bag):
    """Published at other times than the landmarks; it turns by half a radian a second."""

    def make(messages):
        build = Builder(messages)
        camera = messages.transforms(("mast", "camera", *bags.OPTICAL, START))
        yield "/tf_static", TRANSFORMS, START, camera
        yield from bags.odometry(messages)
        rotation, position = bags.MOUNTED
        for i in range(21):
            turned = rotation * Rotation.from_euler("z", 0.5 * 0.21 * i)
            mast = ("base_link", "mast", turned, position, START + 0.21 * i)
            yield "/tf", TRANSFORMS, START + 0.21 * i, messages.transforms(mast)
        for i in range(8):
            turn = Rotation.from_euler("z", 0.25 * i)
            points = bags.in_camera(bags.on_robot(i / 2), turn)
            time = START + i / 2
            yield *KINDS["detections"], time, build.array("detections", time, points)

    check_observations(load("auto", bag(make)), atol=1e-6)


def test_landmarks_in_the_frame_of_odometry_are_transformed_by_tf(bag):
    """And odometry is of tf, with the noise that is declared."""

    def make(messages):
        build = Builder(messages)
        for i in range(41):
            x, y, heading = bags.pose_at(i / 10)
            turn, time = Rotation.from_euler("z", heading), START + i / 10
            robot = ("odom", "base_link", turn, (x, y, 0.0), time)
            yield "/tf", TRANSFORMS, time, messages.transforms(robot)
        for i in range(8):
            time = START + i / 2
            scan = build.array("aruco", time, bags.LANDMARKS, frame="odom")
            yield *KINDS["aruco"], time, scan

    log = load("auto", bag(make))
    check_observations(log, atol=1e-6)
    assert log.name == "way, /marker_publisher/markers with odom to base_link"
    along = log.control_covariance[:, 0, 0].sum()
    assert along == pytest.approx(0.05**2 * bags.SPEED * 4.0, rel=1e-3)
    turn = log.control_covariance[:, 2, 2].sum()
    assert turn > 0.05**2 * (bags.SPEED + bags.TURN_RATE) * 4.0 * 0.999


def test_covariances_are_those_of_the_messages_or_declared(bag):
    """Along and across the sight on the ground, as seen by a camera that is turned."""
    along, across = 0.3, 0.01

    def make(messages):
        build = Builder(messages)
        yield "/tf_static", TRANSFORMS, START, bags.static(messages)
        yield from bags.odometry(messages)
        points = bags.on_robot(0.0)
        azimuth = Rotation.from_euler("z", np.arctan2(points[:, 1], points[:, 0])[:, None])
        to_camera = bags.camera_pose()[0].inv() * azimuth
        R = to_camera.as_matrix()
        C = R @ np.diag([along, across, 0.2]) ** 2 @ R.transpose(0, 2, 1)
        C[1] = 0.0
        C[2, 0, 0] = np.nan
        scan = build.array("detections", START, bags.in_camera(points), covariances=C)
        yield *KINDS["detections"], START, scan

    path, z = bag(make), bags.range_bearing(0.0)[:, 0]
    R = load("auto", path).observation_covariance
    for k in (0, 3):
        np.testing.assert_allclose(R[k], np.diag([along, across / z[k]]) ** 2, atol=1e-12)
    for k in (1, 2):
        np.testing.assert_allclose(R[k], np.diag([0.05 * z[k], 0.02]) ** 2, atol=1e-12)
    R = load("auto", path, sensor_sigma=(0.1, 0.3)).observation_covariance
    np.testing.assert_allclose(R[1], np.diag([0.1 * z[1], 0.3]) ** 2, atol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 1e6])
def test_a_covariance_that_means_unknown_is_not_believed(bag, rate):
    """Constant in the pose, and none or a very large one in the twist."""

    def make(messages):
        for topic, kind, time, message in bags.drive(messages, "alvar"):
            if topic == "/odom":
                message.pose.covariance = 1e-5 * np.eye(6).ravel()
                message.twist.covariance = np.diag([0.0] * 5 + [rate]).ravel()
            yield topic, kind, time, message

    log = load("auto", bag(make, 1))
    along = log.control_covariance[:, 0, 0].sum()
    assert along == pytest.approx(0.05**2 * bags.SPEED * 4.0, rel=0.01)


def test_names_become_numbers():
    assert parse_labels(["tag36h11:5", "", "tag36h11:12"]).tolist() == [5, -1, 12]
    for ambiguous in (["7", "007", ""], ["pole", "tree", "cone 3"], [f"a{10**20}", "b3"]):
        assert parse_labels(ambiguous).tolist() == ambiguous


def test_topics_are_chosen_by_type_then_name_or_wanted(bag):
    def make(messages):
        build = Builder(messages)
        yield from bags.drive(messages, "detections")
        points = bags.in_camera(bags.on_robot(0.0))
        for topic, kind in (("/z", "detections"), ("/b", "aruco"), ("/c", "poses")):
            message = build.array(kind, START, points)
            yield topic, KINDS[kind][1], START, message

    path = bag(make)
    assert load("auto", path, topic=["/tags"]).name == "way, /tags with /odom"
    assert load("auto", path).name == "way, /b with /odom"
    log = load("auto", path, topic=["/c", "/b"])
    assert log.name == "way, /c, /b with /odom"
    assert sorted(log.landmark.tolist()) == [-1, -1, -1, -1, *sorted(NAMES)]
    with refuses(LogError, "expected the topic /odom of apriltag_ros/msg/AprilTag", "found /b"):
        load("auto", path, topic=["/odom"])


def test_landmarks_without_odometry_or_position_are_left_out_and_told(bag):
    def make(messages):
        yield from bags.drive(messages, "fiducials", scans=9)
        build, points = Builder(messages), bags.in_camera(bags.on_robot(3.0))
        points[0] = np.nan
        points[1] = bags.in_camera(np.zeros((1, 3)))
        for time in (START - 5, START + 3.05, START + 50):
            yield *KINDS["fiducials"], time, build.array("fiducials", time, points)

    with pytest.warns(LogWarning, match=r"way, /fiducial_transforms: left out 10 of 48 landmarks"):
        log = load("auto", bag(make))
    assert len(log.observation) == 38


def test_a_reset_of_odometry_is_no_motion(bag):
    def make(messages):
        for topic, kind, time, message in bags.drive(messages, "poses"):
            if topic == "/odom" and time > START + 2.05:
                message.pose.pose.position.x += 30.0
            yield topic, kind, time, message

    with pytest.warns(LogWarning, match="/odom was reset 1 times; the motion there is unknown"):
        log = load("auto", bag(make))
    assert np.abs(log.control).max() < 0.5
    assert log.control_covariance[:, 0, 0].max() == pytest.approx(0.05**2, rel=0.5)


@pytest.mark.parametrize(
    ("kind", "topic", "parts"),
    [
        (
            "detections",
            "/tags",
            ("expected a topic of apriltag_ros/msg/AprilTagDetectionArray, ", "found /odom, /tf"),
        ),
        (
            "detections",
            "/odom",
            ("expected nav_msgs/msg/Odometry, or transforms from odom", "camera"),
        ),
        ("detections", "/tf_static", ("/tags: expected transforms from base_link to 'camera'",)),
        (
            "ros2_tags",
            "/tf",
            ("/detections: expected transforms from camera", "such as tag36h11:7"),
        ),
    ],
)
def test_what_is_missing_is_named(bag, kind, topic, parts):
    def make(messages):
        return (row for row in bags.drive(messages, kind) if row[0] != topic)

    with refuses(LogError, "way", *parts):
        load("auto", bag(make))


def test_tags_whose_transform_is_missing_are_left_out(bag):
    """The transform of one tag is published 0.2 s late, that of another not at all."""

    def make(messages):
        for topic, kind, time, message in bags.drive(messages, "ros2_tags"):
            if topic == "/tf":
                late = message.transforms[1].header
                late.stamp = messages.header(time + 0.2).stamp
                del message.transforms[3]
            yield topic, kind, time, message

    with pytest.warns(LogWarning, match="left out 16 of 32 landmarks"):
        log = load("auto", bag(make))
    assert log.landmark.tolist() == [7, 12] * 8
    expected = [bags.range_bearing(i / 2)[k, 0] for i in range(8) for k in (0, 2)]
    np.testing.assert_allclose(log.observation[:, 0], expected, atol=1e-9)


def without_definitions(path):
    """The bag as ROS 2 Humble and before write it."""
    with closing(sqlite3.connect(path / "way.db3")) as database:
        assert database.execute("DELETE FROM message_definitions").rowcount > 0
        database.commit()
    return path


@pytest.mark.parametrize("kind", ["detections", "ros2_tags"])
def test_the_usual_messages_need_no_definition_in_the_bag(bag, kind):
    path = without_definitions(bag(lambda messages: bags.drive(messages, kind)))
    check_observations(load("auto", path))


def test_a_bag_without_a_definition_is_refused(bag):
    path = without_definitions(bag(lambda messages: bags.drive(messages, "alvar")))
    with refuses(LogError, "/ar_pose_marker: expected the definition of ar_track_alvar_msgs/msg"):
        load("auto", path)
