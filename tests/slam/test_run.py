"""Whole logs: made ones with a known answer, and bad ones."""

import dataclasses

import numpy as np
import pytest

from saccade import slam
from saccade.errors import LogError
from saccade.slam import EkfConfig
from support.circular_log import simulate
from support.logs import with_observations


@pytest.mark.parametrize("motion", ["turn_then_translate", "compose"])
@pytest.mark.parametrize("kind", ["standard", "invariant"])
def test_exact_log_gives_the_exact_world(rng, motion, kind):
    log, truth, world = simulate(rng, motion, noise=0.0, steps=150)
    result = slam.run(log, EkfConfig(errors=kind, smooth=False))
    atol = 1e-8 if kind == "standard" else 2e-3  # means of the second-order terms of its noise
    np.testing.assert_allclose(result.trajectory.pose[:, :2], truth[:, :2], atol=atol)
    np.testing.assert_allclose(result.dead_reckoning.pose[:, :2], truth[:, :2], atol=1e-8)
    np.testing.assert_allclose(result.map.xy, world[result.map.id], atol=atol)
    np.testing.assert_allclose(
        result.consistency.mean, 0, atol=1e-12 if kind == "standard" else atol
    )


@pytest.mark.parametrize("motion", ["turn_then_translate", "compose"])
@pytest.mark.parametrize("association", ["known", "nearest"])
def test_noisy_log_is_better_than_dead_reckoning_and_as_sure_as_it_should_be(
    rng, motion, association
):
    log, truth, world = simulate(rng, motion)
    result = slam.run(log, EkfConfig(association=association))
    error = np.hypot(*(result.trajectory.pose - truth)[:, :2].T)
    drift = np.hypot(*(result.dead_reckoning.pose - truth)[:, :2].T)
    assert error.mean() < 0.5 * drift.mean()
    assert 1.8 < result.consistency.mean < 2.2
    apart = np.hypot(*(result.map.xy[:, None] - world).transpose(2, 0, 1))
    assert (apart.min(1) < 0.5).all()
    assert len(set(apart.argmin(1).tolist())) == len(result.map) >= 15


def test_association_names_the_landmarks_of_the_map(rng):
    log, _, _ = simulate(rng)
    result = slam.run(log, EkfConfig(smooth=False))
    np.testing.assert_array_equal(result.map.id[result.association], log.landmark)
    np.testing.assert_array_equal(
        result.map.observations, np.bincount(result.association, minlength=len(result.map))
    )
    corrected = np.isfinite(result.consistency.nis)
    assert (~corrected).sum() == len(result.map)  # the first sighting of each


def test_log_without_names_is_associated_by_distance(rng):
    log, _, _ = simulate(rng)
    nameless = dataclasses.replace(log, landmark=np.full(len(log.landmark), -1))
    result = slam.run(nameless, EkfConfig(max_hypotheses=1))
    by_distance = slam.run(log, EkfConfig(association="nearest"))
    np.testing.assert_array_equal(result.association, by_distance.association)
    np.testing.assert_array_equal(result.map.id, np.arange(len(result.map)))
    with pytest.raises(LogError, match=r"association: .* without labels, found known"):
        slam.run(nameless, EkfConfig(association="known"))


def test_noise_scales_are_factors_on_deviations(rng):
    log, _, _ = simulate(rng, steps=60)
    scaled = slam.run(log, EkfConfig(motion_noise_scale=3.0, sensor_noise_scale=2.0))
    by_hand = slam.run(
        dataclasses.replace(
            log,
            control_covariance=log.control_covariance * 9,
            observation_covariance=log.observation_covariance * 4,
        )
    )
    np.testing.assert_allclose(scaled.trajectory.pose, by_hand.trajectory.pose, atol=1e-9)


def test_a_log_without_observations_is_dead_reckoning(rng):
    log, _, _ = simulate(rng)
    blind = with_observations(log, np.array([], np.int64))
    for association in ("auto", "known", "nearest"):
        result = slam.run(blind, EkfConfig(association=association))
        np.testing.assert_array_equal(result.filtered.pose, result.dead_reckoning.pose)
        assert len(result.map) == 0


def test_progress_ends_at_the_last_pose(rng):
    log, _, _ = simulate(rng, steps=301)  # it is told at every third of them, and at the last
    said = []
    slam.run(log, progress=lambda done, of: said.append((done, of)))
    assert said[-1] == (302, 302)
    assert said == sorted(set(said))
    assert 50 < len(said) < 120
