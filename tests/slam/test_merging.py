"""Maps of two robots as one."""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from saccade import slam
from saccade.datasets import load
from saccade.errors import LogError
from saccade.evaluation.trajectory import landmark_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.merging import _fuse, _Maps
from saccade.types import LandmarkMap
from support.logs import between
from support.nightly import nightly

WORLD = WorldConfig(
    course_length=60, landmarks=60, landmark_spread=6, steps=250, range_limits=(0.5, 8.0)
)


def mapped(log):
    """The map of a log with names."""
    robot = slam.slam_for(log, slam.EkfConfig(smooth=False))
    slam.run(log, initial=robot)
    return robot


def without_names(robot):
    robot = copy.deepcopy(robot)
    robot.landmarks.labels = {}
    return robot


def moved(log, first, last):
    """Part of a log, its first pose at the origin."""
    return replace(between(log, first, last), start=np.zeros(3), truth=None)


def halves(seed):
    """Maps of two robots that drove along overlapping parts of a course, and the transform."""
    return copy.deepcopy(_halves(seed))


@cache
def _halves(seed):
    log, other = simulate_world(WORLD, seed), simulate_world(WORLD, seed + 100)
    start, to = log.truth.pose[0], other.truth.pose[70]
    c, s = np.cos(start[2]), np.sin(start[2])
    xy = (to - start)[:2] @ np.array([[c, -s], [s, c]])
    transform = np.append(xy, slam.wrap(to[2] - start[2]))
    return mapped(moved(log, 0, 140)), mapped(moved(other, 70, 210)), transform


def random_maps(rng, n, m):
    """Two maps of n and m landmarks, the last of the first the first of the second."""
    a, covariances = rng.uniform(0, 10, (n, 2)), []
    for size in (3 + 2 * n, 2 * m):
        root = 0.03 * rng.normal(size=(size, size))
        covariances.append(root @ root.T + 1e-3 * np.eye(size))
    b = np.concatenate([a[n - 4 :], rng.uniform(10, 15, (m - 4, 2))])
    b = (b - [2.0, 1.0]) @ np.array([[0.8, -0.6], [0.6, 0.8]]) + 0.03 * rng.normal(size=(m, 2))
    names = np.full(n, -1), np.full(m, -1)
    return _Maps(3, np.array([1.0, 2.0, 0.3]), (a, b), tuple(covariances), names)


