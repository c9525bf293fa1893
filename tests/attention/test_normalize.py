import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from saccade.attention.normalize import (
    FLAT,
    NORMALIZATIONS,
    inhibit_laterally,
    local_maxima,
    normalize,
)
from support import oracles_attention as oracles

sides = st.integers(1, 9)
steps = st.tuples(sides, sides).flatmap(
    lambda shape: arrays(np.float32, shape, elements=st.integers(0, 4).map(float))
)


def peaks(*heights, base=0.0):
    """A map with separate peaks of these heights."""
    values = np.full((31, 41), base, np.float32)
    for i, height in enumerate(heights):
        values[4 + 11 * (i // 4), 4 + 10 * (i % 4)] = height
    return values


@pytest.mark.parametrize("method", list(NORMALIZATIONS))
@pytest.mark.parametrize("value", [0.0, 1.0, 0.7])
def test_a_flat_map_is_zero(method, value):
    flat = np.full((6, 7), value, np.float32)
    assert not normalize(flat, method).any()
    flat[2, 3] += FLAT / 2
    assert not normalize(flat, method).any()


@pytest.mark.parametrize(
    ("heights", "literal", "without_the_highest"),
    [
        ((5.0,), 1, 1),
        ((2.0, 1.0), 0.25**2, 0.5**2),
        ((4.0, 1.0, 1.0, 2.0), 0.5**2, (2 / 3) ** 2),
        ((1.0, 1.0, 1.0), 0, 0),
        ((1.0, 0.09), 1, 1),
        ((1.0, 0.1), 0.45**2, 0.9**2),
    ],
)
def test_weights_by_hand(heights, literal, without_the_highest):
    values = peaks(*heights)
    scaled = values / values.max()
    np.testing.assert_allclose(normalize(values, "local-maxima"), scaled * literal, atol=1e-6)
    np.testing.assert_allclose(
        normalize(values, "local-maxima-1998"), scaled * without_the_highest, atol=1e-6
    )
    np.testing.assert_allclose(normalize(values, "none"), scaled)


@given(steps, st.integers(1, 3))
def test_local_maxima_are_their_definition(values, radius):
    assert sorted(local_maxima(values, 1, radius)) == oracles.local_maxima(values, 1, radius)


@given(st.tuples(sides, sides), st.integers(0, 2**32 - 1))
def test_lateral_inhibition_is_its_formula(shape, seed):
    values = np.random.default_rng(seed).random(shape)
    expected = oracles.difference_of_gaussians_step(oracles.difference_of_gaussians_step(values))
    np.testing.assert_allclose(inhibit_laterally(values, 2), expected, atol=1e-9)


@given(steps, st.sampled_from(list(NORMALIZATIONS)), st.floats(0.1, 100), st.floats(-5, 5))
def test_the_unit_of_a_map_does_not_matter(values, method, scale, offset):
    values = values.astype(np.float64)
    before = values.copy()
    expected = normalize(values, method)
    np.testing.assert_array_equal(values, before)
    result = normalize(values * 2.0 ** round(np.log2(scale)) + round(offset), method)
    np.testing.assert_allclose(result, expected, atol=1e-9)
    assert result.min() >= 0
    assert np.isfinite(result).all()
