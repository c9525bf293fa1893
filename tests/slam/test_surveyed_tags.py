"""Labels are evidence of where the robot is: one or two surveyed tags in view."""

import numpy as np
import pytest

import surveyed_tags
from saccade import slam
from saccade.types import LandmarkMap

rules = pytest.mark.parametrize("rule", ["auto", "known"])
TAGS = np.random.default_rng(4).uniform([0, 0], [16.5, 8], (16, 2))
SIGMA, U = np.array([0.05, 0.01]), np.diag([0.003, 0.003, 0.003]) ** 2
STEP = np.array([0.05, 0.0, 0.01])


def robot_in_map(rule="auto", start=None):
    known = LandmarkMap(np.arange(16), TAGS, np.tile(1e-4 * np.eye(2), (16, 1, 1)))
    config = slam.EkfConfig(association=rule, start_sigma=(0.05, 0.05, 0.02))
    return slam.Slam(config, map=known, start=start, mode="localize")


class Drive:
    """A robot that moves, observes the given tags, and tells its odometry to a `Slam`."""

    def __init__(self, robot, pose, seed=0):
        self.robot, self.pose, self.rng = robot, np.array(pose, float), np.random.default_rng(seed)
        self.time, self.moved = 0.0, False

    def step(self, tags, labels=None, places=None):
        """The result of a step, and the error of the pose in meters."""
        control = STEP + np.sqrt(U.diagonal()) * self.rng.standard_normal(3)
        if self.moved:
            self.pose = slam.compose(self.pose, STEP)[0]
        z = slam.observe(self.pose, (TAGS if places is None else places)[tags])[0]
        z = z + SIGMA * self.rng.standard_normal(z.shape)
        motion = (control, U) if self.moved else ()
        found = self.robot.step(
            self.time, *motion, z=z, R=np.diag(SIGMA**2), labels=tags if labels is None else labels
        )
        self.time, self.moved = self.time + 0.05, True
        return found, float(np.hypot(*(found.pose - self.pose)[:2]))

    def near(self, count):
        return np.argsort(np.hypot(*(TAGS - self.pose[:2]).T))[:count].tolist()


@rules
def test_two_labels_find_an_unknown_start(rule):
    drive = Drive(robot_in_map(rule), [5.0, 3.0, 1.0])
    results = [drive.step(drive.near(2)) for _ in range(10)]
    assert results[0][0].lost
    assert not results[3][0].lost
    assert results[-1][1] < 0.3


@rules
def test_tags_seen_one_after_the_other_find_an_unknown_start(rule):
    drive = Drive(robot_in_map(rule), [5.0, 3.0, 1.0])
    first, second = drive.near(2)
    alone = [drive.step([first])[0].lost for _ in range(15)]
    assert all(alone)  # every pose on a circle about the tag has the same observations
    both = [drive.step([second]) for _ in range(5)]
    assert not both[-1][0].lost
    assert both[-1][1] < 0.3


@rules
@pytest.mark.parametrize("count", [1, 2])
def test_a_pushed_robot_is_lost_at_once_and_found_by_two_labels(rule, count):
    drive = Drive(robot_in_map(rule, start=[3.0, 2.0, 0.3]), [3.0, 2.0, 0.3])
    for _ in range(20):
        assert not drive.step(drive.near(count))[0].lost
    drive.pose = np.array([13.0, 6.5, 2.0])
    first, second = drive.near(2)
    steps = [drive.step([first] if count == 1 else [first, second]) for _ in range(8)]
    assert any(found.lost for found, _ in steps[:3])
    if count == 1:
        assert all(found.lost for found, _ in steps[2:])
        steps = [drive.step([second]) for _ in range(5)]
    found, error = steps[-1]
    assert not found.lost
    assert error < 0.3


@pytest.mark.parametrize("wrong", [1, 2])
def test_wrong_labels_in_a_row_do_not_move_the_robot(wrong):
    drive = Drive(robot_in_map(start=[3.0, 2.0, 0.3]), [3.0, 2.0, 0.3])
    for _ in range(20):
        drive.step(drive.near(2))
    for _ in range(wrong):
        found, error = drive.step(drive.near(1), labels=[drive.near(9)[-1]])
        assert found.association.tolist() == [-1]
    for _ in range(5):
        found, error = drive.step(drive.near(2))
    assert not found.lost
    assert error < 0.2
    assert len(drive.robot.landmarks.labels) == 16


def test_while_mapping_a_single_tag_has_moved_and_two_have_not():
    drive = Drive(slam.Slam(start=[8.0, 4.0, 0.3]), [8.0, 4.0, 0.3])
    for _ in range(20):
        drive.step(list(range(12)))
    moved = TAGS + np.eye(16, 2) * [3.0, 0.0]  # tag 0
    lost = [drive.step([0], places=moved)[0].lost for _ in range(12)]
    assert not any(lost)
    drive.pose += np.array([0.0, 2.0, 1.0])
    steps = [drive.step([3, 4]) for _ in range(10)]
    assert any(found.lost for found, _ in steps)
    found, error = steps[-1]
    assert not found.lost
    assert error < 0.3


@pytest.mark.parametrize(("seed", "surveyed", "max_tags"), [(4, 6, 2), (6, 6, 1)])
def test_tags_that_are_not_surveyed_are_not_taken_for_those_that_are(seed, surveyed, max_tags):
    """By geometry alone, some of them lie as surveyed tags do from another pose."""
    among = surveyed_tags.drive(seed, surveyed_tags.LOST, max_tags)
    found = surveyed_tags.follow(among, None, slam.EkfConfig(), surveyed)
    assert not found.wrong.any()
    assert not found.lost[-1]
    assert found.error[-50:].max() < 0.5
