"""The ROS 2 node of the examples, without ROS: recorded messages against `run` on the same log."""

import dataclasses
import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from saccade import slam
from saccade.simulation import WorldConfig, simulate_world
from support.landmark_bags import START
from support.paths import ROOT
from support.ros_bags import STORES, write_bag

spec = importlib.util.spec_from_file_location(
    "slam_node", ROOT / "examples" / "ros2" / "slam_node.py"
)
node = importlib.util.module_from_spec(spec)
spec.loader.exec_module(node)

ODOMETRY, DETECTIONS = "nav_msgs/msg/Odometry", "vision_msgs/msg/Detection3DArray"
KNOWN = slam.EkfConfig(association="known", smooth=False, estimate_systematic_errors=False)


@pytest.fixture(scope="module")
def log():
    """Odometry at 8 Hz, scans at 2 Hz."""
    world = WorldConfig(steps=400, step_time=0.125, scan_interval=4, odometry_percent=1.0)
    return simulate_world(world, seed=4)


def messages(log):
    """What a robot on this log publishes, for `write_bag`."""

    def make(build):
        pose = np.zeros(3)
        for i, time in enumerate((START + log.time).tolist()):
            U = np.zeros((3, 3))
            if i > 0:
                pose, U = slam.compose(pose, log.control[i - 1])[0], log.control_covariance[i - 1]
            rate = np.zeros((6, 6))
            rate[node.PLANE] = U / (log.time[1] - log.time[0]) ** 2
            message = build.odometry(time, *pose.tolist())
            yield (
                "/odom",
                ODOMETRY,
                time,
                dataclasses.replace(
                    message, twist=dataclasses.replace(message.twist, covariance=rate.ravel())
                ),
            )
            seen = np.flatnonzero(log.observation_pose == i)
            if len(seen):
                detections = [detection(build, time, log, k) for k in seen]
                header = build.header(time, "base_link")
                message = build(
                    "vision_msgs/Detection3DArray", header=header, detections=detections
                )
                yield "/tags", DETECTIONS, time, message

    return make


def detection(build, time, log, k):
    xy, _, G = slam.inverse_observe(np.zeros(3), log.observation[k])
    C = np.zeros((6, 6))
    C[:2, :2] = G @ log.observation_covariance[k] @ G.T
    pose = build(
        "geometry_msgs/PoseWithCovariance", pose=build.pose(*xy, 0.0), covariance=C.ravel()
    )
    result = build("vision_msgs/ObjectHypothesisWithPose", pose=pose)
    header = build.header(time, "base_link")
    name = str(log.landmark[k])
    return build("vision_msgs/Detection3D", header=header, results=[result], id=name)


@pytest.fixture(scope="module")
def bag(log, tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag"), 2, messages(log))


@pytest.fixture(scope="module")
def recorded(bag):
    """The messages of a bag, in the order of recording."""
    with AnyReader([bag], default_typestore=STORES[2]) as reader:
        return [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
        ]


def feed(received, config=KNOWN, **settings):
    queue = node.ScanQueue(slam.Slam(config), node.NodeConfig(**settings))
    updates = []
    for topic, message in received:
        take = queue.on_odometry if topic == "/odom" else queue.on_detections
        updates += take(message)
    return queue, updates


def check_against_run(log, updates, config=KNOWN):
    result = slam.run(log, config)
    steps = np.rint([each.time / 0.125 for each in updates]).astype(int)
    assert set(steps) >= set(log.observation_pose)
    np.testing.assert_allclose(
        [each.step.pose for each in updates], result.trajectory.pose[steps], atol=1e-6
    )
    np.testing.assert_allclose(
        [each.step.covariance for each in updates], result.trajectory.covariance[steps], atol=1e-8
    )
    return result


def test_recorded_messages_give_what_run_gives(log, recorded):
    """Four odometry messages become one control: the same as four steps without a scan."""
    queue, updates = feed(recorded)
    result = check_against_run(log, updates)
    used = np.concatenate([each.step.association for each in updates])
    np.testing.assert_array_equal(used, result.association)
    np.testing.assert_allclose(queue.filter.map.xy, result.map.xy, atol=1e-6)
    assert queue.dropped == queue.restarts == 0


def stamps(received):
    stamp = [message.header.stamp for _, message in received]
    return np.array([each.sec - START + 1e-9 * each.nanosec for each in stamp])


@pytest.mark.parametrize(("in_order", "tolerance"), [(True, 1e-9), (False, 0.05)])
def test_late_messages_change_nothing(recorded, rng, in_order, tolerance):
    """They come up to 0.3 s after their stamps; or even in another order within a topic."""
    arrival = stamps(recorded) + rng.uniform(0, 0.3, len(recorded))
    arrival[0] = 0.0
    if in_order:
        for topic in ("/odom", "/tags"):
            of_topic = np.array([name == topic for name, _ in recorded])
            arrival[of_topic] = np.maximum.accumulate(arrival[of_topic])
    _, expected = feed(recorded)
    queue, updates = feed([recorded[i] for i in np.argsort(arrival, kind="stable")])
    assert queue.dropped == 0
    assert np.all(np.diff([each.time for each in updates]) > 0)
    poses = {each.time: each.step.pose for each in updates}
    scans = [each for each in expected if len(each.step.association)]
    assert len(scans) > 50
    for each in scans:
        np.testing.assert_allclose(poses[each.time], each.step.pose, atol=tolerance)


def test_a_clock_that_starts_anew_and_scans_too_late(recorded):
    """A bag that is played twice: the map stays, and the jump back is no motion."""
    queue, updates = feed([*recorded, *recorded])
    assert queue.restarts >= 1
    assert np.all(np.diff([each.time for each in updates]) > 0)
    assert all(np.isfinite(each.step.pose).all() for each in updates)
    scans = [each for each in recorded if each[0] == "/tags"]
    queue, _ = feed([*recorded, scans[-3]])
    assert queue.dropped == 1


def test_odometry_that_is_reset_is_no_motion(recorded):
    def reset(topic, message):
        if topic == "/odom" and message.header.stamp.sec - START >= 30:
            moved = dataclasses.replace(message.pose.pose.position, x=500.0, y=0.0)
            pose = dataclasses.replace(message.pose.pose, position=moved)
            pose = dataclasses.replace(message.pose, pose=pose)
            return topic, dataclasses.replace(message, pose=pose)
        return topic, message

    queue, updates = feed([reset(*each) for each in recorded])
    assert queue.restarts == 1
    assert max(np.abs(each.step.pose[:2]).max() for each in updates) < 100


def test_what_is_published_has_the_conventions_of_ros():
    empty = SimpleNamespace
    pose = empty(position=empty(), orientation=empty())
    node.fill_pose(pose, np.array([1.0, 2.0, 0.5]))
    pose.orientation.x = pose.orientation.y = 0.0
    np.testing.assert_allclose(node._pose(pose), (1.0, 2.0, 0.5))
    C = np.array([[1.0, 0.2, 0.3], [0.2, 2.0, 0.4], [0.3, 0.4, 3.0]])
    numbers = node.ros_covariance(C)
    assert [numbers[i] for i in (0, 1, 5, 7, 11, 35)] == [1.0, 0.2, 0.3, 2.0, 0.4, 3.0]
    marker = empty(pose=pose, scale=empty(), color=empty())
    node.fill_marker(marker, 3, np.zeros(2), np.diag([0.04, 0.01]))
    assert (marker.scale.x, marker.scale.y) == pytest.approx((1.2, 0.6))
    assert abs(np.sin(node._pose(marker.pose)[2])) < 1e-9
