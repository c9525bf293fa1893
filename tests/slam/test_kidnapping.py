"""A robot that is moved without its knowledge, against simulated truth."""

import dataclasses

import numpy as np
import pytest

from saccade import slam
from saccade.diagnostics import check_run
from saccade.simulation import simulate_world
from saccade.slam.recorded_log import slam_for
from support.kidnapping import STEP, WORLD, kidnapped
from support.logs import between, scan_of
from support.nightly import nightly

RECOVER = slam.EkfConfig(smooth=False)


def map_error(result, log):
    """(N,) metres from the nearest true landmark."""
    return np.linalg.norm(result.map.xy[:, None] - log.landmark_truth.xy, axis=2).min(1)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("seed", [1, *nightly(3)])
def test_a_kidnapped_robot_is_found_and_its_map_is_kept(named, seed):
    log, clean = kidnapped(seed, named), kidnapped(seed, named, jump=0)
    result, undisturbed = slam.run(log, RECOVER), slam.run(clean, RECOVER)
    assert not undisturbed.lost.any()
    (moved,) = (each for each in check_run(log, result) if each.check == "moved")
    true = np.hypot(*(log.truth.pose[STEP + 1] - log.truth.pose[STEP])[:2])
    assert moved.value == pytest.approx(true, abs=2.0)
    assert moved.severity == "warning"
    lost = np.flatnonzero(result.lost)
    assert STEP < lost[0] < STEP + 20
    assert len(lost) < 10
    error = np.linalg.norm((result.trajectory.pose - log.truth.pose)[:, :2], axis=1)
    assert error[lost[-1] + 1 :].mean() < 0.5
    assert len(result.map) <= len(undisturbed.map) + 2
    assert map_error(result, log).mean() < 1.2 * map_error(undisturbed, clean).mean() + 0.02
    if named:  # names alone bring the filter back, at the expense of its map
        return
    without = slam.run(log, slam.EkfConfig(recover=False, smooth=False))
    assert np.linalg.norm((without.trajectory.pose - log.truth.pose)[-1, :2]) > 1.0


@pytest.mark.parametrize("named", [False, *nightly(True)])
def test_steps_have_the_bits_of_a_run(named):
    log = kidnapped(1, named)
    whole, live = slam.run(log, RECOVER), slam_for(log, RECOVER)
    for i in range(len(log.time)):
        step = live.step(*scan_of(log, i))
        assert step.pose.tobytes() == whole.trajectory.pose[i].tobytes()
        assert step.covariance.tobytes() == whole.trajectory.covariance[i].tobytes()
        assert whole.lost[i] >= step.lost  # a run knows since when
        assert (step.hypotheses is not None) == step.lost
    assert live.map.xy.tobytes() == whole.map.xy.tobytes()


def test_a_lost_robot_leaves_its_map_alone():
    log = kidnapped(1, named=True)
    log = between(log, 0, STEP + 100)
    far = dataclasses.replace(log, observation=log.observation.copy())
    moved = log.observation_pose > STEP
    rng = np.random.default_rng(0)
    far.observation[moved] = rng.uniform([0.5, -3.0], [8.0, 3.0], (moved.sum(), 2))
    result = slam.run(far, RECOVER)
    before = slam_for(log)
    for i in range(STEP + 1):
        before.step(*scan_of(log, i))
    assert result.lost[-1]
    assert result.map.xy == pytest.approx(before.map.xy, abs=0.02)


@pytest.mark.parametrize("kind", ["invariant", "standard"])
def test_a_replaced_pose_leaves_the_landmarks_and_depends_on_none(kind):
    log = kidnapped(2, named=True)
    live = slam_for(log, slam.EkfConfig(errors=kind, estimate_systematic_errors=False))
    for i in range(100):
        live.step(*scan_of(log, i))
    ekf = live.filter
    landmarks, covariance = ekf.landmarks, ekf.covariance
    pose, C = np.array([1.0, 2.0, 0.5]), np.diag([0.4, 0.3, 0.1])
    ekf.reset_pose(pose, C)
    after = ekf.covariance
    np.testing.assert_array_equal(ekf.landmarks, landmarks)
    np.testing.assert_allclose(after[3:, 3:], covariance[3:, 3:], atol=1e-12)
    np.testing.assert_allclose(ekf.landmark_covariances, [
        covariance[3 + 2 * i : 5 + 2 * i, 3 + 2 * i : 5 + 2 * i] for i in range(len(ekf))
    ], atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(after[:3, :3], C)
    assert not after[:3, 3:].any()
    assert ekf.pose == pytest.approx(pose)


def test_a_small_map_is_never_left():
    log = simulate_world(dataclasses.replace(WORLD, landmarks=7), 1)
    wild = dataclasses.replace(log, observation=log.observation[::-1].copy())
    config = slam.EkfConfig(association="known", smooth=False)
    assert not slam.run(wild, config).lost.any()


def test_one_thing_that_no_landmark_explains_is_not_evidence_in_every_scan():
    log = kidnapped(3, named=False, jump=0)
    before = log.observation_pose < STEP
    standing = np.arange(STEP, STEP + 200, 2)  # as before something that hides all the rest
    log = dataclasses.replace(
        log,
        control=np.where(np.arange(len(log.control))[:, None] < STEP, log.control, 0.0),
        observation_pose=np.concatenate([log.observation_pose[before], standing]),
        observation=np.concatenate([log.observation[before], np.tile([1.2, 0.1], (100, 1))]),
        observation_covariance=np.concatenate(
            [log.observation_covariance[before], np.tile(1e-4 * np.eye(2), (100, 1, 1))]
        ),
        landmark=np.full(before.sum() + 100, -1),
    )
    assert not slam.run(log, RECOVER).lost.any()
