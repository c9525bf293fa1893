"""The normalization N of appendix A against maps whose maxima can be counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saccade.textbook.contrast_saliency import normalize

ALWAYS_THE_SAME = settings(derandomize=True, max_examples=50)


def test_two_peaks_are_averaged():
    peaks = np.zeros((7, 9))
    peaks[2, 2], peaks[4, 6] = 1, 0.5
    found = normalize(peaks)
    assert found.mean_of_maxima == pytest.approx(0.75)
    assert found.weight == pytest.approx(0.0625)
    np.testing.assert_allclose(found.map, 0.0625 * peaks)
    assert sorted(map(tuple, found.maxima.tolist())) == [(2, 2), (4, 6)]


@pytest.mark.parametrize(
    ("heights", "mean", "weight"),
    [
        ((1.0,), 1.0, 1.0),
        ((1.0, 0.05), 1.0, 1.0),
        ((1.0, 0.5, 0.09), 0.75, 0.0625),
        ((10.0, 1.0), 0.55, 0.2025),
        ((1.0, 0.3, 0.2), 0.5, 0.25),
        ((1.0, 1.0), 1.0, 0.0),
        ((0.4, 0.2, 0.2, 0.2), 0.625, 0.140625),
    ],
)
def test_only_local_maxima_from_a_tenth_upwards_count(heights, mean, weight):
    peaks = np.zeros((5, 4 * len(heights) + 1))
    peaks[2, 2::4][: len(heights)] = heights
    found = normalize(peaks)
    assert found.mean_of_maxima == pytest.approx(mean)
    assert found.weight == pytest.approx(weight)
    np.testing.assert_allclose(found.map, weight * peaks / max(heights), atol=1e-12)
    assert found.maxima.shape == (sum(h >= 0.1 * max(heights) for h in heights), 2)


def test_neighbors_on_the_diagonal_are_neighbors():
    peaks = np.zeros((6, 6))
    peaks[2, 2], peaks[3, 3] = 1, 0.5
    assert normalize(peaks).weight == 1


@pytest.mark.parametrize("corner", [(0, 0), (0, 7), (5, 0), (5, 7), (0, 3), (3, 7)])
def test_peaks_at_the_border_count(corner):
    peaks = np.zeros((6, 8))
    peaks[3, 3], peaks[corner] = 0.5, 1
    assert normalize(peaks).mean_of_maxima == pytest.approx(0.75)


def test_a_flat_top_is_one_maximum():
    alone = np.zeros((7, 12))
    alone[2:4, 2:5] = 1
    assert normalize(alone).weight == 1
    np.testing.assert_array_equal(normalize(alone).map, alone)
    beside = alone.copy()
    beside[3, 9] = 0.5
    assert normalize(beside).mean_of_maxima == pytest.approx(0.75)


@pytest.mark.parametrize("level", [0.0, 0.3, 1 / 3, -7.0])
def test_a_flat_map_stays_zero(level):
    found = normalize(np.full((4, 5), level))
    np.testing.assert_array_equal(found.map, np.zeros((4, 5)))
    assert found.weight == 0
    assert found.mean_of_maxima == 0
    assert found.maxima.shape == (0, 2)


@ALWAYS_THE_SAME
@given(st.permutations(range(42)), st.floats(0.01, 100), st.floats(-50, 50))
def test_normalization_is_its_definition(order, factor, offset):
    values = np.array(order, float).reshape(6, 7)
    scaled = values / 41
    maxima = [
        (row, column)
        for row in range(6)
        for column in range(7)
        if scaled[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].max()
        == scaled[row, column]
        >= 0.1
    ]
    mean = sum(scaled[place] for place in maxima) / len(maxima)
    weight = 1.0 if len(maxima) == 1 else (1 - mean) ** 2
    found = normalize(factor * values + offset)
    assert sorted(map(tuple, found.maxima.tolist())) == maxima
    assert found.mean_of_maxima == pytest.approx(mean)
    assert found.weight == pytest.approx(weight)
    np.testing.assert_allclose(found.map, weight * scaled, atol=1e-9)
