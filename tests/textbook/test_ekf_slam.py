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
ALWAYS_THE_SAME = settings(derandomize=True, max_examples=50)
LENGTH = st.floats(-20, 20)
ANGLE = st.floats(-3.1, 3.1)
POSE = st.tuples(LENGTH, LENGTH, ANGLE).map(np.array)
CONTROL = st.tuples(st.floats(0, 3), ANGLE).map(np.array)
OBSERVATION = st.tuples(st.floats(0.5, 20), ANGLE).map(np.array)


def slopes(function, at, angles=(), step=1e-6):
    """Central differences; the rows named in `angles` are differences of angles."""
    columns = []
    for move in np.eye(len(at)) * step:
        column = function(at + move) - function(at - move)
        for row in angles:
            column[row] = np.arctan2(np.sin(column[row]), np.cos(column[row]))
        columns.append(column / (2 * step))
    return np.stack(columns, axis=1)


def spread(rng, size):
    """A covariance of any kind: positive definite, nothing in it zero."""
    root = rng.normal(size=(size, size))
    return root @ root.T / size + 0.1 * np.eye(size)


def filter_in(s, P):
    """A filter in a state of one's choice."""
    ekf = EkfSlam()
    ekf.s, ekf.P = np.array(s, float), np.array(P, float)
    return ekf


def anywhere(rng, landmarks):
    """A filter amid landmarks, everything correlated with everything."""
    s = np.concatenate([rng.normal(size=3), rng.normal(0, 8, 2 * landmarks)])
    return filter_in(s, spread(rng, len(s)) * 0.05)


def least_eigenvalue(P):
    return np.linalg.eigvalsh((P + P.T) / 2).min()


# f, g, h and wrap


@pytest.mark.parametrize(
    ("pose", "control", "moved"),
    [
        ((0, 0, 0), (1, 0), (1, 0, 0)),
        ((0, 0, 0), (2, PI / 2), (0, 2, PI / 2)),
        ((1, 2, PI / 2), (3, PI / 2), (-2, 2, PI)),
        ((1, 2, -PI / 2), (3, 0), (1, -1, -PI / 2)),
        ((0, 0, 3), (0, 0.2), (0, 0, 3.2 - 2 * PI)),
    ],
)
def test_f_turns_first_and_then_drives(pose, control, moved):
    found = f(np.array(pose, float), np.array(control, float))
    np.testing.assert_allclose(found, moved, atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "landmark", "seen"),
    [
        ((0, 0, 0), (2, 0), (2, 0)),
        ((0, 0, 0), (0, 3), (3, PI / 2)),
        ((1, 1, PI / 2), (1, 5), (4, 0)),
        ((1, 1, PI / 2), (4, 5), (5, np.arctan2(4, 3) - PI / 2)),
        ((0, 0, PI / 2), (0, -2), (2, PI)),
        ((0, 0, 3 * PI / 4), (-1, -1), (np.sqrt(2), PI / 2)),
    ],
)
def test_h_is_range_and_bearing_from_the_heading(pose, landmark, seen):
    found = h(np.array(pose, float), np.array(landmark, float))
    assert found[0] == pytest.approx(seen[0])
    assert np.exp(1j * found[1]) == pytest.approx(np.exp(1j * seen[1]))


@pytest.mark.parametrize(
    ("pose", "z", "landmark"),
    [
        ((0, 0, 0), (1, 0), (1, 0)),
        ((0, 0, 0), (2, PI / 2), (0, 2)),
        ((1, 2, PI / 2), (3, 0), (1, 5)),
        ((1, 2, PI / 2), (3, PI / 2), (-2, 2)),
    ],
)
def test_g_puts_the_landmark_where_it_was_seen(pose, z, landmark):
    found = g(np.array(pose, float), np.array(z, float))
    np.testing.assert_allclose(found, landmark, atol=1e-12)


