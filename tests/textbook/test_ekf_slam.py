"""Appendix C against numbers worked by hand, finite differences and dense linear algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.textbook import EkfSlam
from saccade.textbook.ekf_slam import (
    f,
    g,
    grad_f_u,
    grad_f_x,
    grad_g_x,
    grad_g_z,
    grad_h,
    h,
    wrap,
)

PI = np.pi
LENGTH, ANGLE = st.floats(-20, 20), st.floats(-3.1, 3.1)
POSE = st.tuples(LENGTH, LENGTH, ANGLE).map(np.array)
CONTROL = st.tuples(st.floats(0, 3), ANGLE).map(np.array)
OBSERVATION = st.tuples(st.floats(0.5, 20), ANGLE).map(np.array)
close = np.testing.assert_allclose


def slopes(function, at, angles=(), step=1e-6):
    """Central differences; the rows named in `angles` are differences of angles."""
    columns = []
    for move in np.eye(len(at)) * step:
        column = function(at + move) - function(at - move)
        for row in angles:
            column[row] = np.arctan2(np.sin(column[row]), np.cos(column[row]))
        columns.append(column / (2 * step))
    return np.stack(columns, axis=1)


def covariance(rng, size):
    """Positive definite, nothing in it zero."""
    root = rng.normal(size=(size, size))
    return root @ root.T / size + 0.1 * np.eye(size)


def anywhere(rng, landmarks):
    """A filter amid landmarks, everything correlated with everything; its state and covariance."""
    ekf = EkfSlam()
    ekf.s = np.concatenate([rng.normal(size=3), rng.normal(0, 8, 2 * landmarks)])
    ekf.P = covariance(rng, len(ekf.s)) * 0.05
    return ekf, ekf.s.copy(), ekf.P.copy()


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(PI, PI), (-PI, PI), (3.5, 3.5 - 2 * PI), (-7 * PI / 2, PI / 2), (100.0, 100.0 - 32 * PI)],
)
def test_wrap_gives_angles_above_minus_pi_to_pi(angle, wrapped):
    assert wrap(angle) == pytest.approx(wrapped, abs=1e-12)


@settings(max_examples=50)
@given(POSE, CONTROL, OBSERVATION)
def test_g_undoes_h_and_jacobians_are_slopes(x, u, z):
    m = g(x, z)
    close(h(x, m), z, atol=1e-9)
    close(grad_f_x(x, u), slopes(lambda at: f(at, u), x, angles=[2]), atol=1e-7)
    close(grad_f_u(x, u), slopes(lambda at: f(x, at), u, angles=[2]), atol=1e-7)
    by_both = slopes(lambda both: h(both[:3], both[3:]), np.append(x, m), angles=[1])
    close(grad_h(x, m), by_both, atol=1e-6)
    close(grad_g_x(x, z), slopes(lambda at: g(at, z), x), atol=1e-7)
    close(grad_g_z(x, z), slopes(lambda at: g(x, at), z), atol=1e-7)


@pytest.mark.parametrize("index", [0, 2])
def test_update_is_that_of_the_information_filter_and_of_joseph(rng, index):
    ekf, s, P = anywhere(rng, 3)
    R, at = np.diag([0.04, 0.01]), 3 + 2 * index
    z = h(s[:3], s[at : at + 2]) + np.array([0.05, -0.02])
    done = ekf.update(index, z, R)
    close(done.H, slopes(lambda s: h(s[:3], s[at : at + 2]), s, angles=[1]), atol=1e-6)
    close(done.innovation, [0.05, -0.02], atol=1e-12)
    close(done.S, done.H @ P @ done.H.T + R)
    kept = np.eye(len(s)) - done.W @ done.H
    close(done.P, kept @ P @ kept.T + done.W @ R @ done.W.T, atol=1e-12)
    information = np.linalg.inv(P) + done.H.T @ np.linalg.inv(R) @ done.H
    close(done.P, np.linalg.inv(information), atol=1e-10)
    close(done.s, s + done.P @ done.H.T @ np.linalg.inv(R) @ done.innovation, atol=1e-10)


def test_the_heading_stays_wrapped():
    ekf = EkfSlam(np.array([0.0, 0.0, 3.1]), np.diag([0.0, 0.0, 1.0]))
    ekf.augment(np.array([2.0, 0.0]), np.diag([1e-9, 1e-9]))
    ekf.P[3:] = ekf.P[:, 3:] = 0  # the landmark is certain
    ekf.update(0, np.array([2.0, -0.1]), np.diag([1e-9, 1e-9]))
    assert ekf.x[2] == pytest.approx(3.2 - 2 * PI, abs=1e-6)
    ekf.predict(np.array([0.0, -0.2]), np.zeros((2, 2)))
    assert ekf.x[2] == pytest.approx(3.0, abs=1e-6)
