"""Made worlds: their geometry, their noise, and what the filters make of them."""

from dataclasses import replace

import numpy as np
import pytest

from consistency import run_monte_carlo
from saccade import slam
from saccade.errors import ConfigError
from saccade.simulation import WorldConfig, simulate_world

WORLDS = ("loop", "slippery", "car", "coarse")
each_world = pytest.mark.parametrize("name", WORLDS)


@each_world
def test_without_noise_the_log_is_the_truth(name):
    world = replace(
        getattr(WorldConfig, name)(),
        range_percent=0.0,
        range_sigma=0.0,
        bearing_sigma_deg=0.0,
        odometry_percent=0.0,
        speed_sigma=0.0,
        steering_sigma_deg=0.0,
    )
    log = simulate_world(world)
    apart = slam.dead_reckon(log).pose - log.truth.pose
    np.testing.assert_allclose(apart[:, :2], 0, atol=1e-9)
    there = slam.inverse_observe(log.truth.pose[log.observation_pose].T, log.observation)[0]
    np.testing.assert_allclose(there, log.landmark_truth.xy[log.landmark], atol=1e-9)


def test_the_circle_is_that_of_the_article():
    log = simulate_world(WorldConfig.loop())
    assert len(log.control) == 1500
    assert np.hypot(*(log.truth.pose[:, :2] - [0, 10]).T) == pytest.approx(10, abs=0.15)
    np.testing.assert_allclose(np.diff(log.truth.time), 1)
    assert len(log.landmark_truth) == 20
    U = log.control_covariance[0]
    assert U[0, 0] == pytest.approx((0.02 * 0.25) ** 2 / 2, rel=0.05)
    assert U[2, 2] == pytest.approx(8 * (0.02 * 0.25) ** 2)
    z, R = log.observation, log.observation_covariance
    assert 0.3 < z[:, 0].min() < z[:, 0].max() < 6.5
    assert np.sqrt(R[0, 1, 1]) == pytest.approx(np.deg2rad(3))


@each_world
def test_the_errors_have_the_covariance_that_the_log_says(name):
    log = simulate_world(getattr(WorldConfig, name)(), seed=3)
    pose, landmark = log.truth.pose[log.observation_pose], log.landmark_truth.xy[log.landmark]
    exact = np.array([slam.observe(p, m)[0] for p, m in zip(pose, landmark, strict=True)])
    v = slam.difference(log.observation, exact)
    square = np.einsum("ki,kij,kj->k", v, np.linalg.inv(log.observation_covariance), v)
    assert square.mean() == pytest.approx(2, abs=5 * 2 / np.sqrt(len(v)))


def test_systematic_errors_of_the_wheels_are_those_that_the_log_tells():
    course = {"odometry_percent": 0.0, "steps": 50}
    true = simulate_world(WorldConfig(**course)).control
    log = simulate_world(WorldConfig(scale_percent=4.0, heading_drift_deg=2.0, **course))
    assert log.odometry_bias == pytest.approx((0.04, np.deg2rad(2.0), 0))
    moved, length = (np.hypot(*control[:, :2].T) for control in (log.control, true))
    assert np.abs(length / moved - 1) == pytest.approx(0.04)
    turned = log.control[:, 2] - true[:, 2]
    assert np.abs(turned / moved) == pytest.approx(np.deg2rad(2.0))
    scale, drift = length[0] / moved[0] - 1, -turned[0] / moved[0]
    corrected = log.control * (1 + scale, 1 + scale, 1)
    corrected[:, 2] += drift * log.control[:, 0]
    np.testing.assert_allclose(corrected, true, atol=1e-4)


def test_another_seed_is_other_noise_in_the_same_world():
    one, same, other = (simulate_world(WorldConfig(), seed) for seed in (1, 1, 2))
    assert one.observation.tobytes() == same.observation.tobytes()
    assert one.control.tobytes() != other.control.tobytes()
    np.testing.assert_array_equal(one.landmark_truth.xy, other.landmark_truth.xy)


@pytest.mark.parametrize(
    "setting",
    [
        {"vehicle": "boat"},
        {"steps": 0},
        {"range_limits": (5.0, 1.0)},
        {"field_of_view_deg": 0.0},
        {"curvature_amplitude": 9.0},
    ],
)
def test_worlds_that_cannot_be_are_named(setting):
    with pytest.raises(ConfigError, match=next(iter(setting))):
        WorldConfig(**setting)


@pytest.mark.nightly
def test_the_default_filter_is_as_wrong_as_it_says():
    """And the source's is not, in a world with much noise."""
    world = WorldConfig.coarse()
    invariant, standard = (run_monte_carlo(world, kind, 6) for kind in ("invariant", "standard"))
    low, high = invariant.band
    assert low < invariant.anees < high
    assert standard.anees > 2 * high
    assert invariant.rmse < standard.rmse
    assert invariant.in_band > 0.8 > standard.in_band
