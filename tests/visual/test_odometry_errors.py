"""Systematic errors of odometry, estimated from motions that do not include it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from saccade.visual.odometry_model import OdometryErrors

SECONDS = 0.1
TURN_SIGMA = 0.02


def odometry_errors(scale=0.03, camera=0.02):
    return OdometryErrors(scale, camera, TURN_SIGMA)


def measure(errors, control, motion, sigma):
    """Update by a motion (3,) of the camera and a control (3,) of odometry."""
    expected = errors.corrected(control, SECONDS)
    J = errors.jacobian(expected, SECONDS)
    errors.update(J.T @ J / sigma**2, J.T @ (motion - expected) / sigma**2)


def test_the_derivatives_are_finite_differences():
    errors, control = odometry_errors(), np.array([1.2, 0.1, 0.05])
    numeric = np.empty((3, 3))
    for i in range(3):
        ends = []
        for change in (-1e-6, 1e-6):
            moved = odometry_errors()
            moved.error[i] = change
            camera = np.array([moved.camera_factor, moved.camera_factor, 1.0])
            ends.append(camera * moved.corrected(control, SECONDS))
        numeric[:, i] = (ends[1] - ends[0]) / 2e-6
    assert_allclose(errors.jacobian(control, SECONDS), numeric, atol=1e-6)


def test_a_turn_rate_bias_is_learnt():
    errors = odometry_errors()
    before = errors.step_covariance(np.zeros(3), SECONDS)[2, 2]
    for _ in range(200):
        measure(errors, np.array([0.0, 0.0, 0.01 * SECONDS]), np.zeros(3), 0.001)
    assert errors.error[2] == pytest.approx(0.01, rel=0.02)
    assert errors.corrected(np.array([1.0, 0.0, 0.0]), SECONDS)[2] == pytest.approx(
        -0.001, rel=0.02
    )
    assert errors.step_covariance(np.zeros(3), SECONDS)[2, 2] < 0.05 * before


def test_a_robot_that_stands_tells_of_its_turn_alone():
    errors = odometry_errors()
    before = errors.covariance
    measure(errors, np.zeros(3), np.full(3, 0.001), 0.01)
    assert (np.delete(errors.error, 2) == 0).all()
    assert_allclose(np.delete(errors.covariance, 2, 0), np.delete(before, 2, 0), atol=1e-15)


def test_a_scale_error_is_divided_by_variance():
    errors, true = odometry_errors(0.03, 0.02), 0.96  # odometry is 4 percent too long
    for _ in range(3000):
        errors.update_scale(true / errors.factor)
    errors.update_scale(2.0)  # an outlier
    share = 0.03**2 / (0.03**2 + 0.02**2)
    assert errors.factor == pytest.approx(1 - 0.04 * share, abs=2e-3)
    assert errors.scale_sigma == pytest.approx(0.02 * np.sqrt(share), rel=0.05)
    assert odometry_errors(0.03, 0.02).scale_sigma == pytest.approx(0.03)
