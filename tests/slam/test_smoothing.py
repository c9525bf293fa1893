"""Smoothing against SciPy's least squares, worlds that are known, and recorded drives."""

import dataclasses
import re

import numpy as np
import pytest
from scipy.optimize import least_squares

from saccade import slam
from saccade.datasets import load
from saccade.errors import ConfigError, LogError
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import EkfConfig, observe, smooth, smoothing, wrap
from saccade.slam.consistency import normalized_squared
from saccade.types import LandmarkLog, LandmarkMap
from support.alignment import align, interpolate
from support.circular_log import simulate
from support.gtsam_smoothing import smooth_by_gtsam
from support.kidnapping import STEP, kidnapped
from support.logs import between, with_observations, without_names

FILTER = EkfConfig(smooth=False, estimate_systematic_errors=False)


def _rmse(position, truth):
    return np.sqrt(((align(position, truth) - truth) ** 2).sum(1).mean())


def _by_scipy(log, start):
    """Poses, landmarks and covariance of the plain least-squares problem of a log."""
    poses = len(log.time)

    def residuals(x):
        pose, xy = np.vstack([log.start, x[: 3 * poses - 3].reshape(-1, 3)]), x[3 * poses - 3 :]
        errors = []
        for a, b, u, U in zip(
            pose[:-1], pose[1:], log.control, log.control_covariance, strict=True
        ):
            c, s = np.cos(a[2]), np.sin(a[2])
            moved = np.array([[c, s], [-s, c]]) @ (b - a)[:2]
            e = np.array([*(moved - u[:2]), wrap(b[2] - a[2] - u[2])])
            errors.append(np.linalg.solve(np.linalg.cholesky(U), e))
        for i, z, R, m in zip(
            log.observation_pose,
            log.observation,
            log.observation_covariance,
            log.landmark,
            strict=True,
        ):
            e = z - observe(pose[i], xy[2 * m : 2 * m + 2])[0]
            errors.append(np.linalg.solve(np.linalg.cholesky(R), [e[0], wrap(e[1])]))
        return np.concatenate(errors)

    found = least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def test_answer_is_that_of_least_squares(rng):
    log, _, _ = simulate(rng, steps=12, reach=6.0, noise=0.2)
    spread = rng.normal(size=(12, 3, 3)) * np.array([0.02, 0.002, 0.01])[:, None]
    log = dataclasses.replace(  # full matrices, so that their frame matters
        log,
        control_covariance=spread @ spread.transpose(0, 2, 1) + 1.6e-5 * np.eye(3),
        observation_covariance=log.observation_covariance * 0.04,
        landmark=np.unique(log.landmark, return_inverse=True)[1],
    )
    filtered = slam.run(log, FILTER)
    order = np.argsort(filtered.map.id)
    result = smooth(log, filtered, dataclasses.replace(FILTER, huber=1e6))
    start = np.concatenate([filtered.trajectory.pose[1:].ravel(), filtered.map.xy[order].ravel()])
    best, covariance = _by_scipy(log, start)
    poses = 3 * len(log.control)
    found = np.concatenate([result.trajectory.pose[1:].ravel(), result.map.xy[order].ravel()])
    sigma = np.sqrt(covariance.diagonal())
    np.testing.assert_allclose((found - best) / sigma, 0, atol=0.03)
    for found, i, size in [
        *((C, 3 * k, 3) for k, C in enumerate(result.trajectory.covariance[1:])),
        *((C, poses + 2 * k, 2) for k, C in enumerate(result.map.covariance[order])),
    ]:
        expected = covariance[i : i + size, i : i + size]
        np.testing.assert_allclose(found, expected, atol=0.02 * expected.diagonal().max())


def test_optimum_and_marginals_are_those_of_gtsam(rng):
    log, _, _ = simulate(rng, "compose", steps=80)
    wrong = rng.random(len(log.observation)) < 0.05
    log = dataclasses.replace(
        log, observation=log.observation + wrong[:, None] * rng.choice([-0.4, 0.4], (len(wrong), 2))
    )
    filtered = slam.run(log, EkfConfig(association="known", smooth=False))
    result = smooth(log, filtered, FILTER, min_decrease=1e-15)
    pose, pose_covariance, xy, covariance, weight = smooth_by_gtsam(log, filtered, EkfConfig())
    assert (weight < 0.9).any()
    np.testing.assert_allclose(result.trajectory.pose, pose, atol=1e-6)
    np.testing.assert_allclose(result.trajectory.covariance, pose_covariance, atol=1e-6)
    np.testing.assert_allclose(result.map.xy, xy, atol=1e-6)
    np.testing.assert_allclose(result.map.covariance, covariance, atol=1e-6)
    np.testing.assert_allclose(result.weight, weight, atol=1e-5)


