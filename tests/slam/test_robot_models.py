"""Every model's Jacobians against finite differences, and its values against geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade.errors import LogError
from saccade.slam.filter.robot_models import (
    compose,
    difference,
    inverse_observe,
    observe,
    turn_then_translate,
    wrap,
)
from support.oracles_slam import numerical_jacobian

angles = st.floats(-1e4, 1e4)


def _slope(value, at, x, angles=()):
    """Central differences of a model's value at x; `angles` are wrapped."""

    def difference_to(x):
        change = value(x) - at
        for i in angles:
            change[i] = wrap(change[i])
        return change

    return numerical_jacobian(difference_to, x)


@pytest.mark.parametrize(
    ("model", "size", "angles"),
    [(turn_then_translate, 2, [2]), (compose, 3, [2]), (inverse_observe, None, [])],
)
def test_jacobians_of_what_moves_a_pose_or_places_a_landmark_are_slopes(rng, model, size, angles):
    for _ in range(50):
        pose = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi])
        z = rng.uniform([0.1, -np.pi], [40, np.pi])
        other = z if size is None else rng.uniform([-3, -3, -np.pi], [3, 3, np.pi])[:size]
        value, by_pose, by_other = model(pose, other)
        atol = 2e-7 * max(1, np.abs(by_pose).max())
        slope = _slope(lambda p, o=other: model(p, o)[0], value, pose, angles)
        np.testing.assert_allclose(by_pose, slope, atol=atol)
        slope = _slope(lambda o, p=pose: model(p, o)[0], value, other, angles)
        np.testing.assert_allclose(by_other, slope, atol=atol)


def test_the_jacobian_of_an_observation_is_its_slope(rng):
    for _ in range(50):
        pose, away = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi]), rng.uniform(-np.pi, np.pi)
        landmark = pose[:2] + rng.uniform(0.5, 30) * np.array([np.cos(away), np.sin(away)])
        z, H = observe(pose, landmark)
        both = np.concatenate([pose, landmark])
        slope = _slope(lambda b: observe(b[:3], b[3:])[0], z, both, [1])
        np.testing.assert_allclose(H, slope, atol=2e-7 * max(1, np.abs(H).max()))


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
