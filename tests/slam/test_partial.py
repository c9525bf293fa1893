"""Observations without a range or without a bearing."""

import dataclasses

import numpy as np
import pytest

from saccade.errors import LogError
from saccade.evaluation.trajectory import position_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import EkfConfig, Slam, observe, run
from saccade.slam.scans import checked_scan
from support.logs import with_observations, without_names

R = np.diag([0.1, 0.02]) ** 2
U = np.diag([0.05, 0.03]) ** 2
WORLD = np.array([[4.0, 1.0], [5.0, -2.0], [2.0, 3.0]])


def _mapped():
    """A robot that has seen the world and moved; the labels are 0, 1 and 2."""
    slam = Slam(EkfConfig(errors="standard", huber=np.inf, estimate_systematic_errors=False))
    z = observe(np.zeros(3), WORLD)[0]
    for i in range(3):
        slam.step(float(i), z=z, R=R, labels=[0, 1, 2])
    slam.step(3.0, np.array([0.5, 0.1]), U)
    return slam


def _without(z, component):
    z = np.array(z)
    z[..., component] = np.nan
    return z


@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("label", [1, None])
def test_one_component_updates_by_one_row_of_the_jacobian(component, label):
    """Against the Kalman update of the dense state by a scalar measurement."""
    slam = _mapped()
    mean, P = slam.filter.state, slam.filter.covariance
    seen = observe(mean[:3], WORLD[1])[0] + [0.04, -0.01]
    predicted, J = observe(mean[:3], mean[5:7])
    h = np.zeros(len(mean))
    h[[0, 1, 2, 5, 6]] = J[1 - component]
    s = h @ P @ h + R[1 - component, 1 - component]
    v = seen[1 - component] - predicted[1 - component]
    result = slam.step(4.0, z=_without([seen], component), R=R, labels=[-1 if label is None else 1])
    assert result.association.tolist() == [1]
    np.testing.assert_allclose(slam.filter.state, mean + P @ h / s * v, atol=1e-9)
    np.testing.assert_allclose(slam.filter.covariance, P - np.outer(P @ h, P @ h) / s, atol=1e-9)
    np.testing.assert_allclose(result.nis, v**2 / s, rtol=1e-6)
    assert np.isnan(result.innovations[0]).tolist() == [component == 0, component == 1]
    np.testing.assert_allclose(result.innovations[0, 1 - component], v, atol=1e-9)


def test_a_partial_observation_adds_no_landmark_and_a_wrong_label_is_rejected():
    slam = _mapped()
    before = slam.filter.state
    z = observe(slam.pose, np.array([[-6.0, -6.0], [-6.0, 2.0]]))[0]
    result = slam.step(4.0, z=_without(z, 0), R=R, labels=[9, 1])
    assert result.association.tolist() == [-1, -1]
    assert result.rejected.tolist() == [False, True]
    assert len(slam.filter) == 3
    np.testing.assert_array_equal(slam.filter.state, before)


def test_complete_and_partial_observations_of_a_scan_are_used_together():
    slam = _mapped()
    new = np.array([[-3.0, 2.0], *WORLD])
    z = observe(slam.pose, new)[0]
    z[2, 0] = z[3, 1] = np.nan
    result = slam.step(4.0, z=z, R=R, labels=[7, 0, 1, 2])
    assert result.association.tolist() == [3, 0, 1, 2]
    assert not result.rejected.any()


def test_neither_range_nor_bearing_is_refused():
    slam = _mapped()
    with pytest.raises(LogError, match="observation 1: expected a range or a bearing"):
        slam.step(4.0, z=np.array([[1.0, 0.0], [np.nan, np.nan]]), R=R, labels=[0, 1])


@pytest.mark.parametrize("association", ["known", "mutual"])
def test_partial_observations_of_a_log_make_the_pose_more_certain_and_not_worse(association):
    """A third of the observations have one component; they are left out for comparison."""
    config, errors = EkfConfig(association=association, smooth=False), []
    for seed in range(4):
        log = simulate_world(WorldConfig(landmarks=25, steps=200), seed=seed)
        z = log.observation.copy()
        z[::3, 0], z[1::6, 1] = np.nan, np.nan
        both = dataclasses.replace(log, observation=z)
        if association == "mutual":
            both = without_names(both)
        used = run(both, config)
        left_out = run(with_observations(both, ~np.isnan(z).any(1)), config)
        variances = [each.trajectory.covariance.trace(0, 1, 2).mean() for each in (used, left_out)]
        assert variances[0] < variances[1]
        errors.append([position_rmse(each.trajectory, log.truth) for each in (used, left_out)])
    partial, complete = np.mean(errors, 0)
    assert partial < 1.05 * complete


def test_several_hypotheses_leave_partial_observations_out():
    log = without_names(simulate_world(WorldConfig(landmarks=25, steps=100), seed=3))
    z = log.observation.copy()
    z[::3, 0] = np.nan
    config = EkfConfig(association="hypotheses", smooth=False)
    partial = run(dataclasses.replace(log, observation=z), config)
    complete = run(with_observations(log, ~np.isnan(z[:, 0])), config)
    np.testing.assert_allclose(partial.map.xy, complete.map.xy, rtol=1e-12)


def test_a_scan_tells_which_components_are_missing():
    z = np.array([[2.0, np.nan], [3.0, 0.1]])
    scan = checked_scan(EkfConfig(), 0.0, None, None, z, R, [4, 5])
    assert scan.partial.tolist() == [True, False]
    assert scan.complete.labels == [5]