def test_a_run_in_a_survey_is_smoothed_as_by_gtsam(rng):
    log, _, world = simulate(rng, steps=80)
    root = rng.normal(size=(20, 2, 2)) * 0.05
    C = root @ root.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    given = world + (np.linalg.cholesky(C) @ rng.normal(size=(20, 2, 1)))[:, :, 0]
    survey = LandmarkMap(id=np.arange(20), xy=given, covariance=C)
    config = dataclasses.replace(FILTER, association="known", start_sigma=(0.1, 0.1, 0.1))
    robot = slam.Slam(config, map=survey, start=log.start)
    prior = smoothing.Prior.of_filter(robot.filter)
    filtered = slam.run(log, initial=robot)
    result = smooth(log, filtered, config, prior=prior, min_decrease=1e-15)
    pose, pose_covariance, xy, covariance, _ = smooth_by_gtsam(log, filtered, config, 0.01, survey)
    np.testing.assert_allclose(result.trajectory.pose, pose, atol=1e-6)
    np.testing.assert_allclose(result.trajectory.covariance, pose_covariance, atol=1e-6)
    np.testing.assert_allclose(result.map.xy, xy, atol=1e-6)
    np.testing.assert_allclose(result.map.covariance, covariance, atol=1e-6)


def test_a_map_whose_heading_is_uncertain_is_filtered_only(rng):
    """A rotation of .2 rad, and independent errors, whose part of the rotation adds up."""
    log, _, world = simulate(rng, steps=20)
    turned = (world @ [[0, 1], [-1, 0]]).ravel()
    P = 0.2**2 * np.outer(turned, turned) + 0.1**2 * np.eye(40)
    robot = slam.Slam(EkfConfig(association="known"), map=LandmarkMap(np.arange(20), world))
    mean, covariance = robot.filter.state, robot.filter.covariance
    covariance[-len(P) :, -len(P) :] = P
    robot.filter.set_gaussian(mean, covariance, robot.filter.ids)
    spread = np.square(world - world.mean(0)).sum()
    expected = np.sqrt(0.2**2 + 0.1**2 / spread)
    assert smoothing.Prior.of_filter(robot.filter).turn_sigma == pytest.approx(expected, rel=1e-5)
    result = slam.run(log, initial=robot)
    assert result.estimate == "filtered"
    assert result.remark.startswith("not smoothed: expected a map whose standard deviation")


def test_a_second_session_is_smoothed_with_what_the_first_has_learned(rng, tmp_path):
    """As one session: what is known of pose and landmarks between them is all that counts."""
    log, _, _ = simulate(rng, steps=60, noise=0.1)
    whole = slam.run(log)
    robot = slam.slam_for(log)
    slam.run(between(log, 0, 30), initial=robot)
    robot.save(tmp_path / "map.npz")
    robot = slam.Slam.load(tmp_path / "map.npz")
    rest = between(with_observations(log, log.observation_pose > 30), 30, 60)
    late = slam.run(rest, initial=robot)
    assert (late.estimate, late.remark) == ("smoothed", "")
    np.testing.assert_allclose(late.trajectory.pose, whole.trajectory.pose[30:], atol=1e-3)
    np.testing.assert_allclose(late.map.xy, whole.map.xy, atol=1e-3)
    ratio = late.trajectory.covariance / whole.trajectory.covariance[30:]
    np.testing.assert_allclose(ratio[:, [0, 1, 2], [0, 1, 2]], 1, atol=0.05)


@pytest.mark.parametrize("motion", ["turn_then_translate", "compose"])
def test_exact_log_gives_the_exact_world(rng, motion):
    log, truth, world = simulate(rng, motion, noise=0.0, steps=60)
    result = slam.run(log)
    np.testing.assert_allclose(result.trajectory.pose[:, :2], truth[:, :2], atol=1e-6)
    np.testing.assert_allclose(result.map.xy, world[result.map.id], atol=1e-6)
    np.testing.assert_array_equal(result.weight, 1)


@pytest.mark.parametrize("motion", ["turn_then_translate", "compose"])
def test_smoothing_beats_the_filter_and_is_as_sure_as_it_should_be(rng, motion):
    log, truth, _ = simulate(rng, motion)
    filtered = slam.run(log, FILTER)
    result = smooth(log, filtered)
    error = result.trajectory.pose - truth
    error[:, 2] = wrap(error[:, 2])
    before = np.hypot(*(filtered.trajectory.pose - truth)[:, :2].T)
    assert np.hypot(*error[:, :2].T).mean() < before.mean()
    nees = normalized_squared(error[20:], result.trajectory.covariance[20:])
    assert 1 < nees.mean() < 6  # 3 on average, but errors of one drive hang together


