"""Readers against files made by hand, and what they say of broken ones; writers against readers."""

import numpy as np
import pytest
from evo.tools import file_interface
from hypothesis import given
from hypothesis import strategies as st

from saccade.datasets import OdometryNoise, load, write_tum
from saccade.datasets.logs.conversions import integrate
from saccade.datasets.logs.pose_graph import read_pose_graph
from saccade.slam import compose
from saccade.types import Trajectory

QUIET = OdometryNoise(0.0, 0.0, 0.0)
ISAM = """ODOMETRY 0 1 1 0 1.5707963 0.01 0 0 0.02 0.001 0.03
LANDMARK 1 2 3 4 0.5 0.1 0.4
ODOMETRY 1 3 2 0.5 0 0.01 0 0 0.02 0 0.03

# a remark
LANDMARK 0 7 0 2 0.5 0 0.4
LANDMARK 3 7 -1 0 0.5 0 0.4
"""


def _file(tmp_path, text, name="log.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_isam_lines_become_a_log(tmp_path):
    log = load("auto", _file(tmp_path, ISAM, "park.txt"))
    assert log.name == "park"
    assert log.time.tolist() == [0, 1, 3]
    np.testing.assert_array_equal(log.control[1], [2, 0.5, 0])
    assert log.observation_pose.tolist() == [0, 1, 2]
    assert log.landmark.tolist() == [7, 2, 7]
    np.testing.assert_allclose(log.observation, [[2, np.pi / 2], [5, np.arctan2(4, 3)], [1, np.pi]])
    np.testing.assert_allclose(
        log.control_covariance[0], [[0.01, 0, 0], [0, 0.02, 0.001], [0, 0.001, 0.03]]
    )


def test_cartesian_noise_becomes_that_of_range_and_bearing(tmp_path, rng):
    log = read_pose_graph(_file(tmp_path, ISAM))
    sample = rng.multivariate_normal([3, 4], np.array([[0.5, 0.1], [0.1, 0.4]]) * 1e-6, 40_000)
    polar = np.stack([np.hypot(*sample.T), np.arctan2(*sample.T[::-1])], 1)
    found = np.cov(polar.T) * 1e6
    scale = np.sqrt(np.outer(found.diagonal(), found.diagonal()))
    np.testing.assert_allclose(log.observation_covariance[1] / scale, found / scale, atol=0.03)


@pytest.mark.parametrize("entries", ["covariance", "information", "root", "toro"])
def test_each_dialect_says_the_same_covariance(tmp_path, rng, entries):
    root = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    C = root @ root.T
    M = {
        "covariance": C,
        "information": np.linalg.inv(C),
        "toro": np.linalg.inv(C),
        "root": np.linalg.cholesky(np.linalg.inv(C)).T,
    }[entries]
    order = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    if entries == "toro":
        order = [(0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2)]
    numbers = " ".join(repr(float(M[i])) for i in order)
    tags = {"covariance": "ODOMETRY", "information": "EDGE_SE2", "toro": "VERTEX2 0 0 0 0\nEDGE2"}
    text = f"{tags.get(entries, 'EDGE2')} 0 1 1 2 3 {numbers}\n"
    log = load("isam", _file(tmp_path, text))
    np.testing.assert_allclose(log.control_covariance[0], C, rtol=1e-9)


def test_constant_speeds_make_a_circle():
    at = np.array([0.0, 0.7, 2.0, 2.0, 5.0])
    control, _ = integrate(np.zeros(1), np.ones(1) * 2, np.ones(1) * 0.5, at, QUIET)
    span = np.diff(at)
    expected = [4 * np.sin(0.5 * span), 4 * (1 - np.cos(0.5 * span)), 0.5 * span]
    np.testing.assert_allclose(control, np.stack(expected, 1), atol=1e-12)


def test_speeds_hold_until_the_next_and_nothing_moves_before_the_first():
    time, speed = np.array([1.0, 2.0]), np.array([3.0, 5.0])
    control, _ = integrate(time, speed, np.zeros(2), np.array([0.0, 1.5, 4.0]), QUIET)
    np.testing.assert_allclose(control[:, 0], [1.5, 0.5 * 3 + 2 * 5])


samples = st.lists(
    st.tuples(st.floats(0, 0.5), st.floats(-2, 2), st.floats(-3, 3)), min_size=1, max_size=12
)


@given(samples, st.lists(st.floats(0, 6), max_size=6))
def test_poses_in_between_change_nothing(steps, between):
    time = np.cumsum([s[0] for s in steps])
    speed, rate = np.array([s[1:] for s in steps]).T
    noise = OdometryNoise(0.1, 0.2, 0.05)
    whole, spread = integrate(time, speed, rate, np.array([0.0, 6.0]), noise)
    at = np.sort(np.array([0.0, *between, 6.0]))
    parts, _ = integrate(time, speed, rate, at, noise)
    pose = np.zeros(3)
    for part in parts:
        pose = compose(pose, part)[0]
    np.testing.assert_allclose(pose[:2], whole[0, :2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * pose[2]), np.exp(1j * whole[0, 2]), atol=1e-9)
    assert np.linalg.eigvalsh(spread[0])[0] > -1e-12


def test_covariance_of_the_way_is_that_of_sampled_ways(rng):
    """Errors of distance and turn, drawn for each of 40 pieces of an S-curve."""
    noise = OdometryNoise(distance=0.05, turn=0.04, drift=0.02)
    time = np.arange(40) * 0.25
    speed, rate = np.full(40, 1.5), np.repeat([0.6, -0.4], 20)
    _, covariance = integrate(time, speed, rate, np.array([0.0, 10.0]), noise)
    d, phi = speed * 0.25, rate * 0.25
    ds = d + rng.normal(size=(20_000, 40)) * noise.distance * np.sqrt(d)
    turn = np.sqrt(noise.turn**2 * np.abs(phi) + noise.drift**2 * d)
    turns = phi + rng.normal(size=(20_000, 40)) * turn
    heading = np.cumsum(turns, 1)
    middle = heading - turns / 2
    ends = np.stack([(ds * np.cos(middle)).sum(1), (ds * np.sin(middle)).sum(1), heading[:, -1]], 1)
    sigma = np.sqrt(covariance[0].diagonal())
    correlation = covariance[0] / np.outer(sigma, sigma)
    sampled = np.cov(ends.T) / np.outer(sigma, sigma)
    np.testing.assert_allclose(sampled, correlation, atol=0.04)


def test_evo_reads_a_trajectory_as_it_was_written(tmp_path, rng):
    time = 1.24844418e9 + np.arange(30) / 7
    pose = rng.uniform([-90, -90, -np.pi], [90, 90, np.pi], (30, 3))
    path = tmp_path / "deep" / "path.tum"
    write_tum(path, Trajectory(time, pose))
    read = file_interface.read_tum_trajectory_file(str(path))
    np.testing.assert_allclose(read.timestamps, time, atol=1e-6, rtol=0)
    np.testing.assert_allclose(read.positions_xyz, np.c_[pose[:, :2], np.zeros(30)], atol=1e-8)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    turned = np.array(read.poses_se3)[:, :2, 0]
    np.testing.assert_allclose(turned, np.stack([c, s], 1), atol=1e-8)
    assert read.check()[0]
