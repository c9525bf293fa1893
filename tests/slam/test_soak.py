"""A robot that steps a thousand times a second: the same as `run`, in memory that does not grow."""

import importlib.util

import numpy as np
import pytest

from saccade import slam
from support.paths import ROOT

spec = importlib.util.spec_from_file_location("live", ROOT / "benchmarks" / "live.py")
live = importlib.util.module_from_spec(spec)
spec.loader.exec_module(live)


@pytest.mark.nightly
@pytest.mark.parametrize("rule", ["known", "mutual"])
def test_ten_minutes_are_the_same_throughout(rule):
    """600 000 steps among 100 landmarks: ten laps, no more memory in the last than in the third."""
    robot = slam.Slam(slam.EkfConfig(association=rule))
    _, memory = live.soak(robot, live.robot(600_000, 100), 600_000)
    assert memory[-1] - memory[3] < 3
    assert 95 <= len(robot.map) <= 105
    angle = 2.0 * 599.999 / (100 * live.SPACING / (2 * np.pi))
    truth = np.array([np.sin(angle), 1 - np.cos(angle)]) * 100 * live.SPACING / (2 * np.pi)
    assert np.hypot(*(robot.pose[:2] - truth)) < 1.0