def test_wrong_observations_count_less(rng):
    log, truth, _ = simulate(rng, steps=150)
    wrong = rng.random(len(log.observation)) < 0.05
    bad = dataclasses.replace(
        log, observation=log.observation + wrong[:, None] * rng.choice([-1, 1], (len(wrong), 2))
    )
    filtered = slam.run(bad, EkfConfig(association="known", smooth=False))
    plain, robust = (smooth(bad, filtered, EkfConfig(huber=k)) for k in (np.inf, 1.345))
    error = [np.hypot(*(r.trajectory.pose - truth)[:, :2].T).mean() for r in (plain, robust)]
    assert error[1] < 0.5 * error[0]
    assert np.median(robust.weight[wrong]) < 0.15
    assert np.median(robust.weight[~wrong]) == 1


def test_smoothing_converges_from_far():
    """The filter closes the loop late; 2.7 % of Gaussian residuals have half the weight or less."""
    world = WorldConfig(
        landmarks=60,
        course_length=60,
        steps=900,
        landmark_spread=6,
        range_limits=(0.5, 8.0),
        field_of_view_deg=90,
        odometry_percent=2.5,
        layout=3,
    )
    result = slam.run(without_names(simulate_world(world, 3)))
    assert len(result.map) == 41  # as in the log
    assert result.estimate == "smoothed"
    assert np.nanmean(result.weight < 0.5) < 0.05


def test_unused_observations_have_no_weight_and_no_effect(rng):
    log, _, _ = simulate(rng, steps=40)
    filtered = slam.run(log, FILTER)
    k = int(np.flatnonzero(filtered.association == 0)[-1])
    association = filtered.association.copy()
    association[k] = -1
    result = smooth(log, dataclasses.replace(filtered, association=association))
    assert np.flatnonzero(np.isnan(result.weight)).tolist() == [k]
    changed = log.observation.copy()
    changed[k] += 3.0
    again = smooth(
        dataclasses.replace(log, observation=changed),
        dataclasses.replace(filtered, association=association),
    )
    np.testing.assert_array_equal(again.trajectory.pose, result.trajectory.pose)


def test_without_observations_it_is_dead_reckoning(rng):
    log, _, _ = simulate(rng, "turn_then_translate", steps=30)
    blind = with_observations(log, np.array([], np.int64))
    filtered = slam.run(blind, FILTER)
    result = smooth(blind, filtered, FILTER)
    reckoned = filtered.dead_reckoning
    np.testing.assert_allclose(result.trajectory.pose, reckoned.pose, atol=1e-6)
    np.testing.assert_allclose(
        result.trajectory.covariance, reckoned.covariance, rtol=2e-3, atol=2e-6
    )
    assert len(result.map) == 0


def _open_world(huge):
    """Two landmarks whose bearing nobody knows, each seen once; a third that is known well."""
    R = np.tile(np.diag([0.1, 0.02]) ** 2, (5, 1, 1))
    R[[1, 3], 1, 1] = huge
    return LandmarkLog(
        name="open",
        start=np.zeros(3),
        time=np.arange(3.0),
        motion="compose",
        control=np.array([[1.0, 0, 0.1], [1.0, 0, 0.2]]),
        control_covariance=np.tile(np.eye(3) * 1e-4, (2, 1, 1)),
        observation_pose=np.array([0, 1, 1, 2, 2]),
        observation=np.array([[3.0, 0.5], [2.0, 0.3], [2.2, 0.8], [4.0, -0.4], [2.0, 1.2]]),
        observation_covariance=R,
        landmark=np.array([4, 17, 4, 23, 4]),
    )


def test_what_is_not_determined_is_named():
    log, known = _open_world(1e17), EkfConfig(association="known", smooth=False)
    with pytest.raises(LogError, match="smoothing: expected measurements") as caught:
        smooth(log, slam.run(log, known))
    message = str(caught.value)
    assert re.search(r"landmark (17|23) \(seen 1 time\)", message)
    assert "landmark 4" not in message
    assert "\n" not in message
    determined = _open_world(0.01)
    assert len(slam.run(determined, EkfConfig(association="known")).map) == 3


@pytest.mark.shared
def test_robots_of_one_configuration(shared):
    """The wrong bearings in the logs of robots 3 and 5 do no harm; robot 4 begins blind."""
    errors = []
    for robot in (1, 2, 3, 4, 5):
        log = load("mrclam", shared / "data/logs/mrclam/mrclam6.npz", robot=robot)
        result = slam.run(log)
        errors.append(_rmse(*interpolate(result.trajectory, log.truth)))
    print(f"\nMRCLAM 6: {np.mean(errors):.3f} m, {np.round(errors, 3).tolist()}")
    assert np.mean(errors) < 0.13


