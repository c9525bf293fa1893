"""Appendix A against numbers worked by hand, closed forms and invariants."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.errors import ImageError
from saccade.textbook.contrast_saliency import (
    blue_yellow,
    build_pyramid,
    contrast_saliency,
    gabor_kernel,
    intensity,
    normalize,
    oriented_pyramid,
    red_green,
)

DIRECTIONS = (0, 45, 90, 135)
CHANNELS = {"intensity": intensity, "red_green": red_green, "blue_yellow": blue_yellow}
close = np.testing.assert_allclose


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((0.9, 0.3, 0.6), (0.6, 2 / 3, 1 / 3)),
        ((0.2, 0.8, 0.4), (1.4 / 3, -0.75, 0.25)),
        ((0.5, 0.4, 0.0), (0.3, 0.2, -0.8)),
        ((0.7, 0.7, 0.7), (0.7, 0.0, 0.0)),
        ((0.002, 0.001, 0.0), (0.001, 0.5, -0.5)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_channels_of_one_pixel(rgb, expected):
    pixel = np.array([[rgb]], float)
    close([float(channel(pixel)[0, 0]) for channel in CHANNELS.values()], expected, atol=1e-12)


@pytest.mark.parametrize("degrees", DIRECTIONS)
def test_orientation(degrees):
    """One signed convolution, with a kernel that has no mean and prefers its own direction."""
    kernel = gabor_kernel(degrees)
    assert abs(kernel.sum()) < 1e-12 < abs(kernel).max()
    point = np.zeros((65, 65))
    point[32, 32] = 1
    found = oriented_pyramid((point, *(np.zeros((2, 2)) for _ in range(8))), degrees)[0]
    y, x = (side // 2 for side in kernel.shape)
    close(found[32 - y : 33 + y, 32 - x : 33 + x], kernel, atol=1e-12)
    assert abs(found).sum() == pytest.approx(abs(kernel).sum())

    y, x = np.mgrid[:65, :65] - 32  # a bar; y points down
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    bar = ((abs(c * y - s * x) <= 1.5) & (abs(c * x + s * y) <= 24)).astype(float)
    pyramid = build_pyramid(bar)
    answers = [
        sum((oriented_pyramid(pyramid, other)[level] ** 2).sum() for level in (1, 2))
        for other in DIRECTIONS
    ]
    assert DIRECTIONS[int(np.argmax(answers))] == degrees
    assert answers[DIRECTIONS.index((degrees + 90) % 180)] < 0.5 * max(answers)


def test_a_flat_top_is_one_maximum_and_a_flat_map_has_none():
    alone = np.zeros((7, 12))
    alone[2:4, 2:5] = 1
    assert normalize(alone).weight == 1
    alone[3, 9] = 0.5
    assert normalize(alone).mean_of_maxima == pytest.approx(0.75)
    for level in (0.0, 1 / 3, -7.0):
        found = normalize(np.full((4, 5), level))
        np.testing.assert_array_equal(found.map, np.zeros((4, 5)))
        assert (found.weight, found.mean_of_maxima, len(found.maxima)) == (0, 0, 0)


@settings(max_examples=50)
@given(st.permutations(range(42)), st.floats(0.01, 100), st.floats(-50, 50))
def test_normalization_is_its_definition(order, factor, offset):
    values = np.array(order, float).reshape(6, 7)
    scaled = values / 41
    maxima = [
        (row, column)
        for row, column in np.ndindex(6, 7)
        if scaled[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].max()
        == scaled[row, column]
        >= 0.1
    ]
    mean = sum(scaled[place] for place in maxima) / len(maxima)
    weight = 1.0 if len(maxima) == 1 else (1 - mean) ** 2
    found = normalize(factor * values + offset)
    assert sorted(map(tuple, found.maxima.tolist())) == maxima
    assert (found.mean_of_maxima, found.weight) == pytest.approx((mean, weight))
    close(found.map, weight * scaled, atol=1e-9)


def test_a_flat_picture_has_no_saliency_and_a_small_one_is_refused():
    found = contrast_saliency(np.full((150, 200, 3), (1 / 3, 1 / 6, 1 / 9)))
    for each in (found.saliency, found.intensity, found.color, found.orientation):
        np.testing.assert_array_equal(each, np.zeros_like(each))
    with pytest.raises(ImageError):
        contrast_saliency(np.zeros((8, 8, 3)))