@ALWAYS_THE_SAME
@given(POSE, OBSERVATION)
def test_h_undoes_g(pose, z):
    np.testing.assert_allclose(h(pose, g(pose, z)), z, atol=1e-9)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (PI, PI),
        (-PI, PI),
        (3.5, 3.5 - 2 * PI),
        (-3.5, 2 * PI - 3.5),
        (5 * PI / 2, PI / 2),
        (-7 * PI / 2, PI / 2),
        (100.0, 100.0 - 32 * PI),
    ],
)
def test_wrap_gives_angles_above_minus_pi_to_pi(angle, wrapped):
    assert wrap(angle) == pytest.approx(wrapped, abs=1e-12)
    assert -PI < wrap(angle) <= PI


# Jacobians


def test_jacobians_where_every_number_is_known():
    ahead, left = np.array([1.0, 0.0]), np.array([2.0, PI / 2])
    start = np.zeros(3)
    np.testing.assert_allclose(grad_f_x(start, ahead), [[1, 0, 0], [0, 1, 1], [0, 0, 1]])
    np.testing.assert_allclose(grad_f_u(start, ahead), [[1, 0], [0, 1], [0, 1]])
    expected = [[1, 0, -2], [0, 1, 0], [0, 0, 1]]
    np.testing.assert_allclose(grad_f_x(start, left), expected, atol=1e-12)
    np.testing.assert_allclose(grad_f_u(start, left), [[0, -2], [1, 0], [0, 1]], atol=1e-12)
    np.testing.assert_allclose(grad_g_x(start, ahead), [[1, 0, 0], [0, 1, 1]])
    np.testing.assert_allclose(grad_g_z(start, ahead), [[1, 0], [0, 1]])
    np.testing.assert_allclose(grad_g_x(start, left), [[1, 0, -2], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(grad_g_z(start, left), [[0, -2], [1, 0]], atol=1e-12)
    seen = grad_h(start, np.array([3.0, 4.0]))
    expected = [[-0.6, -0.8, 0, 0.6, 0.8], [0.16, -0.12, -1, -0.16, 0.12]]
    np.testing.assert_allclose(seen, expected, atol=1e-12)


@ALWAYS_THE_SAME
@given(POSE, CONTROL)
def test_jacobians_of_the_motion_are_its_slopes(x, u):
    by_pose = slopes(lambda moved: f(moved, u), x, angles=[2])
    by_control = slopes(lambda moved: f(x, moved), u, angles=[2])
    np.testing.assert_allclose(grad_f_x(x, u), by_pose, atol=1e-7)
    np.testing.assert_allclose(grad_f_u(x, u), by_control, atol=1e-7)


@ALWAYS_THE_SAME
@given(POSE, OBSERVATION)
def test_jacobian_of_the_observation_is_its_slope(x, z):
    m = x[:2] + z[0] * np.array([np.cos(z[1]), np.sin(z[1])])
    by_both = slopes(lambda both: h(both[:3], both[3:]), np.append(x, m), angles=[1])
    found = grad_h(x, m)
    assert found.shape == (2, 5)
    np.testing.assert_allclose(found, by_both, atol=1e-6)


@ALWAYS_THE_SAME
@given(POSE, OBSERVATION)
def test_jacobians_of_the_new_landmark_are_its_slopes(x, z):
    np.testing.assert_allclose(grad_g_x(x, z), slopes(lambda at: g(at, z), x), atol=1e-7)
    np.testing.assert_allclose(grad_g_z(x, z), slopes(lambda at: g(x, at), z), atol=1e-7)


# One pass through the three steps, every number worked by hand


def test_a_new_filter_knows_its_pose_and_nothing_else():
    ekf = EkfSlam()
    assert ekf.N == 0
    np.testing.assert_array_equal(ekf.s, np.zeros(3))
    np.testing.assert_array_equal(ekf.P, np.zeros((3, 3)))
    assert ekf.m.shape == (0, 2)
    assert ekf.Pxm.shape == (3, 0)
    assert ekf.Pmm.shape == (0, 0)


def test_prediction_then_augmentation_then_update_by_hand():
    ekf = EkfSlam(x0=np.zeros(3), P0=np.diag([0.1, 0.2, 0.3]))
    predicted = ekf.predict(np.array([1.0, 0.0]), np.diag([0.01, 0.04]))
    np.testing.assert_allclose(predicted.Q, [[0.01, 0, 0], [0, 0.04, 0.04], [0, 0.04, 0.04]])
    np.testing.assert_allclose(predicted.s, [1, 0, 0])
    np.testing.assert_allclose(predicted.P, [[0.11, 0, 0], [0, 0.54, 0.34], [0, 0.34, 0.34]])

    R = np.diag([0.01, 0.04])
    grown = ekf.augment(np.array([1.0, 0.0]), R)
    np.testing.assert_allclose(grown.landmark, [2, 0])
    np.testing.assert_allclose(grown.Pmx, [[0.11, 0, 0], [0, 0.88, 0.68]])
    np.testing.assert_allclose(grown.Pmm_new, [[0.12, 0], [0, 1.6]])
    np.testing.assert_allclose(grown.s, [1, 0, 0, 2, 0])
    expected = [
        [0.11, 0, 0, 0.11, 0],
        [0, 0.54, 0.34, 0, 0.88],
        [0, 0.34, 0.34, 0, 0.68],
        [0.11, 0, 0, 0.12, 0],
        [0, 0.88, 0.68, 0, 1.6],
    ]
    np.testing.assert_allclose(grown.P, expected)
    np.testing.assert_allclose(ekf.P, expected)
    np.testing.assert_allclose(ekf.Pxx, [[0.11, 0, 0], [0, 0.54, 0.34], [0, 0.34, 0.34]])
    np.testing.assert_allclose(ekf.Pxm, [[0.11, 0], [0, 0.88], [0, 0.68]])
    np.testing.assert_allclose(ekf.Pmm, [[0.12, 0], [0, 1.6]])

    seen = ekf.update(0, np.array([1.2, 0.1]), R)
    np.testing.assert_allclose(seen.innovation, [0.2, 0.1])
    np.testing.assert_allclose(seen.H, [[-1, 0, 0, 1, 0], [0, -1, -1, 0, 1]])
    np.testing.assert_allclose(seen.S, [[0.02, 0], [0, 0.08]], atol=1e-15)
    expected = [[0, 0], [0, 0], [0, 0], [0.5, 0], [0, 0.5]]
    np.testing.assert_allclose(seen.W, expected, atol=1e-14)
    np.testing.assert_allclose(seen.s, [1, 0, 0, 2.1, 0.05], atol=1e-14)
    np.testing.assert_allclose(ekf.Pmm, [[0.115, 0], [0, 1.58]], atol=1e-14)
    np.testing.assert_allclose(ekf.Pxx, [[0.11, 0, 0], [0, 0.54, 0.34], [0, 0.34, 0.34]])


def test_a_landmark_seen_again_corrects_the_pose_by_hand():
    ekf = EkfSlam()
    ekf.augment(np.array([2.0, 0.0]), np.diag([0.01, 0.01]))
    np.testing.assert_allclose(ekf.P, np.diag([0, 0, 0, 0.01, 0.04]))
    ekf.predict(np.array([1.0, 0.0]), np.diag([0.02, 0.01]))
    seen = ekf.update(0, np.array([1.2, 0.1]), np.diag([0.01, 0.02]))
    np.testing.assert_allclose(seen.S, np.diag([0.04, 0.1]), atol=1e-15)
    expected = [[-0.5, 0], [0, -0.2], [0, -0.2], [0.25, 0], [0, 0.4]]
    np.testing.assert_allclose(seen.W, expected, atol=1e-14)
    np.testing.assert_allclose(ekf.s, [0.9, -0.02, -0.02, 2.05, 0.04])
    expected = [
        [0.01, 0, 0, 0.005, 0],
        [0, 0.006, 0.006, 0, 0.008],
        [0, 0.006, 0.006, 0, 0.008],
        [0.005, 0, 0, 0.0075, 0],
        [0, 0.008, 0.008, 0, 0.024],
    ]
    np.testing.assert_allclose(ekf.P, expected, atol=1e-15)
    np.testing.assert_array_equal(seen.s, ekf.s)
    np.testing.assert_array_equal(seen.P, ekf.P)


def test_augmentation_to_the_left_by_hand():
    ekf = EkfSlam(np.array([1.0, 2.0, 0.0]), np.diag([0.1, 0.2, 0.5]))
    grown = ekf.augment(np.array([2.0, PI / 2]), np.diag([0.03, 0.07]))
    np.testing.assert_allclose(grown.landmark, [1, 4])
    np.testing.assert_allclose(grown.Gx, [[1, 0, -2], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(grown.Gz, [[0, -2], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(grown.Pmx, [[0.1, 0, -1], [0, 0.2, 0]], atol=1e-12)
    np.testing.assert_allclose(grown.Pmm_new, [[2.38, 0], [0, 0.23]], atol=1e-12)


def test_bearings_are_added_to_the_heading_in_c18():
    pose, z = np.array([0.0, 0.0, 0.3]), np.array([2.0, 0.5])
    np.testing.assert_allclose(grad_g_z(pose, z), grad_g_z(np.zeros(3), [2.0, 0.8]))
    np.testing.assert_allclose(grad_g_x(pose, z), grad_g_x(np.zeros(3), [2.0, 0.8]))


# The general formulas, with whole matrices


@pytest.mark.parametrize("landmarks", [0, 1, 3])
def test_prediction_is_that_of_the_whole_state(rng, landmarks):
    ekf = anywhere(rng, landmarks)
    s, P, u, U = ekf.s.copy(), ekf.P.copy(), np.array([0.7, -0.4]), spread(rng, 2)
    Fx, Fu = np.eye(len(s)), np.zeros((len(s), 2))
    Fx[:3, :3] = slopes(lambda x: f(x, u), s[:3], angles=[2])
    Fu[:3] = slopes(lambda at: f(s[:3], at), u, angles=[2])
    done = ekf.predict(u, U)
    np.testing.assert_allclose(done.P, Fx @ P @ Fx.T + Fu @ U @ Fu.T, atol=1e-8)
    np.testing.assert_allclose(done.s, np.append(f(s[:3], u), s[3:]))
    np.testing.assert_allclose(done.Fx, Fx[:3, :3], atol=1e-7)
    np.testing.assert_allclose(done.Fu, Fu[:3], atol=1e-7)
    np.testing.assert_array_equal(ekf.Pmm, P[3:, 3:])
    np.testing.assert_allclose(ekf.Pxm, done.Fx @ P[:3, 3:])


@pytest.mark.parametrize("index", [0, 1, 2])
def test_update_is_that_of_the_information_filter_and_of_joseph(rng, index):
    ekf = anywhere(rng, 3)
    s, P, R = ekf.s.copy(), ekf.P.copy(), np.diag([0.04, 0.01])
    at = 3 + 2 * index
    z = h(s[:3], s[at : at + 2]) + np.array([0.05, -0.02])
    H = slopes(lambda state: h(state[:3], state[at : at + 2]), s, angles=[1])
    done = ekf.update(index, z, R)
    np.testing.assert_allclose(done.H, H, atol=1e-6)
    np.testing.assert_allclose(done.innovation, [0.05, -0.02], atol=1e-12)
    kept = np.eye(len(s)) - done.W @ done.H
    np.testing.assert_allclose(done.P, kept @ P @ kept.T + done.W @ R @ done.W.T, atol=1e-12)
    information = np.linalg.inv(P) + done.H.T @ np.linalg.inv(R) @ done.H
    np.testing.assert_allclose(done.P, np.linalg.inv(information), atol=1e-10)
    correction = done.P @ done.H.T @ np.linalg.inv(R) @ done.innovation
    np.testing.assert_allclose(done.s, s + correction, atol=1e-10)
    np.testing.assert_allclose(done.S, done.H @ P @ done.H.T + R)


@pytest.mark.parametrize("landmarks", [0, 1, 3])
def test_augmentation_is_that_of_the_whole_state(rng, landmarks):
    ekf = anywhere(rng, landmarks)
    s, P, R, z = ekf.s.copy(), ekf.P.copy(), spread(rng, 2), np.array([4.0, -1.1])
    n = len(s)
    grow, noise = np.zeros((n + 2, n)), np.zeros((n + 2, 2))
    grow[:n] = np.eye(n)
    grow[n:, :3] = slopes(lambda x: g(x, z), s[:3])
    noise[n:] = slopes(lambda at: g(s[:3], at), z)
    done = ekf.augment(z, R)
    np.testing.assert_allclose(done.P, grow @ P @ grow.T + noise @ R @ noise.T, atol=1e-7)
    np.testing.assert_allclose(done.s, np.append(s, g(s[:3], z)))
    np.testing.assert_array_equal(done.Pmx, done.P[n:, :n])
    np.testing.assert_array_equal(done.Pmm_new, done.P[n:, n:])
    assert len(ekf.m) == ekf.N
    assert landmarks + 1 == ekf.N
    np.testing.assert_array_equal(ekf.m[-1], done.landmark)
    np.testing.assert_array_equal(ekf.P[:n, :n], P)


def test_augmentation_is_an_update_of_a_landmark_of_which_nothing_was_known(rng):
    ekf = anywhere(rng, 1)
    z, R = np.array([4.0, 0.6]), np.diag([0.04, 0.01])
    P = np.zeros((7, 7))
    P[:5, :5], P[5:, 5:] = ekf.P, 1e7 * np.eye(2)
    guessed = filter_in(np.append(ekf.s, g(ekf.x, z)), P)
    guessed.update(1, z, R)
    ekf.augment(z, R)
    np.testing.assert_allclose(guessed.s, ekf.s, atol=1e-6)
    np.testing.assert_allclose(guessed.P, ekf.P, atol=1e-5)


@pytest.mark.parametrize(("heading", "seen"), [(PI - 0.01, 0.03), (-PI + 0.01, -0.03)])
def test_the_innovation_is_the_short_way_round(heading, seen):
    ekf = EkfSlam(np.array([0.0, 0.0, heading]), np.diag([0.1, 0.1, 0.1]))
    ekf.augment(np.array([1.0, PI - 0.01]), np.diag([0.1, 0.1]))
    done = ekf.update(0, np.array([1.0, wrap(PI - 0.01 + seen)]), np.diag([0.1, 0.1]))
    assert done.innovation[1] == pytest.approx(seen)
    ekf = EkfSlam(np.array([0.0, 0.0, PI]), np.zeros((3, 3)))
    ekf.augment(np.array([1.0, PI]), np.diag([0.1, 0.1]))
    done = ekf.update(0, np.array([1.0, -PI + 0.02]), np.diag([0.1, 0.1]))
    assert done.innovation[1] == pytest.approx(0.02)


def test_the_heading_stays_wrapped():
    ekf = EkfSlam(np.array([0.0, 0.0, 3.1]), np.diag([0.0, 0.0, 1.0]))
    ekf.augment(np.array([2.0, 0.0]), np.diag([1e-9, 1e-9]))
    ekf.P[3:, 3:] = 0
    ekf.P[:3, 3:] = 0
    ekf.P[3:, :3] = 0
    ekf.update(0, np.array([2.0, -0.1]), np.diag([1e-9, 1e-9]))
    assert ekf.x[2] == pytest.approx(3.2 - 2 * PI, abs=1e-6)
    ekf.predict(np.array([0.0, -0.2]), np.zeros((2, 2)))
    assert ekf.x[2] == pytest.approx(3.0, abs=1e-6)


# A drive


def driven(rng, steps, landmarks):
    """A filter that drives a circle amid landmarks and sees all of them at every step."""
    places = landmarks + 0.0
    truth, U, R = np.zeros(3), np.diag([0.05, 0.02]) ** 2, np.diag([0.1, 0.02]) ** 2
    ekf = EkfSlam()
    states = []
    for _ in range(steps):
        control = np.array([0.5, 0.2])
        truth = f(truth, control + rng.multivariate_normal([0, 0], U))
        states.append(ekf.predict(control, U))
        for index, place in enumerate(places):
            z = h(truth, place) + rng.multivariate_normal([0, 0], R)
            first = index >= ekf.N
            states.append(ekf.augment(z, R) if first else ekf.update(index, z, R))
    return ekf, truth, states


def test_a_drive_stays_sound_and_finds_the_landmarks(rng):
    places = np.array([[3.0, 0.0], [0.0, 5.0], [-4.0, 2.0]])
    ekf, truth, states = driven(rng, 60, places)
    for state in states:
        np.testing.assert_allclose(state.P, state.P.T, atol=1e-12)
        assert least_eigenvalue(state.P) > -1e-12
    error = np.concatenate([ekf.x - truth, (ekf.m - places).ravel()])
    error[2] = wrap(error[2])
    assert error @ np.linalg.solve(ekf.P + 1e-12 * np.eye(9), error) < 27.9  # chi2(9), 99.9 %
    assert np.linalg.norm(error[3:].reshape(3, 2), axis=1).max() < 0.5


def test_updates_only_take_uncertainty_away_and_tie_the_landmarks_together(rng):
    places = np.array([[3.0, 0.0], [0.0, 5.0]])
    _, _, states = driven(rng, 40, places)
    whole = [state for state in states if len(state.s) == 7]
    before = whole[0]
    for state in whole[1:]:
        if hasattr(state, "W"):
            assert least_eigenvalue(before.P - state.P) > -1e-12
        before = state

    def tie(state):
        spread = np.sqrt(np.diag(state.P)[3:])
        return np.abs(state.P[3:5, 5:7] / np.outer(spread[:2], spread[2:])).max()

    assert tie(whole[-1]) > 0.5 > tie(whole[0])


def test_seeing_one_landmark_makes_its_neighbor_more_certain(rng):
    ekf, _, _ = driven(rng, 3, np.array([[3.0, 0.0], [0.0, 5.0]]))
    before = ekf.Pmm[2:, 2:].copy()
    ekf.update(0, h(ekf.x, ekf.m[0]), np.diag([0.01, 0.01]))
    assert np.linalg.det(ekf.Pmm[2:, 2:]) < np.linalg.det(before)


def test_results_and_arguments_are_left_alone_by_later_steps():
    x0, P0 = np.zeros(3), np.diag([0.1, 0.1, 0.1])
    z, u, R = np.array([2.0, 0.3]), np.array([1.0, 0.1]), np.diag([0.1, 0.1])
    ekf = EkfSlam(x0, P0)
    first = ekf.augment(z, R)
    kept = first.s.copy(), first.P.copy()
    ekf.update(0, z, R)
    ekf.predict(u, R)
    np.testing.assert_array_equal(first.s, kept[0])
    np.testing.assert_array_equal(first.P, kept[1])
    np.testing.assert_array_equal(x0, np.zeros(3))
    np.testing.assert_array_equal(P0, np.diag([0.1, 0.1, 0.1]))
    np.testing.assert_array_equal(R, np.diag([0.1, 0.1]))
    fresh = EkfSlam(x0, P0)
    x0[0] = P0[0, 0] = 7
    assert fresh.x[0] == 0
    assert fresh.Pxx[0, 0] == 0.1
    with pytest.raises((AttributeError, TypeError)):
        first.s = kept[0]