@pytest.mark.shared
def test_city_of_trees_is_smoothed(shared):
    folder = shared / "data/logs/citytrees"
    log = load("auto", folder / "cityTrees10000.txt")
    truth = slam.dead_reckon(load("auto", folder / "cityTrees10000_groundtruth.txt")).pose
    result = slam.run(log)
    rmse = _rmse(result.trajectory.pose[:, :2], truth[:, :2])
    print(f"\ncityTrees10000, smoothed: {rmse:.3f} m")
    assert rmse < 0.14


@pytest.mark.parametrize(
    ("scale", "covariance"),
    [
        ("motion_noise_scale", "control_covariance"),
        ("sensor_noise_scale", "observation_covariance"),
    ],
)
def test_noise_scales_are_factors_on_deviations(rng, scale, covariance):
    log, _, _ = simulate(rng, steps=10, reach=6.0, noise=0.2)
    filtered = slam.run(log, FILTER)
    scaled = smooth(log, filtered, EkfConfig(**{scale: 3.0}))
    louder = dataclasses.replace(log, **{covariance: 9 * getattr(log, covariance)})
    told = smooth(louder, filtered)
    np.testing.assert_allclose(scaled.trajectory.pose, told.trajectory.pose, atol=1e-6)
    np.testing.assert_allclose(scaled.map.xy, told.map.xy, atol=1e-6)


def test_a_run_is_smoothed_unless_switched_off(rng):
    log, _, _ = simulate(rng, steps=40)
    filtered = slam.run(log, EkfConfig(smooth=False))
    result = slam.run(log)
    assert (result.estimate, filtered.estimate, filtered.remark) == ("smoothed", "filtered", "")
    np.testing.assert_array_equal(result.filtered.pose, filtered.trajectory.pose)
    np.testing.assert_array_equal(result.trajectory.pose, smooth(log, filtered).trajectory.pose)
    robot = slam.slam_for(log)
    np.testing.assert_array_equal(slam.run(log, initial=robot).map.xy, result.map.xy)
    np.testing.assert_array_equal(robot.map.xy, filtered.map.xy)  # a robot stays causal
    with pytest.raises(ConfigError, match="expected none with `initial`"):
        slam.run(log, FILTER, initial=robot)


def test_what_is_too_large_is_filtered_only(rng, monkeypatch):
    log, _, _ = simulate(rng, steps=40)
    monkeypatch.setattr(smoothing, "MAX_BYTES", 1e4)
    result = slam.run(log)
    assert result.estimate == "filtered"
    assert result.remark.startswith("not smoothed: expected poses and landmarks that fit into")


def test_after_a_kidnapping_the_lost_poses_are_led_back_from_where_the_robot_was_found():
    log = kidnapped(1, named=True)
    result = slam.run(log)
    assert result.lost.sum() > 1
    before, after = (
        np.hypot(*(each.pose - log.truth.pose)[:, :2].T)
        for each in (result.filtered, result.trajectory)
    )
    assert before[result.lost].max() > 5.0
    assert after[result.lost].max() < 0.3
    assert after.mean() < before[~result.lost].mean()


@pytest.mark.parametrize("most", [1, 2])
def test_poses_before_a_kidnapping_is_noticed_are_lost(most):
    """A few labels at a time contradict the pose long before they suffice."""
    log = kidnapped(1, named=True)
    pose, number = log.observation_pose, np.arange(len(log.observation_pose))
    rank = number - np.searchsorted(pose, pose)  # within its scan
    few = (pose > STEP) & (pose <= STEP + 10) & (rank >= most)
    result = slam.run(with_observations(log, ~few))
    error = np.hypot(*(result.trajectory.pose - log.truth.pose)[:, :2].T)
    assert np.flatnonzero(result.lost)[0] == STEP + 1
    assert error.max() < 0.3


def test_half_observations_count_by_the_component_that_was_measured(rng):
    """As with the other component at a standard deviation of 1000."""
    log, _, _ = simulate(rng, steps=40)
    filtered = slam.run(log, FILTER)
    missing = rng.random(log.observation.shape) < 0.3
    missing[missing.all(1)] = False
    half = dataclasses.replace(log, observation=np.where(missing, np.nan, log.observation))
    vague = log.observation_covariance + 1e6 * missing[:, :, None] * np.eye(2)
    told = dataclasses.replace(log, observation_covariance=vague)
    one, two = (smooth(each, filtered) for each in (half, told))
    np.testing.assert_allclose(one.trajectory.pose, two.trajectory.pose, atol=1e-4)
    np.testing.assert_allclose(one.map.xy, two.map.xy, atol=1e-4)
