import numpy as np
import pytest

from saccade.attention.channels import quotient_opponency


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
