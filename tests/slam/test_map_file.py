"""A session that begins with the map of an earlier one."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.errors import ConfigError, LogError
from saccade.evaluation.trajectory import position_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import chi_square_band, pose_nees
from saccade.slam.recorded_log import find_start, slam_for
from support.circular_log import simulate
from support.logs import between, with_observations, without_names
from support.nightly import nightly


def cut(log, pose):
    """A log up to a pose, with its observations, and from it on, without."""
    later = with_observations(log, log.observation_pose > pose)
    return between(log, 0, pose), between(later, pose, len(log.time) - 1)


def assert_two_sessions_equal_one(log, config, pose, path):
    """Cut at a pose, saved and loaded there, a run is the same as in one piece."""
    whole, first = slam_for(log, config), slam_for(log, config)
    one = slam.run(log, initial=whole)
    begin, end = cut(log, pose)
    before = slam.run(begin, initial=first)
    first.save(path)
    second = slam.Slam.load(path)
    after = slam.run(end, initial=second)
    same = {"rtol": 0, "atol": 1e-9}
    for name in ("pose", "covariance"):
        parts = getattr(before.filtered, name), getattr(after.filtered, name)[1:]
        np.testing.assert_allclose(np.concatenate(parts), getattr(one.filtered, name), **same)
    np.testing.assert_allclose(second.filter.state, whole.filter.state, **same)
    np.testing.assert_allclose(second.filter.covariance, whole.filter.covariance, **same)
    np.testing.assert_array_equal(second.map.id, whole.map.id)
    np.testing.assert_array_equal(second.map.label, whole.map.label)
    assert second.num_steps == whole.num_steps


@pytest.mark.parametrize(
    ("kind", "named", "pose"),  # each two of the three in all combinations
    [
        *[("invariant", True, 7), ("invariant", False, 150)],
        *[("standard", False, 7), ("standard", True, 150)],
        *nightly(("invariant", False, 7), ("invariant", True, 150)),
        *nightly(("standard", True, 7), ("standard", False, 150)),
    ],
)
def test_two_sessions_equal_one(rng, tmp_path, kind, named, pose):
    log, _, _ = simulate(rng, steps=200)
    if not named:
        log = without_names(log)
    log = replace(log, odometry_bias=(0.02, 0.02, 0.0))
    config = slam.EkfConfig(errors=kind, max_hypotheses=1, smooth=False)
    assert_two_sessions_equal_one(log, config, pose, tmp_path / "new" / "folders" / "map.npz")


def test_a_loaded_filter_refuses_a_step_before_its_last(tmp_path):
    first = slam.Slam()
    first.step(20.0, z=np.array([[3.0, 0.5]]), R=np.eye(2) / 100, labels=[4])
    first.save(tmp_path / "map.npz")
    again = slam.Slam.load(tmp_path / "map.npz")
    with pytest.raises(LogError, match="time: expected 20 or later, found 19"):
        again.step(19.0)
    again.step(20.0)
    elsewhere = slam.Slam.load(tmp_path / "map.npz", start=(0.0, 0.0, 0.0))  # by another clock
    elsewhere.step(0.0)


WORLD = WorldConfig(
    course_length=60, landmarks=40, landmark_spread=6, steps=300, range_limits=(0.5, 8.0)
)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """The map of a run with seed 1."""
    path, log = tmp_path_factory.mktemp("map") / "map.npz", simulate_world(WORLD, 1)
    mapper = slam_for(log, slam.EkfConfig(smooth=False))
    slam.run(log, initial=mapper)
    mapper.save(path)
    return path


@pytest.mark.parametrize(("mode", "named"), [("continue", True), *nightly(("localize", False))])
def test_another_run_in_the_map_is_consistent(mapped, mode, named, tmp_path):
    nees = []
    for seed in range(2):
        log = simulate_world(replace(WORLD, steps=450), seed + 10)
        first = simulate_world(replace(WORLD, steps=300), seed + 50)
        config = slam.EkfConfig(association="known" if named else "mutual")
        mapper = slam_for(first, config)
        slam.run(first, initial=mapper)
        mapper.save(tmp_path / "map.npz")
        robot = slam.Slam.load(tmp_path / "map.npz", mode, start=log.start)
        landmarks = len(robot.map)
        result = slam.run(log, initial=robot)
        assert mode == "continue" or len(robot.map) == landmarks
        assert position_rmse(result.trajectory, log.truth) < 0.15
        nees.append(pose_nees(result.trajectory, log.truth, "invariant")[225:].mean())
    assert np.mean(nees) < 1.3 * chi_square_band(3, 2)[1]


def test_a_robot_is_found_in_the_map(mapped):
    log = simulate_world(WORLD, 30)
    robot = slam.Slam.load(mapped, "localize", start=(0.0, 0.0, 0.0))
    pose, covariance = find_start(robot, log)
    error = pose - log.start
    error[2] = slam.wrap(error[2])
    assert error @ np.linalg.solve(covariance, error) < 25
    robot = slam.Slam.load(mapped, "localize", start=pose, covariance=covariance)
    result = slam.run(log, initial=robot)
    assert np.hypot(*(result.trajectory.pose - log.truth.pose)[100:, :2].T).max() < 0.6


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("named", [True, False])
def test_a_robot_elsewhere_is_not_found(mapped, seed, named):
    """Elsewhere, as in another building with the same tags."""
    log, _ = cut(simulate_world(WORLD, 30), 2)
    log = log if named else without_names(log)
    strange = np.random.default_rng(seed).uniform([1, -3], [8, 3], log.observation.shape)
    robot = slam.Slam.load(mapped, "localize", start=(0.0, 0.0, 0.0))
    with pytest.raises(LogError, match=r"start: expected a pose in the map that is certain"):
        find_start(robot, replace(log, observation=strange))


def test_sessions_and_descriptors_stay_with_their_landmarks(rng, tmp_path):
    log, _, _ = simulate(rng, steps=100)
    begin, end = cut(log, 4)
    first = slam_for(begin, slam.EkfConfig(association="known"))
    slam.run(begin, initial=first)
    given = {i: np.full(4, i, np.uint8) for i in first.map.id.tolist()}
    first.landmarks.descriptors = given
    first.save(tmp_path / "map")  # any suffix
    second = slam.Slam.load(tmp_path / "map")
    result = slam.run(end, initial=second)
    known = len(first.map)
    np.testing.assert_array_equal(result.session, np.arange(len(result.map)) >= known)
    second.remove(np.array([1, known]))
    np.testing.assert_array_equal(second.landmarks.counts.session[known - 3 : known], [0, 0, 1])
    assert second.landmarks.descriptors.keys() == given.keys() - {1}
    np.testing.assert_array_equal(second.landmarks.descriptors[3], given[3])


@pytest.fixture
def small(rng, tmp_path):
    log, _, _ = simulate(rng, steps=20)
    first = slam_for(log)
    slam.run(log, initial=first)
    first.save(tmp_path / "map.npz")
    return tmp_path / "map.npz"


def _changed(path, **arrays):
    with np.load(path, allow_pickle=False) as archive:
        content = {**archive, **arrays}
    np.savez(path, **content)


def test_what_is_no_map_says_so(small, tmp_path):
    other = tmp_path / "other.npz"
    with pytest.raises(LogError, match=r"other.npz: cannot be read: No such file"):
        slam.Slam.load(other)
    np.savez(other, a=np.zeros(3))
    with pytest.raises(LogError, match=r"other.npz: expected a landmark map .*another .npz"):
        slam.Slam.load(other)
    other.write_bytes(small.read_bytes()[:-500])
    with pytest.raises(LogError, match=r"other.npz: expected a landmark map .*damaged"):
        slam.Slam.load(other)
    _changed(small, **{"covariance": np.zeros(3)})
    with pytest.raises(LogError, match=r"map.npz: expected a landmark map .*damaged"):
        slam.Slam.load(small)
    _changed(small, format=np.array(99))
    with pytest.raises(LogError, match=r"map.npz: expected a format up to \d+, found 99: a later"):
        slam.Slam.load(small)


def test_settings_that_do_not_suit_a_map_are_named(small):
    with pytest.raises(ConfigError, match="mode: expected continue or localize, found 'lost'"):
        slam.Slam.load(small, "lost")
    with pytest.raises(ConfigError, match=r"errors: expected 'invariant'.*, found 'standard'"):
        slam.Slam.load(small, config=slam.EkfConfig(errors="standard"))
    localized = slam.Slam.load(small, "localize", start=(0.0, 0.0, 0.0))
    with pytest.raises(ConfigError, match=r"mode: expected continue .* found localize"):
        localized.save(small)
