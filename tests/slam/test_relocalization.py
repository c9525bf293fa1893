"""Relocalization against known poses, symmetric maps and maps of another place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade import slam
from saccade.errors import ConfigError, LogError
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.filter.robot_models import wrap
from support.logs import without_names
from support.nightly import nightly

SIGMA = np.array([0.05, 0.01])
"""Of a range in metres and a bearing in radians."""


def random_map(seed, count=60, side=40.0):
    return np.random.default_rng(seed).uniform(0, side, (count, 2))


def scan_of(landmarks, pose, rng, reach=12.0):
    """Noisy observations of the landmarks within reach, and their rows."""
    z, _ = slam.observe(pose, landmarks)
    rows = np.flatnonzero(z[:, 0] < reach)
    R = np.tile(np.diag(SIGMA**2), (len(rows), 1, 1))
    return z[rows] + SIGMA * rng.standard_normal((len(rows), 2)), R, rows


def exact(landmarks, sigma=0.01):
    return np.tile(sigma**2 * np.eye(2), (len(landmarks), 1, 1))


def error(pose, truth):
    e = pose - truth
    return np.hypot(*e[:2]), abs(float(wrap(e[2])))


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_of_eight_landmarks_gives_the_pose(seed):
    rng = np.random.default_rng(seed)
    landmarks = random_map(seed)
    pose = np.array([*rng.uniform(12, 28, 2), rng.uniform(-np.pi, np.pi)])
    z, R, rows = scan_of(landmarks, pose, rng)
    assert len(rows) >= 8
    found = slam.Relocalizer(landmarks, exact(landmarks)).add(z, R)
    distance, turn = error(found.pose[0], pose)
    assert found.probability[0] > 0.99
    assert distance < 0.1
    assert turn < 0.02
    assert (found.association[0] == rows).mean() > 0.8
    e = found.pose[0] - pose
    e[2] = wrap(e[2])
    assert e @ np.linalg.solve(found.covariance[0], e) < 20  # chi-square with 3 degrees of freedom


def test_a_map_with_a_symmetry_has_two_equal_hypotheses():
    half = random_map(3, 30, 20.0)
    landmarks = np.concatenate([half, -half])  # the same after half a turn about the origin
    pose = np.array([9.0, 8.0, 0.4])
    z, _ = slam.observe(pose, half)
    near = z[:, 0] < 12
    R = np.tile(np.diag(SIGMA**2), (near.sum(), 1, 1))
    found = slam.Relocalizer(landmarks, exact(landmarks)).add(z[near], R)
    assert found.probability[:2] == pytest.approx([0.5, 0.5], abs=1e-3)
    turned = np.array([-9.0, -8.0, 0.4 - np.pi])
    pairs = [(pose, turned), (turned, pose)]
    assert any(max(error(found.pose[0], a)[0], error(found.pose[1], b)[0]) < 0.05 for a, b in pairs)


def test_a_scan_of_another_place_is_not_believed():
    sure = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        elsewhere = random_map(1000 + seed)
        z, R, _ = scan_of(elsewhere, np.array([20.0, 20.0, 0.0]), rng)
        found = slam.Relocalizer(random_map(seed), exact(elsewhere)).add(z, R)
        sure += len(found) > 0 and found.probability[0] > 0.99
    assert sure == 0


def test_several_scans_decide_what_one_leaves_open():
    rng = np.random.default_rng(5)
    landmarks = random_map(5, 40, 60.0)
    pose, control = np.array([20.0, 25.0, 0.3]), np.array([2.0, 0.0, 0.1])
    U = np.diag([0.02, 0.02, 0.005]) ** 2
    search = slam.Relocalizer(landmarks, exact(landmarks))
    probability = []
    for _ in range(5):
        z, R, _ = scan_of(landmarks, pose, rng, reach=9.0)
        found = search.add(z, R)
        probability.append(found.probability[0] if len(found) else 0.0)
        last = pose
        pose, _, _ = slam.compose(pose, control)
        search.predict(control, U)
    assert probability[-1] > 0.99 > probability[0]
    assert error(found.pose[0], last)[0] < 0.3


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-3.0, 3.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_hypotheses_move_with_the_map(seed, turn, x, y):
    rng = np.random.default_rng(seed)
    landmarks = random_map(seed, 30, 25.0)
    z, R, _ = scan_of(landmarks, np.array([12.0, 12.0, 0.5]), rng)
    if len(z) < 5:
        return
    found = slam.Relocalizer(landmarks, exact(landmarks)).add(z, R)
    c, s = np.cos(turn), np.sin(turn)
    moved = landmarks @ np.array([[c, s], [-s, c]]) + [x, y]
    again = slam.Relocalizer(moved, exact(landmarks)).add(z, R)
    if len(found) and found.probability[0] > 0.99:
        expected, _, _ = slam.compose(np.array([x, y, turn]), found.pose[0])
        assert error(again.pose[0], expected) == pytest.approx((0, 0), abs=1e-6)


def test_errors_that_neighbors_share_do_not_matter():
    landmarks = random_map(9)
    rng = np.random.default_rng(9)
    z, R, _ = scan_of(landmarks, np.array([20.0, 20.0, 1.0]), rng)
    shared = np.kron(np.ones((60, 60)), 25.0 * np.eye(2)) + 1e-4 * np.eye(120)
    found = slam.Relocalizer(landmarks, shared).add(z, R)
    alone = slam.Relocalizer(landmarks, exact(landmarks)).add(z, R)
    assert found.pose[0] == pytest.approx(alone.pose[0], abs=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_points_or_landmarks_give_no_certainty(count):
    landmarks = random_map(1)
    z, _ = slam.observe(np.array([20.0, 20.0, 0.0]), landmarks[:count])
    R = np.tile(np.diag(SIGMA**2), (count, 1, 1))
    found = slam.Relocalizer(landmarks, exact(landmarks)).add(z, R)
    assert (found.probability < 0.9).all()
    few = slam.Relocalizer(landmarks[:count], exact(landmarks[:count]))
    assert (few.add(z, R).probability < 0.99).all()


def test_bad_input_is_refused():
    landmarks = random_map(1)
    with pytest.raises(ConfigError, match="covariance: expected"):
        slam.Relocalizer(landmarks, np.eye(3))
    search = slam.Relocalizer(landmarks, exact(landmarks))
    with pytest.raises(LogError, match="observation"):
        search.add(np.array([[np.nan, 0.0]]), np.eye(2)[None])


@pytest.mark.parametrize("named", [False, *nightly(True)])
def test_a_robot_that_starts_anywhere_in_a_saved_map_is_found(named, tmp_path):
    log = simulate_world(WorldConfig(steps=330), seed=3)
    if not named:
        log = without_names(log)
    mapped = slam.slam_for(log)
    expected = slam.run(log, initial=mapped).trajectory.pose
    mapped.save(tmp_path / "map.npz")
    live = slam.Slam.load(tmp_path / "map.npz", "localize", start=(50.0, -50.0, 2.0))
    landmarks, first = len(live.map), 300
    for i in range(first, first + 20):
        k = log.observation_pose == i
        scan = log.observation[k], log.observation_covariance[k], log.landmark[k]
        if i == first:
            found = live.relocalize(*scan)
            assert 0.9 < found.probability[0] <= found.probability.sum() <= 1 + 1e-9
            points = slam.inverse_observe(found.pose[0], scan[0])[0]
            near = live.map.xy[np.searchsorted(live.map.id, found.association[0])]
            assert np.hypot(*(points - near)[found.association[0] >= 0].T).max() < 1.5
        else:
            step = live.step(i, log.control[i - 1], log.control_covariance[i - 1], *scan)
    assert not step.lost
    assert (step.association >= 0).mean() > 0.5
    assert np.hypot(*(step.pose - expected[i])[:2]) < 0.5
    assert len(live.map) == landmarks


def test_relocalization_asks_for_a_map():
    z, R = np.array([[3.0, 0.2]]), np.eye(2)[None]
    with pytest.raises(ConfigError, match="map: expected landmarks"):
        slam.Slam().relocalize(z, R)
