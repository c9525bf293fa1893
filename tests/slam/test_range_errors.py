"""Systematic errors of the ranges, in worlds where they are known."""

from dataclasses import replace

import numpy as np
import pytest

from saccade import slam
from saccade.datasets.logs.log_csv import read_log_csv, write_log_csv
from saccade.errors import LogError
from saccade.slam.least_squares import Measurements
from saccade.slam.smoothing import Prior, _measurements
from support.circular_log import simulate
from support.oracles_slam import numerical_jacobian


def _stretched(rng, scale, offset):
    log, truth, world = simulate(rng, "compose", steps=300)
    z = log.observation.copy()
    z[:, 0] = (1 + scale) * z[:, 0] + offset
    return replace(log, observation=z, range_errors=(0.0, 0.0)), truth, world


def test_long_ranges_are_found_where_the_odometry_is_declared_exact(rng):
    log, _, _ = _stretched(rng, 0.05, 0.0)
    declared = replace(log, odometry_bias=(1e-4, 1e-4, 1e-4), range_errors=(0.1, 0.1))
    result = slam.run(declared)
    sigma = np.sqrt(result.range_error_covariance.diagonal())
    assert (np.abs(result.range_errors - [0.05, 0.0]) < 4 * sigma).all()
    assert sigma[0] < 0.02


def test_a_disagreement_is_shared_by_the_priors(rng):
    """Minimum of s^2 / sigma_s^2 + b^2 / sigma_b^2 for s + b = 0.03, without known distances."""
    log, _, _ = _stretched(rng, 0.03, 0.0)
    sigma_b, sigma_s = 0.02, 0.04
    priors = {"odometry_bias": (sigma_b, 1e-4, 1e-4), "range_errors": (sigma_s, 1e-4)}
    result = slam.run(replace(log, **priors))
    part = 0.03 / (sigma_b**2 + sigma_s**2)
    assert result.range_errors[0] == pytest.approx(part * sigma_s**2, abs=0.006)
    assert result.odometry_bias[0] == pytest.approx(part * sigma_b**2, abs=0.006)


def test_a_log_without_errors_keeps_its_scale(rng):
    """The residuals of a smaller map are not smaller."""
    log, _, _ = _stretched(rng, 0.0, 0.0)
    result = slam.run(log)
    assert abs(result.range_errors[0]) < 0.006
    assert abs(result.odometry_bias[0]) < 0.006


def test_no_observation_measures_a_common_scale(rng):
    """Odometry, ranges and map may be larger together: only the priors say by how much."""
    log, _, _ = _stretched(rng, 0.0, 0.0)
    config = slam.EkfConfig(association="known", smooth=False)
    sigma_b, sigma_s = config.odometry_bias[0], config.range_errors[0]
    common = (1 / sigma_b**2 + 1 / sigma_s**2) ** -0.5  # deviation of b for a fixed s + b
    result = slam.run(log, config)
    b, s = result.odometry_bias[0], result.range_errors[0]
    assert abs(np.log1p(b) / sigma_b**2 - np.log1p(s) / sigma_s**2) < 0.02 / common
    for variance in (result.bias_covariance[0, 0], result.range_error_covariance[0, 0]):
        assert variance > (0.99 * common) ** 2


@pytest.mark.kernel
@pytest.mark.parametrize("size", [5, 8])
def test_the_update_is_that_of_the_whole_covariance(size, rng):
    """C.10-C.14 with the Jacobian of (1 + s) q + o by finite differences; standard errors."""
    pose = np.concatenate([rng.normal(size=3), np.zeros(size - 5), [0.04, -0.1]])
    P = np.diag(np.r_[[0.04, 0.04, 0.01], np.full(size - 5, 1e-3), [4e-3, 9e-3]])
    ekf, R = slam.EkfSlam(pose, P), np.diag([0.01, 0.001])
    ekf.augment(np.array([5.0, 0.3]), R)
    x, C, z = ekf.state, ekf.covariance, np.array([5.2, 0.28])

    def h(x):
        offset = x[size : size + 2] - x[:2]
        q = np.hypot(*offset)
        return np.array([(1 + x[size - 2]) * q + x[size - 1], np.arctan2(*offset[::-1]) - x[2]])

    assert h(x)[0] == pytest.approx(5.0)
    H = numerical_jacobian(h, x)
    S = H @ C @ H.T + R
    W = C @ H.T @ np.linalg.inv(S)
    ekf.update(z, R, 0)
    np.testing.assert_allclose(ekf.state, x + W @ slam.difference(z, h(x)), atol=1e-7)
    np.testing.assert_allclose(ekf.covariance, C - W @ S @ W.T, atol=1e-7)


def test_jacobians_of_smoothing_are_slopes(rng):
    log, _, _ = _stretched(rng, 0.03, 0.1)
    result = slam.run(log, slam.EkfConfig(association="known", smooth=False))
    config = slam.EkfConfig()
    prior = Prior.without_map(log, config)
    none = np.empty(0, np.int64)
    measured = _measurements(log, config, prior, np.arange(len(log.time)), result.association, none)
    assert isinstance(measured, Measurements)
    at = prior.mean._replace(
        pose=result.filtered.pose, landmark=result.map.xy, bias=rng.normal(size=5) * 0.05
    )
    for kind in (measured.steps, measured.observations):
        slope = numerical_jacobian(lambda b, kind=kind: kind(at._replace(bias=b)).residual, at.bias)
        np.testing.assert_allclose(kind(at).by_bias, slope, atol=1e-4 * np.abs(slope).max())


def test_a_csv_declares_what_is_usual_for_its_robot(rng, tmp_path):
    path = tmp_path / "log.csv"
    log = replace(
        _stretched(rng, 0.0, 0.0)[0],
        odometry_bias=(0.02, 0.01, 0.0),
        range_errors=(0.03, 0.05),
        sensor=(0.1, 0.0, 0.2),
    )
    write_log_csv(path, log)
    again = read_log_csv(path)
    for name in ("odometry_bias", "range_errors", "sensor"):
        assert getattr(again, name) == getattr(log, name)
    path.write_text(path.read_text().replace("range_errors: 0.03", "range errors: wide"))
    with pytest.raises(LogError, match="range_errors: relative error, meters"):
        read_log_csv(path)
