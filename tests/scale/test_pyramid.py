import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from saccade.attention.contrast_steps import gabor_energy, gabor_pair
from saccade.scale.pyramid import (
    halve,
    resize,
)
from support import oracles_attention as oracles

sides = st.integers(1, 17)
images = st.tuples(sides, sides).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.floats(0, 1, width=16))
)


@given(images)
def test_halve_is_its_formula(image):
    np.testing.assert_allclose(halve(image), oracles.halve(image), atol=1e-6)


def test_the_kernel_of_a_level_is_the_binomial_of_six():
    impulse = np.zeros((1, 16))
    impulse[0, 6] = 32
    np.testing.assert_allclose(halve(impulse)[0], [0, 0, 5, 10, 1, 0, 0, 0], atol=1e-12)


def test_resize_shrinks_by_means_and_grows_bilinearly(rng):
    image = rng.random((8, 12))
    np.testing.assert_allclose(resize(image, (4, 3)), oracles.block_mean(image, (4, 3)))
    np.testing.assert_allclose(
        resize(image, (16, 30)), oracles.bilinear(image, (16, 30)), atol=1e-6
    )


@given(st.floats(0, np.pi), st.integers(2, 7).map(lambda half: 2 * half + 1))
def test_a_gabor_pair_has_zero_mean_unit_energy_and_two_phases(angle, size):
    even, odd = gabor_pair(angle, 7, 7 / 3, size)
    for filter_ in (even, odd):
        assert filter_.sum() == pytest.approx(0, abs=1e-9)
        assert (filter_**2).sum() == pytest.approx(1)
    np.testing.assert_allclose(even, even[::-1, ::-1], atol=1e-12)
    np.testing.assert_allclose(odd, -odd[::-1, ::-1], atol=1e-12)


@given(st.lists(st.floats(-np.pi, np.pi), min_size=1, max_size=5), st.sampled_from([5, 9, 13]))
def test_energies_are_the_magnitude_of_the_pairs_responses(angles, size):
    image = np.random.default_rng(size).random((9, 14))
    angles = [*angles, 0, np.pi / 4, np.pi / 2, 3 * np.pi / 4]
    for angle in angles:
        responses = [
            ndimage.correlate(image, filter_, mode="reflect")
            for filter_ in gabor_pair(angle, 6, 2, size)
        ]
        energy = gabor_energy(image, angle, 6, 2, size)
        np.testing.assert_allclose(energy, np.hypot(*responses), atol=1e-9)