def test_fused_maps_are_the_least_squares_estimate(rng):
    n, m = 7, 6
    maps = random_maps(rng, n, m)
    pairs = np.column_stack([np.arange(n - 4, n), np.arange(4)])
    fused = _fuse(maps, pairs, np.array([2.0, 1.0, np.arctan2(0.6, 0.8)]))
    roots = [np.linalg.inv(np.linalg.cholesky(C)) for C in maps.P]
    prior = np.concatenate([maps.robot, maps.xy[0].ravel()])

    def residuals(x):
        """Of the robot and the first map, the second one's other landmarks, the transform."""
        first, rest, (tx, ty, turn) = x[: 3 + 2 * n], x[3 + 2 * n : -3].reshape(-1, 2), x[-3:]
        R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        points = np.concatenate([first[3:].reshape(-1, 2)[n - 4 :], rest])
        second = (points - [tx, ty]) @ R
        return np.concatenate(
            [roots[0] @ (first - prior), roots[1] @ (second - maps.xy[1]).ravel()]
        )

    kept = np.r_[0 : 3 + 2 * n, 3 + 2 * (n + 4) : 3 + 2 * (n + m)]
    begin = np.concatenate([fused.mean[kept] + 0.01, fused.transform])
    best = least_squares(residuals, begin, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(fused.mean[kept], best.x[:-3], atol=1e-6)
    np.testing.assert_allclose(fused.transform, best.x[-3:], atol=1e-6)
    assert fused.nis == pytest.approx(2 * best.cost, rel=1e-6)
    C = np.linalg.inv(best.jac.T @ best.jac)
    np.testing.assert_allclose(fused.P[np.ix_(kept, kept)], C[:-3, :-3], rtol=0.1, atol=1e-3)
    common = 3 + 2 * (n - 4), 3 + 2 * n  # the same landmarks in both maps
    np.testing.assert_allclose(fused.mean[slice(*common)], fused.mean[3 + 2 * n :][:8], atol=1e-9)


def test_the_stretch_is_the_slope_of_a_regression(rng):
    """Of points of equal variance, of which those of the second map are 4 % farther apart."""
    a = rng.uniform(0, 10, (9, 2))
    b = 1.04 * a @ np.array([[0.8, -0.6], [0.6, 0.8]]) - [2.0, 1.0]
    P, Q = 0.03**2 * np.eye(3 + 18), 0.04**2 * np.eye(18)
    maps = _Maps(3, np.zeros(3), (a, b), (P, Q), (np.full(9, -1), np.full(9, -1)))
    pairs = np.column_stack([np.arange(9), np.arange(9)])
    stretch, variance = _fuse(maps, pairs, np.array([2.0, 1.0, np.arctan2(0.6, 0.8)])).stretch
    assert stretch == pytest.approx(1 / 1.04 - 1)
    assert variance == pytest.approx(0.05**2 / np.square(b - b.mean(0)).sum())


@pytest.mark.parametrize("seed", [0, *nightly(1)])
def test_a_map_of_ranges_that_are_too_long_is_not_merged(seed):
    log, other = (simulate_world(WORLD, each) for each in (seed, seed + 100))
    longer = replace(other, observation=other.observation * [1.08, 1.0])
    first = mapped(log)
    assert len(slam.merge_maps(first, mapped(other)).common) > 10
    with pytest.raises(LogError, match=r"second map 1\.0[4-9]\d times as large"):
        slam.merge_maps(first, mapped(longer))


@pytest.mark.parametrize("seed", [1, *nightly(0, 2)])
def test_maps_are_merged_without_names(seed):
    first, second, transform = halves(seed)
    names = first.map.label, second.map.label
    merged = slam.merge_maps(without_names(first), without_names(second))
    common = merged.common
    rows = np.searchsorted(first.map.id, common[:, 0]), np.searchsorted(second.map.id, common[:, 1])
    np.testing.assert_array_equal(names[0][rows[0]], names[1][rows[1]])
    assert len(common) >= 0.7 * len(np.intersect1d(*names))
    assert len(merged.slam.filter) == len(names[0]) + len(names[1]) - len(common)
    error = merged.transform - transform
    error[2] = slam.wrap(error[2])
    assert error @ np.linalg.solve(merged.covariance, error) < 21  # chi-square, 3 degrees, .9999
    assert (np.linalg.eigvalsh(merged.slam.filter.covariance) > -1e-9).all()


def test_names_give_the_same_map(tmp_path):
    first, second, _ = halves(0)
    named = slam.merge_maps(first, second)
    assert set(named.slam.map.label.tolist()) == {*first.map.label, *second.map.label}
    assert named.probability == 1
    sessions = named.slam.landmarks.counts.session
    np.testing.assert_array_equal(sessions, ~np.isin(named.slam.map.id, first.map.id))
    unnamed = slam.merge_maps(without_names(first), without_names(second))
    np.testing.assert_allclose(unnamed.transform, named.transform, atol=0.2)
    named.slam.save(tmp_path / "merged.npz")
    log = simulate_world(WORLD, 7)
    robot = slam.Slam.load(tmp_path / "merged.npz", "localize", start=(0.0, 0.0, 0.0))
    pose, covariance = slam.find_start(robot, log)
    assert np.sqrt(covariance[0, 0]) < 2
    robot = slam.Slam.load(tmp_path / "merged.npz", start=pose, covariance=covariance)
    assert len(slam.run(log, initial=robot).map) == len(np.unique(log.landmark))


def test_maps_of_different_places_are_not_merged():
    first, second, _ = halves(1)
    xy = np.random.default_rng(0).uniform(0, 20, (len(second.map), 2))
    P, robot = second.filter.covariance, np.zeros(len(second.filter.robot_state))
    second.filter.set_gaussian(np.concatenate([robot, xy.ravel()]), P, second.filter.ids)
    with pytest.raises(LogError, match=r"merging: expected .*, found"):
        slam.merge_maps(without_names(first), without_names(second))


def test_maps_that_contradict_each_other_are_merged_only_if_told_to():
    first, second, _ = halves(0)
    stretched = copy.deepcopy(second)
    mean = np.concatenate([np.zeros(len(second.filter.robot_state)), 1.1 * second.map.xy.ravel()])
    stretched.filter.set_gaussian(mean, second.filter.covariance, second.filter.ids)
    with pytest.raises(LogError, match=r"joint NIS of \d+ of \d+ common landmarks, for at most"):
        slam.merge_maps(first, stretched)
    assert "joint NIS" in slam.merge_maps(first, stretched, anyway=True).slam.warning


def test_a_saved_map_has_its_warning_and_is_not_merged(tmp_path):
    first, second, _ = halves(0)
    assert first.warning == second.warning == slam.merge_maps(first, second).slam.warning == ""
    second.warning = "half of the observations are not used"
    second.save(tmp_path / "second.npz")
    second = slam.Slam.load(tmp_path / "second.npz")
    with pytest.raises(LogError, match="found the second map: half of the observations"):
        slam.merge_maps(first, second)
    assert "half of" in slam.merge_maps(first, second, anyway=True).slam.warning


@pytest.mark.shared
def test_five_robots_of_mrclam_make_one_map(shared):
    path = shared / "data" / "logs" / "mrclam" / "mrclam6.npz"
    logs = [load("mrclam", path, robot=robot) for robot in range(1, 6)]
    robots, truth = [mapped(log) for log in logs], logs[0].landmark_truth

    def rmse(robot):
        return landmark_rmse(LandmarkMap(robot.map.label, robot.map.xy), truth)

    merged = robots[0]
    for other in robots[1:]:
        merged = slam.merge_maps(merged, other).slam
    assert len(merged.map) == 15
    assert rmse(merged) < np.max([rmse(robot) for robot in robots])
