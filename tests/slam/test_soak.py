"""A robot that steps a thousand times a second: the same as `run`, in memory that does not grow."""

import importlib.util

import numpy as np
import pytest

from saccade import slam
from saccade.slam.run import slam_for
from saccade.types import LandmarkLog
from support.paths import ROOT

spec = importlib.util.spec_from_file_location("live", ROOT / "benchmarks" / "live.py")
live = importlib.util.module_from_spec(spec)
spec.loader.exec_module(live)


def recorded(steps, named):
    """The steps of a robot as a log."""
    scans = [(i, step) for i, step in enumerate(steps) if step.z is not None]
    names = np.concatenate([step.names for _, step in scans])
    return LandmarkLog(
        name="a thousand times a second",
        start=np.zeros(3),
        time=np.array([step.time for step in steps]),
        motion="turn_then_translate",
        control=np.array([step.control for step in steps[1:]]),
        control_covariance=np.array([step.U for step in steps[1:]]),
        observation_pose=np.concatenate([np.full(len(step.z), i) for i, step in scans]),
        observation=np.concatenate([step.z for _, step in scans]),
        observation_covariance=np.concatenate([step.R for _, step in scans]),
        landmark=names if named else np.full_like(names, -1),
    )


@pytest.mark.parametrize("rule", ["known", "mutual"])
def test_a_thousand_steps_a_second_are_those_of_run(rule):
    """Three seconds: the first half of a lap."""
    steps = list(live.robot(3000, 10))
    log, config = recorded(steps, rule == "known"), slam.EkfConfig(association=rule)
    robot = slam_for(log, config)
    poses = np.array([robot.step(*step).pose for step in steps])
    result = slam.run(log, config)
    np.testing.assert_array_equal(poses, result.trajectory.pose)
    assert len(result.map) > 5


@pytest.mark.nightly
@pytest.mark.parametrize("rule", ["known", "mutual"])
def test_ten_minutes_are_the_same_throughout(rule):
    """600 000 steps among 100 landmarks: ten laps, no more memory in the last than in the third."""
    robot = slam.Slam(slam.EkfConfig(association=rule))
    _, memory = live.soak(robot, live.robot(600_000, 100), 600_000)
    assert memory[-1] - memory[3] < 3
    assert 95 <= len(robot.ekf) <= 105
    angle = 2.0 * 599.999 / (100 * live.SPACING / (2 * np.pi))
    truth = np.array([np.sin(angle), 1 - np.cos(angle)]) * 100 * live.SPACING / (2 * np.pi)
    assert np.hypot(*(robot.ekf.pose[:2] - truth)) < 1.0
