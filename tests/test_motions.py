"""Contract over the table of motions: every row works everywhere."""

import re
from dataclasses import replace

import numpy as np
import pytest

from saccade import slam, textbook
from saccade.datasets.logs.log_csv import read_log_csv, write_log_csv
from saccade.errors import LogError
from saccade.motions import MOTIONS, Motion
from saccade.slam.filter.robot_models import as_relative_poses
from saccade.types import LandmarkLog
from saccade.viewing.textbook.ekf import trace_filter
from support.documentation import table_of
from support.logs import scan_of
from support.oracles_slam import numerical_jacobian

every = pytest.mark.parametrize("name", MOTIONS)


def _log(name, rng):
    c = len(MOTIONS[name].columns)
    control = rng.normal(size=(5, c)) * [*[1.0] * (c - 1), 0.3]
    return LandmarkLog(
        name="log",
        start=np.zeros(3),
        time=np.arange(6.0),
        motion=name,
        control=control,
        control_covariance=np.tile(np.diag(rng.uniform(0.01, 0.02, c)), (5, 1, 1)),
        observation_pose=np.arange(6),
        observation=rng.uniform([3, -1], [9, 1], (6, 2)),
        observation_covariance=np.tile(np.diag([0.04, 0.01]), (6, 1, 1)),
        landmark=np.arange(6) % 2,
    )


def test_the_page_of_logs_lists_every_motion_with_its_columns():
    found = {}
    for columns, _, content in table_of("slam.md", "column", "row", "content"):
        for name in re.findall(r"^motion `(\w+)`", content):
            found[name] = tuple(re.findall(r"`(\w+)`", columns))
    assert found == {name: motion.columns for name, motion in MOTIONS.items()}


@every
def test_the_jacobian_is_the_derivative(name, rng):
    motion, size = MOTIONS[name], len(MOTIONS[name].columns)
    control = rng.normal(size=(20, size))
    step, J = motion.relative_poses(control)
    assert step.shape == (20, 3)
    for u, found in zip(control, J, strict=True):
        numeric = numerical_jacobian(lambda at: motion.relative_poses(at[None])[0][0], u)
        np.testing.assert_allclose(found, numeric, atol=1e-7)
    zero = motion.relative_poses(np.zeros((1, size)))[0]
    np.testing.assert_array_equal(zero, 0.0)


@every
def test_errors_of_controls_become_errors_of_relative_poses(name, rng):
    motion, size = MOTIONS[name], len(MOTIONS[name].columns)
    control, root = rng.normal(size=(20, size)), rng.normal(size=(20, size, size))
    U = root @ root.transpose(0, 2, 1)
    step, C, by_error = as_relative_poses(motion, control, U)
    for i, u in enumerate(control):

        def true_pose(error, u=u):  # longer, turning with the distance, shorter with the turn
            real = u * np.append(np.full(size - 1, 1 + error[0]), 1.0)
            real[-1] += u[0] * error[1]
            real[0] -= np.sign(u[0]) * abs(u[-1]) * error[2]
            return motion.relative_poses(real[None])[0][0]

        J = numerical_jacobian(lambda at: motion.relative_poses(at[None])[0][0], u)
        np.testing.assert_allclose(step[i], true_pose(np.zeros(3)), atol=1e-15)
        np.testing.assert_allclose(C[i], J @ U[i] @ J.T, atol=1e-6)
        np.testing.assert_allclose(
            by_error[i], numerical_jacobian(true_pose, np.zeros(3)), atol=1e-6
        )


@every
def test_a_log_is_written_read_and_run(name, rng, tmp_path):
    log = _log(name, rng)
    write_log_csv(tmp_path / "log.csv", log)
    again = read_log_csv(tmp_path / "log.csv")
    assert again.motion == name
    np.testing.assert_array_equal(again.control, log.control)
    result = slam.run(again, slam.EkfConfig(association="known", smooth=False))
    live = slam.Slam(slam.EkfConfig(association="known"), start=log.start, motion=name)
    for i in range(len(log.time)):
        motion = (None, None) if i == 0 else (log.control[i - 1], log.control_covariance[i - 1])
        z, R = log.observation[[i]], log.observation_covariance[[i]]
        step = live.step(log.time[i], *motion, z, R, log.landmark[[i]])
        np.testing.assert_allclose(step.pose, result.filtered.pose[i], atol=1e-12)


def test_an_unknown_motion_is_refused_with_the_known_ones(rng):
    with pytest.raises(LogError, match="motion: expected one of compose, turn_then_translate"):
        slam.Slam(motion="fly").step(0.0, np.zeros(3), np.eye(3))


def test_an_own_motion_works_where_a_name_does(rng):
    """An arc of a length and a turn, whose chord leads to the pose of the closed form."""

    def arc(control):
        d, turn = control.T
        c, s = np.sinc(turn / (2 * np.pi)) * np.array([np.cos(turn / 2), np.sin(turn / 2)])
        step, J = np.stack([d * c, d * s, turn], 1), np.zeros((len(control), 3, 2))
        J[:, 0, 0], J[:, 1, 0], J[:, 2, 1] = c, s, 1.0
        small = 1e-6  # the derivative by the turn, numerically
        for side in (-1, 1):
            t = turn + side * small
            chord = d * np.sinc(t / (2 * np.pi))
            ends = chord * np.array([np.cos(t / 2), np.sin(t / 2)])
            J[:, :2, 1] += side / (2 * small) * ends.T
        return step, J

    own = Motion(("arc", "turn"), arc)
    named = _log("turn_then_translate", rng)
    log = replace(named, motion=own)
    moved = slam.dead_reckon(log).pose
    turns = log.control[:, 1]
    radius = log.control[:, 0] / turns  # x = r sin, y = r (1 - cos) in the frame of the start
    first = [radius[0] * np.sin(turns[0]), radius[0] * (1 - np.cos(turns[0])), turns[0]]
    np.testing.assert_allclose(moved[1], first, atol=1e-12)
    whole = slam.run(log)
    live = slam.Slam(motion=own)
    for i in range(6):
        step = live.step(*scan_of(log, i))
    np.testing.assert_allclose(step.pose, whole.filtered.pose[-1], atol=1e-9)
    trace_filter(log, textbook.EkfSlam, 3)
