import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saccade.attention.channels import intensity, linear_opponency, quotient_opponency


def test_intensity_is_the_mean():
    assert intensity(np.array([[[0.9, 0.3, 0.0]]])) == pytest.approx(0.4)  # A.1


@pytest.mark.parametrize(
    ("rgb", "red_green", "blue_yellow"),
    [
        ((1.0, 0.0, 0.0), 1, 0),
        ((0.0, 0.5, 0.0), -1, 0),
        ((0.0, 0.0, 0.2), 0, 1),
        ((0.8, 0.8, 0.0), 0, -1),
        ((0.8, 0.4, 0.2), 0.5, -0.25),
        ((0.7, 0.7, 0.7), 0, 0),
        ((0.1, 0.0, 0.0), 1, 0),
        ((0.099, 0.0, 0.0), 0, 0),
        ((0.0, 0.0, 0.0), 0, 0),
    ],
)
def test_quotients_by_hand(rgb, red_green, blue_yellow):
    pixel = np.array([[rgb]])
    expected = [[[red_green]], [[blue_yellow]]]
    np.testing.assert_allclose(quotient_opponency(pixel, 0.1), expected)  # A.2, A.3


@pytest.mark.parametrize(
    ("rgb", "red_green", "blue_yellow"),
    [
        ((1.0, 0.0, 0.0), 1, -0.5),
        ((0.0, 0.5, 0.0), -0.5, -0.25),
        ((0.0, 0.0, 0.2), 0, 0.2),
        ((0.8, 0.4, 0.2), 0.4, -0.4),
    ],
)
def test_differences_by_hand(rgb, red_green, blue_yellow):
    pixel = np.array([[rgb]])
    np.testing.assert_allclose(linear_opponency(pixel), [[[red_green]], [[blue_yellow]]])


@given(st.tuples(*3 * [st.floats(0.05, 1)]), st.floats(0.2, 0.9))
def test_opponency_does_not_depend_on_the_light(rgb, dimmer):
    pixel = np.array([[rgb]])
    np.testing.assert_allclose(
        quotient_opponency(pixel, 0), quotient_opponency(dimmer * pixel, 0), atol=1e-12
    )
