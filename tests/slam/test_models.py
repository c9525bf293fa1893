"""Every model's Jacobians against finite differences, and its values against geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade.errors import LogError
from saccade.slam.models import (
    compose,
    difference,
    inverse_observe,
    observe,
    turn_then_translate,
    wrap,
)
from support.oracles_slam import numerical_jacobian

angles = st.floats(-1e4, 1e4)


def _less(reference):
    """Differences to a reference pose, the heading wrapped."""

    def value(pose):
        change = pose - reference
        change[2] = wrap(change[2])
        return change

    return value


def _drive_by_pose(pose, landmark, u, z):
    moved, Fx, _ = turn_then_translate(pose, u[:2])
    return Fx, numerical_jacobian(lambda p: _less(moved)(turn_then_translate(p, u[:2])[0]), pose)


def _drive_by_control(pose, landmark, u, z):
    moved, _, Fu = turn_then_translate(pose, u[:2])
    return Fu, numerical_jacobian(lambda c: _less(moved)(turn_then_translate(pose, c)[0]), u[:2])


def _compose_by_pose(pose, landmark, u, z):
    moved, Fx, _ = compose(pose, u)
    return Fx, numerical_jacobian(lambda p: _less(moved)(compose(p, u)[0]), pose)


def _compose_by_control(pose, landmark, u, z):
    moved, _, Fu = compose(pose, u)
    return Fu, numerical_jacobian(lambda c: _less(moved)(compose(pose, c)[0]), u)


def _observe(pose, landmark, u, z):
    expected, H = observe(pose, landmark)
    both = np.concatenate([pose, landmark])
    return H, numerical_jacobian(lambda b: difference(observe(b[:3], b[3:])[0], expected), both)


def _place_by_pose(pose, landmark, u, z):
    return inverse_observe(pose, z)[1], numerical_jacobian(lambda p: inverse_observe(p, z)[0], pose)


def _place_by_observation(pose, landmark, u, z):
    return inverse_observe(pose, z)[2], numerical_jacobian(lambda o: inverse_observe(pose, o)[0], z)


@pytest.mark.parametrize(
    "jacobian",
    [
        _drive_by_pose,
        _drive_by_control,
        _compose_by_pose,
        _compose_by_control,
        _observe,
        _place_by_pose,
        _place_by_observation,
    ],
)
def test_jacobian_is_the_slope(jacobian, rng):
    for _ in range(50):
        pose = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi])
        away = rng.uniform(-np.pi, np.pi)
        landmark = pose[:2] + rng.uniform(0.5, 30) * np.array([np.cos(away), np.sin(away)])
        control = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi])
        z = rng.uniform([0.1, -np.pi], [40, np.pi])
        ours, slope = jacobian(pose, landmark, control, z)
        np.testing.assert_allclose(ours, slope, atol=2e-7 * max(1, np.abs(ours).max()))


@pytest.mark.parametrize("control", [[1.0], [1.0, np.nan], "ahead", None, [[1.0], [2.0, 3.0]]])
def test_a_control_of_other_numbers_is_refused(control):
    with pytest.raises(LogError, match="control: expected"):
        turn_then_translate([0.0, 0.0, 0.0], control)


def test_compose_goes_in_the_frame_of_the_last_pose():
    moved, _, _ = compose(np.array([1.0, 2.0, np.pi / 2]), np.array([3.0, 0.5, np.pi]))
    np.testing.assert_allclose(moved, [0.5, 5, -np.pi / 2], atol=1e-15)


@given(angles)
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = float(wrap(angle))
    assert -np.pi < wrapped <= np.pi
    turns = (angle - wrapped) / (2 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


@given(st.tuples(angles, angles, st.floats(-3.1, 3.1)), st.floats(0.01, 1e3), st.floats(-3.1, 3.1))
def test_what_is_placed_is_observed_there(pose, distance, bearing):
    pose, z = np.array(pose), np.array([distance, bearing])
    seen, _ = observe(pose, inverse_observe(pose, z)[0])
    np.testing.assert_allclose(difference(seen, z), 0, atol=1e-8)


def test_landmark_under_the_robot_has_no_direction():
    z, H = observe(np.array([1.0, 2.0, 0.3]), np.array([[1.0, 2.0], [4.0, 6.0]]))
    np.testing.assert_array_equal(z[0], 0)
    np.testing.assert_array_equal(H[0], 0)
    assert z[1, 0] == 5
    assert np.abs(H[1]).max() > 0.5
